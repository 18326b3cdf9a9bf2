"""What the page shows of the accepted point of a RUN: channels, and the residual map of one frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from idic.correlation.view import view_of
from idic.draw.pictures import png
from idic.draw.watch import has_accepted
from idic.identify.step.state import LoopState
from idic.run.context import RunContext, correlation_context, open_run
from idic.run.postprocess import channel_table
from idic.store.arrays import FrameArrays
from idic.store.layout import BASE, group_name
from idic.store.state_file import load_state
from idic.store.system_store import load_evaluation

MAX_MAP_PX = 900  # width of a residual map in the page
RANGE = 4.0  # standard deviations of the noise: full colour


@dataclass(frozen=True)
class Point:
    """What the page shows of an accepted point: channels, and the residual of one frame."""

    evaluation: int
    frame: int
    channels: list[dict]
    chi2: float | None
    picture: bytes
    box: tuple[int, int, int, int]  # of the picture in the image, px


def accepted_point(run: Path, frame: int | None = None) -> Point | None:
    """The accepted point of a RUN at a frame (None: the last one); None before there is one."""
    state = load_state(run)
    return _point(open_run(str(run)), state, frame) if has_accepted(state) else None


def _point(context: RunContext, state: LoopState, frame: int | None) -> Point:
    experiment = context.experiment
    last = experiment.n_frames - 1
    k = last if frame is None else int(np.clip(frame, min(experiment.reference + 1, last), last))
    simulated, measured = channel_table(context, state.accepted.values, state.accepted.number)
    channels = [{"name": channel.column, "simulated": _finite(simulated[:, i] / channel.shown_factor),
                 "measured": _finite(measured[:, i] / channel.shown_factor)}
                for i, channel in enumerate(experiment.channels)]
    image, chi2 = _residual(context, state, k)
    picture, box = _coloured(image, experiment.noise.std_gv or float(np.nanstd(image)) or 1.0)
    return Point(state.accepted.number, k, channels, chi2, picture, box)


def _residual(context: RunContext, state: LoopState, frame: int) -> tuple[np.ndarray, float | None]:
    """Residual of a frame in the reference image (NaN where there is none), and its chi² per pixel."""
    number, values = state.accepted.number, state.accepted.values
    shared = correlation_context(context, context.experiment.parameters.with_values(values)).cameras[0]
    experiment = shared.experiment
    system = load_evaluation(context.store, number, context.names).system
    brightness = next((record.brightness_of(0) for record in system.frames if record.frame == frame), np.zeros(0))
    base, first = context.store.group(group_name(number, BASE)), context.experiment.reference
    u = experiment.turned(FrameArrays.open(base, "u").read(frame - first, frame - first + 1)[0])
    motion = view_of(experiment, shared.camera).at(frame).motion(experiment.mesh.nodes, u)
    found = shared.reference.compare_pixels(experiment, frame, motion, brightness)
    image = shared.reference.pixel_map.to_image(np.where(found.valid, found.r, np.nan))
    std = experiment.noise.std_gv
    chi2 = found.chi2_dof(std) if std else float("nan")
    return image, float(chi2) if np.isfinite(chi2) else None


def _coloured(image: np.ndarray, std: float) -> tuple[bytes, tuple[int, int, int, int]]:
    """The residual as a PNG, blue below and red above zero, and the part of the image that it covers."""
    seen = np.isfinite(image)
    if not seen.any():
        return png(np.zeros((1, 1, 4), dtype=np.uint8)), (0, 0, 1, 1)
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    y0, y1, x0, x1 = int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1
    part, seen = np.nan_to_num(image[y0:y1, x0:x1]).astype(np.float32), seen[y0:y1, x0:x1].astype(np.float32)
    if part.shape[1] > MAX_MAP_PX:
        size = (MAX_MAP_PX, max(round(part.shape[0] * MAX_MAP_PX / part.shape[1]), 1))
        part, seen = (cv2.resize(a, size, interpolation=cv2.INTER_AREA) for a in (part, seen))
    scaled = np.clip(part / (RANGE * std), -1.0, 1.0)
    low, high = np.clip(-scaled, 0, 1), np.clip(scaled, 0, 1)
    blue, green, red = 1.0 - high, 1.0 - 0.8 * (low + high), 1.0 - low
    colours = np.stack([blue, green, red, seen], axis=-1)
    return png(np.round(255 * np.clip(colours, 0, 1)).astype(np.uint8)), (x0, y0, x1, y1)


def _finite(values: np.ndarray) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]

