"""Creep: Norton's law, its rate from zero; its exponent begins at 1 and 4.

The rate is counted at a stress that a tenth of the points exceed; it enters linearly, so the null is regular, on the
boundary.
"""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.enrich import (
    elastic_pair,
    enriched,
    has_times,
    locked,
    materials_with,
    new,
    stress_levels,
)

STRESS_EXPONENTS = (1.0, 4.0)
EXPONENT_BOUNDS = [1.0, 15.0]  # of the exponent, which a refit frees: without a rate it has no meaning
REFERENCE_STRESS_LEVEL = 4  # of `Situation.stress`: the reference stress
PROBE_CREEP_SHARE = 0.1  # creep strain over elastic strain at the reference stress, if it acted during the whole test


def variants(situation: Situation) -> tuple[Variant, ...]:
    if not has_times(situation):
        return ()
    proposals = []
    for name, law in materials_with(situation, "elastic", "neo_hookean"):
        rate = f"{name}.rate"
        for stress in stress_levels(situation, name, (REFERENCE_STRESS_LEVEL,)):
            size = PROBE_CREEP_SHARE * stress / elastic_pair(situation, name)[0] / situation.duration
            for n in STRESS_EXPONENTS:
                edits, refit = (enriched(situation, name, "creep", rate=new(size, "1/s"), n=exponent,
                                         stress=locked(stress, "MPa"))
                                for exponent in (locked(n), new(n) | {"bounds": EXPONENT_BOUNDS}))
                proposals.append(Variant(f"{name} creeps with the stress to the {n:g}", edits, (rate,), {rate: 0.0},
                                         {rate: size}, sign=1, exact=law != "elastic", refit=refit))
    return tuple(proposals)


register(Candidate(
    "creep", "rate", "creep", "a creep rate of zero",
    rivals={"viscoelasticity": "the same while a load is held; viscoelastic strain recovers after unloading",
            "plasticity": "both leave strain behind after unloading",
            "force_drift": "a force that falls with time",
            "thermal_expansion": "a strain that grows with time",
            "machine_compliance": "a grip that creeps"},
    separating_tests=("hold the load for as long as the test lasted", "unload to zero and wait", "hold at zero load"),
    variants=variants,
    paraphrase="strain that grows under a constant load; Norton's law"))
