"""Prony viscoelasticity: a branch that relaxes, its time on a grid from a frame interval to three times the test."""

from __future__ import annotations

import numpy as np

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.enrich import enriched, has_times, locked, materials_with, new

PROBE_RELAXING_SHARE = 0.1  # share of the shear modulus that relaxes
BRANCH_NUMBERS = (1, 2, 3)


def variants(situation: Situation) -> tuple[Variant, ...]:
    if not has_times(situation):
        return ()
    proposals = []
    for name, law in materials_with(situation, "elastic", "neo_hookean", "maxwell"):
        spare = [i for i in BRANCH_NUMBERS if law != "maxwell" or _is_off(situation, name, i)]
        if not spare:
            continue
        idle_branches = {key: locked(0.0, unit) for i in spare[1:]
                         for key, unit in ((f"g_{i}", "-"), (f"tau_{i}", "s"))}
        g, tau = f"g_{spare[0]}", f"tau_{spare[0]}"
        names = (f"{name}.{g}", f"{name}.{tau}")
        for time in times(situation):
            edits = enriched(situation, name, "maxwell", **idle_branches,
                             **{g: new(PROBE_RELAXING_SHARE), tau: new(time, "s")})
            proposals.append(Variant(f"{name} relaxes within {time:.3g} s", edits, names,
                                     {names[0]: 0.0, names[1]: time}, {names[0]: PROBE_RELAXING_SHARE, names[1]: time},
                                     sign=1, exact=law != "elastic", idle=(names[1],)))
    return tuple(proposals)


def times(situation: Situation) -> list[float]:
    """Relaxation times (s): the frame interval, a tenth and a third of the test, three times the test."""
    interval = float(np.median(np.diff(situation.experiment.model.times)))
    duration = situation.duration
    grid = [interval, duration / 10.0, duration / 3.0, 3.0 * duration]
    return [t for k, t in enumerate(grid) if all(t > 1.5 * earlier for earlier in grid[:k])]


def _is_off(situation: Situation, name: str, i: int) -> bool:
    return 0.0 in (situation.values[f"{name}.g_{i}"], situation.values[f"{name}.tau_{i}"]) \
        and f"{name}.g_{i}" not in situation.experiment.model.parameters.free


register(Candidate(
    "viscoelasticity", "rate", "Prony viscoelasticity", "no branch that relaxes (g = 0)",
    rivals={"creep": "the same while a load is held; only creep stays after unloading",
            "rate_dependence": "both relax; beyond a yield stress only",
            "thermal_expansion": "a warming specimen between grips loses force",
            "force_drift": "a force that falls with time",
            "frame_time_offset": "images that lag behind the force"},
    separating_tests=("hold the motion once", "repeat at another speed", "unload to zero and wait"),
    variants=variants,
    paraphrase="a stiffness that relaxes with time"))
