"""A camera whose images show the motion earlier or later than those of the main camera.

The course of the motion of each camera, from the reference on, is what its affine motions add up to, along the
direction of most motion. Both courses are one function of time up to a factor; the offset is where they fit best.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from idic.measure.sequence.frames import FrameSequence
from idic.measure.sequence.thumbnails import motions

MAX_OFFSET_SHARE = 0.4  # of the frames: beyond, too few are left to compare
MAX_OFFSET = 20.0  # frames
MIN_TOLD_OFFSET = 0.1  # frames
MIN_FALL = 0.25  # of the squares about the courses without an offset, which those with it do not exceed
MIN_STDS = 5.0  # of the offset
MIN_FRAMES = 6
MIN_MOTION_PX = 0.5  # of a course
MAX_MISFIT = 0.05  # of a course, by which two courses with their best offset may differ
STEP = 0.02  # frames


def late_cameras(sequences: Sequence[FrameSequence]) -> list[str]:
    """Sentences on the cameras that are late against the first, with the lines that say so."""
    if len(sequences) < 2 or len(sequences[0].frames) < MIN_FRAMES:
        return []
    main, texts = sequences[0], []
    course = _course(main)
    for sequence in sequences[1:]:
        offset = frame_offset(course, _course(sequence)) if sequence.frames == main.frames else None
        if offset is not None:
            texts.append(_sentence(main, sequence, *offset))
    return texts


def frame_offset(course: np.ndarray, other: np.ndarray) -> tuple[float, float] | None:
    """How many frames later than the first the other course has its images, and the standard deviation; None where
    both fit without an offset, or with none.

    course, other : (n,) px
    """
    if not (np.isfinite(course).all() and np.isfinite(other).all()) or min(np.ptp(course), np.ptp(other)) < MIN_MOTION_PX:
        return None
    n, largest = len(course), min(MAX_OFFSET, MAX_OFFSET_SHARE * len(course))
    offsets = np.arange(-largest, largest + STEP, STEP)
    misfits = np.array([_misfit(course, other, offset) for offset in offsets])
    best = int(np.argmin(misfits))
    least = max(float(misfits[best]), 1e-12)
    if not MIN_TOLD_OFFSET < abs(offsets[best]) < largest - STEP or least > MIN_FALL * _misfit(course, other, 0.0):
        return None
    if np.sqrt(least) > MAX_MISFIT * np.ptp(other):
        return None
    curvature = (misfits[best - 1] - 2.0 * least + misfits[best + 1]) / STEP**2
    std = float(np.sqrt(2.0 * least / max(n - 2, 1) / max(curvature, 1e-12)))
    return (float(offsets[best]), std) if abs(offsets[best]) > MIN_STDS * std else None


def _misfit(course: np.ndarray, other: np.ndarray, offset: float) -> float:
    """Mean square of what the course at other times, times a factor, leaves of the other (px²)."""
    at = np.arange(len(course)) + offset
    inside = (at >= 0.0) & (at <= len(course) - 1.0)
    moved, seen = np.interp(at[inside], np.arange(len(course)), course), other[inside]
    norm = float(moved @ moved)
    factor = float(moved @ seen) / norm if norm > 0.0 else 0.0
    return float(np.mean((seen - factor * moved) ** 2))


def _course(sequence: FrameSequence) -> np.ndarray:
    """The motion since the reference along its main direction  # (n,) px"""
    ways = np.vstack([np.zeros((1, 6)), np.cumsum(motions(sequence.thumbnails), axis=0)])
    if not np.isfinite(ways).all():
        return np.full(len(ways), np.nan)
    reference = sequence.experiment.model.reference
    ways = ways - ways[sequence.frames.index(reference) if reference in sequence.frames else 0]
    return ways @ np.linalg.svd(ways, full_matrices=False)[2][0]


def _sentence(main: FrameSequence, sequence: FrameSequence, offset: float, std: float) -> str:
    recording, model = sequence.experiment.recording, main.experiment.model
    name, interval = recording.camera_name, float(np.median(np.diff(model.times[list(main.frames)])))
    value = f"{offset * interval:.3g}" + (" s" if model.has_times else "")
    late = "an earlier" if offset < 0.0 else "a later"
    text = (f"{name} shows {late} moment than {main.experiment.recording.camera_name} in the image of the same number: "
            f"by {abs(offset):.2f} ± {max(std, 0.01):.2f} frames ({value}), by the motion in both. ")
    whole = int(round(offset))
    if abs(offset) > 1.5:
        text += (f"Pair the images by their time: leave out the first {abs(whole)} of "
                 f"{name if whole < 0 else main.experiment.recording.camera_name} and the last {abs(whole)} of the other "
                 "camera; then ")
        value = f"{(offset - whole) * interval:.3g}"
    return text + f'write [[dof]] name = "{name}.time_offset", value = {value.removesuffix(" s")}'
