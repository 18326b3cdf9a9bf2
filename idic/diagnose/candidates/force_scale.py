"""Force scale error: the load cell's calibration, the thickness, half a specimen.

Where the simulation is driven by motions alone, a factor of the force is a factor of all moduli: the two are exactly
indistinguishable in this test, and the visibility of the column is zero.
"""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import further_dofs
from idic.model import load_stem

PROBE_FORCE_FACTOR = 1.02


def variants(situation: Situation) -> tuple[Variant, ...]:
    found = []
    for channel in situation.experiment.channels:
        name = f"channel.{channel.column}.scale"
        if (edits := further_dofs(situation, name)) is not None:
            found.append(Variant(f"scale of {channel.column}", edits, (name,), {name: 1.0}, {name: PROBE_FORCE_FACTOR},
                                 direct=True))
    for load in situation.experiment.loads:
        name = f"{load_stem(load)}.scale"
        if (edits := further_dofs(situation, name)) is not None:
            found.append(Variant(f"scale of the {load.kind} on {load.edges}", edits, (name,), {name: 1.0},
                                 {name: PROBE_FORCE_FACTOR}))
    return tuple(found)


register(Candidate(
    "force_scale", "force", "force scale error", "a factor of one",
    rivals={"heterogeneity": "a modulus that is off everywhere: with prescribed motions exactly indistinguishable",
            "machine_compliance": "both change the slope of force against motion"},
    separating_tests=("hang a dead weight on the load cell", "measure the thickness again",
               "test a reference specimen of known modulus"),
    variants=variants,
    paraphrase="a force reading that is off by a factor"))
