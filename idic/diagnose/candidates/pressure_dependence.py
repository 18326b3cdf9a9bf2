"""Pressure-dependent yield: Drucker and Prager's friction in a J2 law."""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.enrich import enriched, materials_with, new

PROBE_PRESSURE_COEFFICIENT = 0.2  # compression yields 14 % above tension


def variants(situation: Situation) -> tuple[Variant, ...]:
    proposals = []
    for name, _ in materials_with(situation, "j2_linear"):
        friction = f"{name}.friction"
        edits = enriched(situation, name, "j2_pressure", friction=new(PROBE_PRESSURE_COEFFICIENT))
        proposals.append(Variant(f"{name} yields later under pressure", edits, (friction,), {friction: 0.0},
                                 {friction: PROBE_PRESSURE_COEFFICIENT}, exact=True))
    return tuple(proposals)


register(Candidate(
    "pressure_dependence", "plasticity", "pressure-dependent yield", "no friction",
    rivals={"kinematic_hardening": "both make tension and compression differ",
            "grip_rotation": "more load on one side than on the other",
            "hardening_curvature": "points under high tension yield first"},
    separating_tests=("a compression test", "a notched specimen in addition to a smooth one", "a biaxial test"),
    variants=variants, has_onset=True,
    paraphrase="Drucker and Prager: the yield stress grows with the pressure", hidden_by_yield_law=True))
