"""A force that is wrong by a factor: the load cell's calibration, the thickness, half a specimen.

Where the simulation is driven by motions alone, a factor of the force is a factor of all moduli: an exact twin that no
recording of this test can tell apart; the visibility of the column says so.
"""

from __future__ import annotations

from idic.diagnose.screen.candidate import Candidate, Situation, Variant, register
from idic.diagnose.screen.edits import further_dofs
from idic.model.loads import load_stem

PROBE = 1.02


def variants(situation: Situation) -> tuple[Variant, ...]:
    found = []
    for channel in situation.experiment.channels:
        name = f"channel.{channel.column}.scale"
        if (edits := further_dofs(situation, name)) is not None:
            found.append(Variant(f"scale of {channel.column}", edits, (name,), {name: 1.0}, {name: PROBE},
                                 direct=True))
    for load in situation.experiment.loads:
        name = f"{load_stem(load)}.scale"
        if (edits := further_dofs(situation, name)) is not None:
            found.append(Variant(f"scale of the {load.kind} on {load.edges}", edits, (name,), {name: 1.0},
                                 {name: PROBE}))
    return tuple(found)


register(Candidate(
    "force_scale", "force", "a force that is off by a factor", "a factor of one",
    rivals={"heterogeneity": "a modulus that is off everywhere: with prescribed motions the exact twin",
            "machine_compliance": "both change the slope of force against motion"},
    separates=("hang a dead weight on the load cell", "measure the thickness again",
               "test a reference specimen of known modulus"),
    variants=variants))
