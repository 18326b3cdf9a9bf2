"""The length of the baseline of a rig that points of known distance ask for.

A target of another size than stated scales all lengths of a calibration, and with them the distance of its cameras;
each camera by itself looks right. Points of the specimen seen by both measure it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from idic.errors import InputError
from idic.experiment_file.pinhole.clicks import Clicks
from idic.images import rotation_of

_SIGNIFICANCE = 1e-3     # of a better fit by a longer or shorter baseline
_MAX_FACTOR = 10.0       # either way: beyond, something else is wrong
_MIN_DIFFERENCE = 0.01   # of a target: measured with a ruler, it is known better
_MIN_CAMERAS = 2
_BEHIND_PX = 1e6         # residual of points behind a camera

Pose = tuple[np.ndarray, np.ndarray]


def other_baseline(clicks: Sequence[Clicks], starts: Sequence[Pose], error_px: float) -> str | None:
    """What a baseline of another length says of the target, where the clicks fit it and not the calibration.

    starts : poses (rotation, translation in mm) of the points in the frame of the rig, of every camera alone
    error_px : rms distance of the clicks from the best pose with the baseline of the calibration

    Returns
    -------
    A sentence with the factor, its standard deviation and the remedy; None where no other length fits better.
    """
    length = max(float(np.linalg.norm(c.camera.translation_mm)) for c in clicks)
    if len(clicks) < _MIN_CAMERAS or length == 0.0:
        return None
    fits = [fit for start in starts if (fit := _fitted(clicks, start)) is not None]
    if not fits:
        return None
    fit = min(fits, key=lambda result: float(result.cost))
    squares, n = 2.0 * float(fit.cost), len(fit.fun)
    freedom = n - len(fit.x)
    factor = float(np.exp(fit.x[-1]))
    if freedom < 1 or not 1.0 / _MAX_FACTOR < factor < _MAX_FACTOR or abs(factor - 1.0) < _MIN_DIFFERENCE:
        return None
    variance = squares / freedom
    ratio = max(error_px**2 * n / 2.0 - squares, 0.0) / max(variance, 1e-300)
    if not scipy.stats.f.sf(ratio, 1, freedom) < _SIGNIFICANCE:
        return None
    std = factor * float(np.sqrt(variance * np.linalg.inv(fit.jac.T @ fit.jac)[-1, -1]))
    return (f"a baseline {factor:.4g} ± {std:.1g} times as long fits the clicked points within "
            f"{np.sqrt(2.0 * squares / n):.2f} px (rms): the target of the calibration was {factor:.4g} times as large "
            "as stated, or points_mm are in another unit. Calibrate again with its measured spacing (--spacing), or "
            f"multiply the translation of the calibration by {factor:.4g}")


def _fitted(clicks: Sequence[Clicks], start: Pose):
    """Least squares over a pose in the frame of the rig and the logarithm of the factor; None behind a camera."""
    rotation, shift = start
    pivot = np.concatenate([c.points_mm for c in clicks]).mean(axis=0)
    seen_px = np.concatenate([c.points_px.ravel() for c in clicks])

    def residual(unknowns: np.ndarray) -> np.ndarray:
        turn, factor, parts = rotation @ rotation_of(unknowns[:3]), np.exp(unknowns[6]), []
        try:
            for c in clicks:
                camera = replace(c.camera, translation_mm=factor * c.camera.translation_mm)
                space = (c.points_mm - pivot) @ turn.T + rotation @ pivot + shift + unknowns[3:6]
                parts.append(camera.project(space).ravel())
        except InputError:
            return np.full(len(seen_px), _BEHIND_PX)
        return np.concatenate(parts) - seen_px

    if np.abs(residual(np.zeros(7))).max() >= _BEHIND_PX:
        return None
    return scipy.optimize.least_squares(residual, np.zeros(7), x_scale="jac", max_nfev=200)
