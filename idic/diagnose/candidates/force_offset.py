"""Force offset: a load cell that was not zeroed, the weight of a grip."""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import further_dofs
from idic.model import load_stem

PROBE_FORCE_SHARE = 0.02  # of the largest force


def variants(situation: Situation) -> tuple[Variant, ...]:
    found = []
    for channel in situation.experiment.channels:
        name = f"channel.{channel.column}.offset"
        if (edits := further_dofs(situation, name)) is not None:
            found.append(Variant(f"offset of {channel.column}", edits, (name,), {name: 0.0},
                                 {name: PROBE_FORCE_SHARE * float(abs(channel.values).max())}, direct=True))
    for load in situation.experiment.loads:
        name = f"{load_stem(load)}.offset"
        size = abs(getattr(load.drive, "values", None)).max() if hasattr(load.drive, "values") else 0.0
        if size > 0.0 and (edits := further_dofs(situation, name)) is not None:
            found.append(Variant(f"offset of the {load.kind} on {load.edges}", edits, (name,), {name: 0.0},
                                 {name: PROBE_FORCE_SHARE * float(size)}))
    return tuple(found)


register(Candidate(
    "force_offset", "force", "force offset", "an offset of zero",
    rivals={"force_drift": "both are present at zero load: one is constant, one grows",
            "plasticity": "a force that is missing after unloading"},
    separating_tests=("record the force at zero load, before and after", "unload to zero once"),
    variants=variants,
    paraphrase="a force reading that is off by a constant"))
