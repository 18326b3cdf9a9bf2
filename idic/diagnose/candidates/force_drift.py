"""Force drift: a warming load cell, a slow amplifier; from the start, or from a later moment on."""

from __future__ import annotations

import copy

import numpy as np

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import further_dofs

PROBE_FORCE_SHARE = 0.05  # of the largest force, over the test
ONSETS = (0.2, 0.35, 0.5, 0.65, 0.8)  # of the test, of a drift that begins late


def variants(situation: Situation) -> tuple[Variant, ...]:
    if not situation.experiment.extras.get("has_times", True):
        return ()
    found = []
    first = float(situation.experiment.times[situation.experiment.reference])
    for number, channel in enumerate(situation.experiment.channels):
        name = f"channel.{channel.column}.drift"
        if (edits := further_dofs(situation, name)) is None:
            continue
        size = PROBE_FORCE_SHARE * float(abs(channel.values).max())
        found.append(Variant(f"drift of {channel.column}", edits, (name,), {name: 0.0},
                             {name: size / situation.duration}, direct=True))
        for onset in ONSETS:
            start = float(np.round(first + onset * situation.duration, 9))
            found.append(Variant(f"drift of {channel.column} from {start:.4g} s on",
                                 edits | {"channel": _from(situation, number, start)}, (name,), {name: 0.0},
                                 {name: size / ((1.0 - onset) * situation.duration)}, direct=True))
    return tuple(found)


def _from(situation: Situation, number: int, start: float) -> list[dict]:
    """The channels of the file, one of which drifts from a time (s) on."""
    tables = copy.deepcopy(list(situation.document["channel"]))
    tables[number]["drift_from_s"] = start
    return tables


register(Candidate(
    "force_drift", "force", "force drift", "a drift of zero",
    rivals={"force_offset": "both are present at zero load: one is constant, one grows",
            "viscoelasticity": "both let the force go down while the motion is held",
            "creep": "both let the force go down while the motion is held",
            "thermal_expansion": "a temperature that rises with time strains a held specimen"},
    separating_tests=("record the force at zero load, before and after", "repeat the test at another speed"),
    variants=variants,
    paraphrase="a force reading that drifts with time, from the start or later"))
