"""Friction in the load train: the load cell shows more on the way up and less on the way back."""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import further_dofs
from idic.model import way_of

PROBE_SHARE = 0.02  # of the largest force, or of the force


def variants(situation: Situation) -> tuple[Variant, ...]:
    way = way_of(situation.experiment.prescribed)
    if way is None or len(set(way) - {0.0}) < 2:
        return ()  # without a way back friction is a part of the force
    found = []
    for channel in (one for one in situation.experiment.channels if one.kind == "reaction"):
        stem = f"channel.{channel.column}"
        for name, how, size in ((f"{stem}.friction", "constant friction", PROBE_SHARE * channel.largest),
                                (f"{stem}.friction_share", "friction in proportion to the force", PROBE_SHARE)):
            if (edits := further_dofs(situation, name)) is not None:
                found.append(Variant(f"{how} in {channel.column}", edits, (name,), {name: 0.0}, {name: size}, sign=1,
                                     direct=True))
    return tuple(found)


register(Candidate(
    "friction", "force", "friction in the load train", "no friction",
    rivals={"viscoelasticity": "hysteresis of force over motion: friction does not depend on the speed and does not "
                               "relax",
            "plasticity": "hysteresis of force over motion: friction leaves no strain",
            "frame_time_offset": "a force that lags behind the motion",
            "force_offset": "both are present at zero load; friction changes sign with the direction of motion"},
    separating_tests=("stop and reverse slightly: friction reverses the force at once", "repeat at another speed",
                      "mount the load cell next to the specimen, before guides and seals"),
    variants=variants,
    paraphrase="hysteresis of the force that changes sign with the direction of motion"))
