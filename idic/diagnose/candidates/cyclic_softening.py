"""Cyclic softening or hardening: the elastic range shrinks or grows with the plastic strain of all cycles.

Voce's term over the accumulated plastic strain p, Q (1 - exp(-b p)) with Q < 0 where the material softens, beside a
back stress (Chaboche). Q enters linearly, so its null is regular; without it the rate b has no meaning and is tried at
values that saturate within a tenth to all of the plastic strain that the test accumulates. It takes a whole cycle of
yield: one reversal shows a back stress. In a law without back stress only softening is proposed: a curve that rises is
nonlinear hardening.
"""

from __future__ import annotations

import numpy as np

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.enrich import enriched, new, plastic_course
from idic.laws import ELASTOPLASTIC, composed_name, kinds_of

SATURATION_RATES = (1.0, 3.0, 10.0)  # b times the accumulated plastic strain
PROBE_STRESS_SHARE = -0.1  # of the yield stress
MIN_ACCUMULATED = 2.0  # over the range of the plastic strain: 1.5 after one reversal, 2.5 after a whole cycle
VOCE = "voce"
NOT_FOLLOWED = {VOCE, "swift", "orthotropic"}  # has the term; has no yield stress; has no one modulus


def variants(situation: Situation) -> tuple[Variant, ...]:
    proposals = []
    for material in situation.experiment.model.materials:
        name = material.element_set
        if (chosen := _softening(material.law)) is None:
            continue
        law, stem, has_back_stress = chosen
        course = np.append(0.0, plastic_course(situation, name))
        accumulated = float(np.abs(np.diff(course)).sum())
        if accumulated <= MIN_ACCUMULATED * np.ptp(course):
            continue
        Q, b = f"{name}.{stem}Q", f"{name}.{stem}b"
        size = PROBE_STRESS_SHARE * situation.values[f"{name}.yield_stress"]
        for saturation in SATURATION_RATES:
            rate = saturation / accumulated
            edits = enriched(situation, name, law, **{f"{stem}Q": new(size, "MPa"), f"{stem}b": new(rate)})
            label = f"the elastic range of {name} changes over {1.0 / rate:.2g} of accumulated plastic strain"
            proposals.append(Variant(label, edits, (Q, b), {Q: 0.0, b: rate}, {Q: size, b: rate},
                                     sign=0 if has_back_stress else 1, exact=True))
    return tuple(proposals)


def _softening(law: str) -> tuple[str, str, bool] | None:
    """The law with Voce's term, the beginning of its names, and whether there is a back stress; None where the law has
    the term already, or is not followed."""
    if law in ("j2_linear", "j2_kinematic"):
        return ("j2_voce", "", False) if law == "j2_linear" else ("j2_chaboche", "", True)
    if not law.startswith(f"{ELASTOPLASTIC}("):
        return None
    kinds = law[len(ELASTOPLASTIC) + 1:-1].split("+")
    hardening = [kind for kind in kinds if kind in kinds_of("hardening")]
    if NOT_FOLLOWED & set(kinds) or any(kind.startswith("free") or "*" in kind for kind in kinds) \
            or not set(kinds) & set(kinds_of("backstress")):
        return None
    return composed_name((*kinds, VOCE)), f"hardening_{len(hardening) + 1}_", True


register(Candidate(
    "cyclic_softening", "plasticity", "cyclic softening or hardening", "an elastic range that no cycle changes (Q = 0)",
    rivals={"hardening_curvature": "another course of the flow stress, bent within the first loading",
            "kinematic_hardening": "a back stress that recovers bends every loop in the same way",
            "damage": "both lose force from cycle to cycle; only damage lowers the slope of unloading",
            "creep": "both lose force at the same strain; only creep goes on while the load is held",
            "force_drift": "a reading that drifts changes both ends of the loop alike",
            "rate_dependence": "cycles of another speed"},
    separating_tests=("repeat the cycles until the loops stay", "hold between two cycles: only creep goes on",
                      "the slope of unloading in the last cycle: it falls with damage alone"),
    variants=variants, has_onset=True, shows_at_reversal=True,
    paraphrase="a yield surface that shrinks or grows with the plastic strain of all cycles (Chaboche)",
    hidden_by_yield_law=True))
