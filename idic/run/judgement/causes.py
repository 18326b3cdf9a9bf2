"""The cause of the misfit of a RUN by the table of causes (a task)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from idic.correlation import view_of
from idic.measure import Seen
from idic.report import cause_after_run
from idic.run.judgement.floor import PointJob
from idic.run.prepared.context import RunContext, correlation_context, open_run
from idic.run.store.arrays import FrameArrays
from idic.run.store.layout import BASE, group_name


def cause_of_misfit(job: PointJob) -> dict | None:
    """What stands between recording and model at an accepted point, as the measured motion shows it: the entry
    ``residual.cause`` of result.json."""
    context = open_run(job.run)
    shared = correlation_context(context, context.experiment.model.parameters.with_values(job.values))
    cause = cause_after_run([(camera.experiment, _motion(context, job.evaluation, camera.experiment, camera.camera),
                              Seen.by(camera.experiment, camera.reference.image)) for camera in shared.cameras])
    return None if cause is None else cause.entry()


def _motion(context: RunContext, evaluation: int, experiment, camera) -> Callable[[int], np.ndarray]:
    """Frame -> simulated motion of the nodes in the image of a camera, NaN before the reference  # (n_nodes, 2) px"""
    view, nodes = view_of(experiment, camera), experiment.model.mesh.nodes
    reference = context.experiment.model.reference
    stored = FrameArrays.open(context.store.group(group_name(evaluation, BASE)), "u")

    def motion(frame: int) -> np.ndarray:
        k = frame - reference
        if k < 0:
            return np.full((len(nodes), 2), np.nan)
        return view.at(frame).motion(nodes, experiment.model.turned(stored.read(k, k + 1)[0]))[:, :2]

    return motion
