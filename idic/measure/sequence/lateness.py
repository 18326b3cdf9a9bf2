"""A camera whose images show the motion earlier or later than those of the main camera.

The course of the motion of each camera, from the reference on, is what its affine motions add up to, along the
direction of most motion. Both courses are one function of time up to a factor; the offset is where they fit best.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from idic.errors import InputError
from idic.measure.sequence.thumbnails import Thumbnail, motions

MAX_OFFSET_SHARE, MAX_OFFSET = 0.4, 20.0  # of the frames, and frames: beyond, too few are left to compare
MIN_TOLD_OFFSET = 0.1  # frames
MIN_FALL = 0.25  # of the squares about the courses without an offset, which those with it do not exceed
MIN_STDS = 5.0  # of the offset
MIN_FRAMES = 6
MIN_MOTION_PX = 0.5  # of a course
MAX_MISFIT = 0.05  # of a course, by which two courses with their best offset may differ
STEP = 0.02  # frames
MAX_LATE = 1.5  # frames: a time offset looks one frame back or forth, along a straight line


def frame_offset(course: np.ndarray, second: np.ndarray,
                 places: np.ndarray | None = None) -> tuple[float, float] | None:
    """How many frames later than the first course the second has its images, and the standard deviation; None where
    both fit without an offset, or with none.

    course, second : (n,) px; places : (n,) numbers of their frames in the whole sequence, None: all of it
    """
    n, places = len(course), np.arange(float(len(course))) if places is None else np.asarray(places, float)
    if n < MIN_FRAMES or not np.isfinite([course, second]).all() or min(np.ptp(course), np.ptp(second)) < MIN_MOTION_PX:
        return None
    largest = min(MAX_OFFSET, MAX_OFFSET_SHARE * (places[-1] - places[0] + 1.0))
    offsets = np.arange(-largest, largest + STEP, STEP)
    misfits = np.array([_misfit(course, second, places, offset) for offset in offsets])
    best = int(np.argmin(misfits))
    least = max(float(misfits[best]), 1e-12)
    together = _misfit(course, second, places, 0.0)
    if not MIN_TOLD_OFFSET < abs(offsets[best]) < largest - STEP or least > MIN_FALL * together:
        return None
    if np.sqrt(least) > MAX_MISFIT * np.ptp(second):
        return None
    curvature = (misfits[best - 1] - 2.0 * least + misfits[best + 1]) / STEP**2
    std = float(np.sqrt(2.0 * least / max(n - 2, 1) / max(curvature, 1e-12)))
    return (float(offsets[best]), std) if abs(offsets[best]) > MIN_STDS * std else None


def course_of(thumbnails: Sequence[Thumbnail], reference: int) -> np.ndarray:
    """The motion since the reference along its main direction  # (n,) px"""
    ways = np.vstack([np.zeros((1, 6)), np.cumsum(motions(thumbnails), axis=0)])
    if not np.isfinite(ways).all():
        return np.full(len(ways), np.nan)
    ways = ways - ways[reference]
    return ways @ np.linalg.svd(ways, full_matrices=False)[2][0]


def sentence(names: tuple[str, str], offset: float, std: float, interval_s: float | None) -> str:
    """That a camera is late, with the line to write.

    names : of the main camera and of this one; offset, std : frames; interval_s : time between frames, None: not known
    """
    main, name = names
    unit, interval = (" s", interval_s) if interval_s else ("", 1.0)
    text = (f"{name} shows {'an earlier' if offset < 0.0 else 'a later'} moment than {main} in the image of the same "
            f"number: by {abs(offset):.2f} ± {max(std, 0.01):.2f} frames ({offset * interval:.3g}{unit}), by the "
            "motion in both. ")
    return text + f'write [[dof]] name = "{name}.time_offset", value = {offset * interval:.3g}'


def check_pairing(names: tuple[str, str], files: tuple[Sequence[str], Sequence[str]], offset: float,
                  std: float) -> None:
    """InputError where images of the same number were taken more than `MAX_LATE` frames apart: the motion between two
    frames, which a time offset interpolates, is not that of such a pair.

    names : of the main camera and of this one; files : their images, as many of each
    """
    n_images, error = round(abs(offset)), max(std, 0.01)
    if abs(offset) <= MAX_LATE:
        return
    first, second = (1, 0) if offset < 0.0 else (0, 1)  # whose first images, and whose last ones, have no partner
    early, late = files[first][:n_images], files[second][len(files[second]) - n_images:]
    raise InputError(
        f"images of {names[0]} and {names[1]} of the same number show different moments", key="camera.images",
        expected=f"images of one moment, or less than {MAX_LATE:g} frames apart",
        found=f"{names[1]} shows a moment {abs(offset):.2f} ± {error:.2f} frames "
              f"{'earlier' if offset < 0.0 else 'later'} in the image of the same number, by the motion in both",
        remedy=f"shift the images of {names[1]} by {n_images}: leave out {_listed(early)} of {names[first]} and "
               f"{_listed(late)} of {names[second]}, with the rows of the log that belong to images of {names[0]} that "
               f"are left out; then check again. If the cameras did see different motions, write [[dof]] name = "
               f'"{names[1]}.time_offset"')


def _listed(labels: Sequence[str]) -> str:
    return labels[0] if len(labels) == 1 else f"{labels[0]} to {labels[-1]}"


def _misfit(course: np.ndarray, second: np.ndarray, places: np.ndarray, offset: float) -> float:
    """Mean square of what the course at other times, times a factor, leaves of the second (px²)."""
    at = places + offset
    inside = (at >= places[0]) & (at <= places[-1])
    moved, target = np.interp(at[inside], places, course), second[inside]
    norm = float(moved @ moved)
    factor = float(moved @ target) / norm if norm > 0.0 else 0.0
    return float(np.mean((target - factor * moved) ** 2))
