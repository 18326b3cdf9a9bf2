"""Seating: grips and couplings settle under the first load, so the log begins with a toe."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import channel_unit, driven, with_correction

SEATED_SHARES = (0.05, 0.15, 0.4)  # of the largest force: all but 1/e of the way is gone
PROBE_PX = 0.2


def variants(situation: Situation) -> tuple[Variant, ...]:
    experiment = situation.experiment
    found = []
    for number, nodes, component, drive in driven(situation):
        if "column" not in drive or any(entry["kind"] == "seating" for entry in drive.get("corrections", ())):
            continue
        for force in (c for c in experiment.channels if c.kind == "reaction" and c.component == component):
            size, name = float(np.abs(force.values).max()), f"boundary.{nodes}.{component}.seating"
            for share in SEATED_SHARES if size else ():
                edits = with_correction(situation, number, component,
                                        {"kind": "seating", "column": force.column, "seated_at": share * size}
                                        | channel_unit(situation, force.column))
                found.append(Variant(_label(nodes, share * size, force.unit), edits, (name,),
                                     {name: 0.0}, {name: PROBE_PX * experiment.camera.pixel_size}, sign=1, exact=True))
    return tuple(found)


def _label(nodes: str, seated_at: float, unit: str) -> str:
    return f"{nodes} settles under the first {seated_at:.3g} {unit}"


def rescaled(variant: Variant, factor: float) -> Variant:
    """The same grip, settled under another force."""
    (name,), tables = variant.new, copy.deepcopy(list(variant.edits["boundary"]))
    label = variant.label
    for table in tables:
        for component in "xyz":
            if name == f"boundary.{table.get('nodes')}.{component}.seating":
                own = next(entry for entry in table[f"u{component}"]["corrections"] if entry["kind"] == "seating")
                own["seated_at"] *= factor
                label = _label(table["nodes"], own["seated_at"], variant.label.rpartition(" ")[2])
    return replace(variant, label=label, edits=variant.edits | {"boundary": tables})


register(Candidate(
    "seating", "boundary", "machine seating", "no displacement lost under the first load",
    rivals={"machine_compliance": "a motion that is missing in proportion to the force, also at high load",
            "grip_slip": "a permanently missing motion",
            "force_offset": "both shift the beginning of the force",
            "nonlinear_elasticity": "a stiffness that rises with the load"},
    separating_tests=("load to a tenth and unload a few times before the test",
                      "measure the motion at the specimen: `measured` in [[boundary]]"),
    variants=variants,
    rescaled=rescaled,
    paraphrase="a toe: grips and couplings settle under the first load"))
