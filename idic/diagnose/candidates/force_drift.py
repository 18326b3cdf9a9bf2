"""Force drift: a warming load cell, a slow amplifier."""

from __future__ import annotations

from idic.diagnose.screen.candidate import Candidate, Situation, Variant, register
from idic.diagnose.screen.edits import further_dofs

PROBE_FORCE_SHARE = 0.05  # of the largest force, over the test

def variants(situation: Situation) -> tuple[Variant, ...]:
    if not situation.experiment.extras.get("has_times", True):
        return ()
    found = []
    for channel in situation.experiment.channels:
        name = f"channel.{channel.column}.drift"
        if (edits := further_dofs(situation, name)) is not None:
            found.append(Variant(f"drift of {channel.column}", edits, (name,), {name: 0.0},
                                 {name: PROBE_FORCE_SHARE * float(abs(channel.values).max()) / situation.duration}, direct=True))
    return tuple(found)


register(Candidate(
    "force_drift", "force", "force drift", "a drift of zero",
    rivals={"force_offset": "both are there at zero load: one from the start, one growing",
            "viscoelasticity": "both let the force go down while the motion is held",
            "creep": "both let the force go down while the motion is held",
            "thermal_expansion": "a temperature that rises with time strains a held specimen"},
    separating_tests=("record the force at zero load, before and after", "repeat the test at another speed"),
    variants=variants,
    paraphrase="a force reading that drifts with time"))
