"""The residual of the last frame at the accepted point of a RUN that may be at work."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idic.correlation import view_of
from idic.identification import AcceptedPoint
from idic.report import residual_png
from idic.run.prepared.context import RunContext, correlation_context, open_run
from idic.run.store.arrays import FrameArrays
from idic.run.store.layout import BASE, group_name
from idic.run.store.state_file import load_state
from idic.run.store.system_store import load_evaluation


@dataclass(frozen=True)
class AcceptedResidual:
    """evaluation, frame : which; chi2 : per pixel, None where the noise is not known; picture : a PNG"""

    evaluation: int
    frame: int
    chi2: float | None
    picture: bytes


def accepted_residual(run: Path) -> AcceptedResidual | None:
    """The residual at the accepted point of a RUN; None before there is one."""
    state = load_state(run)
    if state is None or state.accepted is None:
        return None
    context = open_run(str(run))
    frame = context.experiment.model.n_frames - 1
    image, chi2 = _residual(context, state.accepted, frame)
    std = context.experiment.recording.noise.std_gv or float(np.nanstd(image)) or 1.0
    return AcceptedResidual(state.accepted.number, frame, chi2, residual_png(image, std))


def _residual(context: RunContext, accepted: AcceptedPoint, frame: int) -> tuple[np.ndarray, float | None]:
    """Residual of a frame in the reference image (NaN where there is none), and its chi² per pixel."""
    number, values = accepted.number, accepted.values
    shared = correlation_context(context, context.experiment.model.parameters.with_values(values)).cameras[0]
    experiment = shared.experiment
    system = load_evaluation(context.store, number, context.names).system
    brightness = next((record.brightness_of(0) for record in system.frames if record.frame == frame), np.zeros(0))
    base, first = context.store.group(group_name(number, BASE)), context.experiment.model.reference
    u = experiment.model.turned(FrameArrays.open(base, "u").read(frame - first, frame - first + 1)[0])
    motion = view_of(experiment, shared.camera).at(frame).motion(experiment.model.mesh.nodes, u)
    compared = shared.reference.compare_pixels(experiment, frame, motion, brightness)
    image = shared.reference.pixel_map.to_image(np.where(compared.valid, compared.r, np.nan))
    std = experiment.recording.noise.std_gv
    chi2 = compared.chi2_dof(std) if std else float("nan")
    return image, float(chi2) if np.isfinite(chi2) else None
