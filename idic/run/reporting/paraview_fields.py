"""The fields of a finished run for ParaView: displacement of every frame, sensitivities of the one that is shown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from idic.model.experiment import Experiment
from idic.report.record import RunRecord
from idic.run.reporting.paraview import write_collection
from idic.run.tasks import RunContext
from idic.store.layout import BASE, group_name
from idic.store.arrays import FrameArrays


def write_fields(context: RunContext, experiment: Experiment, record: RunRecord, folder: Path) -> None:
    """Write ``fields.pvd`` and its frames on the simulated mesh (mm); nothing where no point was accepted.

    experiment : at the geometry that was identified
    """
    accepted = [entry["evaluation"] for entry in record.result.get("history", ()) if entry["accepted"]]
    if not accepted:
        return
    u = FrameArrays.open(context.store.group(group_name(accepted[-1], BASE)), "u")
    write_collection(folder, experiment.mesh, _frames(experiment, u, record))


def _frames(experiment: Experiment, u: FrameArrays,
            record: RunRecord) -> Iterator[tuple[float, Mapping[str, np.ndarray]]]:
    data, start = record.sensitivities, experiment.reference
    for k in range(u.n_frames):
        fields = {"displacement_mm": u.read(k, k + 1)[0]}
        if data is not None and data.frame == start + k:
            fields |= {f"sensitivity_px_per_{step.replace(' ', '')}_{name}": data.phi_px[i]
                       for i, (name, step) in enumerate(zip(data.names, data.steps, strict=True))}
        yield experiment.times[start + k], fields
