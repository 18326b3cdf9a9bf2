"""Yield with a plateau: nothing hardens up to a plastic strain, as behind an upper yield point (Lueders).

At a length of zero the derivative is that of another yield stress, so the probes are finite: shares of the plastic
strain of the test. The bands themselves are no part of it.
"""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.enrich import elastic_pair, enriched, materials_with, new, plastic_strain

LENGTHS = (0.03, 0.06, 0.12, 0.25)  # of the largest plastic strain, which is that of a notch
RISE = 0.8  # of what the straight line gains over the plateau: behind it the probe is a little below that line
MIN_PROBE_MODULUS_SHARE = 0.02  # of Young's modulus: slope behind the plateau where hardly anything hardens yet


def variants(situation: Situation) -> tuple[Variant, ...]:
    proposals = []
    for name, _ in materials_with(situation, "j2_linear"):
        plateau, H, first = (f"{name}.{key}" for key in ("plateau", "hardening_modulus", "yield_stress"))
        value, begin = situation.values[H], situation.values[first]
        slope = max(value, MIN_PROBE_MODULUS_SHARE * elastic_pair(situation, name)[0])
        is_free = situation.experiment.model.parameters[H].free
        released = {} if is_free else {"hardening_modulus": new(slope, "MPa")}
        for share in LENGTHS:
            length = share * plastic_strain(situation, name)
            edits = enriched(situation, name, "j2_plateau", plateau=new(length), **released)
            proposals.append(Variant(f"{name} yields without hardening over {length:.2g} of plastic strain", edits,
                                     (plateau,) if is_free else (plateau, H), {plateau: 0.0, H: value, first: begin},
                                     {plateau: length, H: slope, first: begin + RISE * slope * length},
                                     sign=1, exact=True))
    return tuple(proposals)


register(Candidate(
    "yield_plateau", "plasticity", "yield plateau", "hardening from the first plastic strain on (plateau = 0)",
    rivals={"hardening_curvature": "another curve of flow stress over plastic strain: bent, not broken",
            "plasticity": "a wrong yield stress changes the beginning of yield too",
            "kinematic_hardening": "a back stress bends the loading curve"},
    separating_tests=("strain further", "unload and load again: a second plateau does not come",
                      "a second specimen after a rest at 200 C: the plateau comes back"),
    variants=variants, has_onset=True,
    paraphrase="flow at a constant stress up to a strain, then hardening (Lueders)", hidden_by_yield_law=True))
