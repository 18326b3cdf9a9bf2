"""Noise of the points of every image by itself, and points that lie outside it.

Both are judged about the best lens and pose for the image alone, so that errors common to a view (focus, a camera that
is late) are not in them: these are smooth over the image, a badly found point is not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import polygamma
from scipy.stats import chi2

from idic.calibrate.projection import N_POSE, n_cameras_unknowns
from idic.calibrate.records import Lens, SIGNIFICANCE

OUTLIER = 6.0               # robust standard deviations: no Gaussian error of a point in any calibration
_RANK = 1e-5                # of the largest singular value: unknowns that a single image does not determine

Image = tuple[int, int]  # number of the view, number of the camera


@dataclass(frozen=True, eq=False)
class Linear:
    """Linearised equations of one image.

    Attributes
    ----------
    shared : array (2 n, m)
        Derivatives of the projected coordinates by the unknowns of cameras and target.
    pose : array (2 n, 6)
        By the pose of the view.
    errors_px : array (2 n,)
        Seen minus projected.
    """

    shared: np.ndarray
    pose: np.ndarray
    errors_px: np.ndarray

    def of_points(self, chosen: np.ndarray) -> Linear:
        """The equations of some of the points  # bool (n,)"""
        rows = np.repeat(chosen, 2)
        return Linear(self.shared[rows], self.pose[rows], self.errors_px[rows])


def lens_columns(camera: int, lens: Lens) -> slice:
    """The unknowns of a camera's lens among those of all cameras."""
    first = n_cameras_unknowns(camera, lens) + (N_POSE if camera == 0 else 0)
    return slice(first, first + len(lens.identified))


def inlying(images: Mapping[Image, Linear], lens: Lens) -> dict[Image, np.ndarray]:
    """Points of every image that lie as close as those of all images, or as those of their own, do  # bool (n,)"""
    residuals = {key: _alone(image, key[1], lens)[0] for key, image in images.items()}
    usual = _deviation(np.concatenate(list(residuals.values())))
    return {key: np.abs(errors).reshape(-1, 2).max(axis=1) <= OUTLIER * max(usual, _deviation(errors))
            for key, errors in residuals.items()}


def image_noise(images: Mapping[Image, Linear], lens: Lens) -> dict[Image, float]:
    """Standard deviation of a coordinate in every image, px: each its own where they differ, else that of all."""
    squares, freedom = {}, {}
    for key, image in images.items():
        errors, rank = _alone(image, key[1], lens)
        squares[key], freedom[key] = max(float(errors @ errors), 1e-30), len(errors) - rank
    usual = float(np.sqrt(sum(squares.values()) / max(sum(freedom.values()), 1)))
    measured = [key for key in images if freedom[key] > 0]
    if not _differ(np.array([squares[key] for key in measured]), np.array([freedom[key] for key in measured])):
        return dict.fromkeys(images, usual)
    return dict(zip(images, _moderated(np.array(list(squares.values())), np.array(list(freedom.values()))).tolist(),
                    strict=True))


def _alone(image: Linear, camera: int, lens: Lens) -> tuple[np.ndarray, int]:
    """Residuals about the best lens and pose for one image alone, and how many unknowns it determines."""
    rows = np.hstack([image.shared[:, lens_columns(camera, lens)], image.pose])
    rows = rows / np.maximum(np.sqrt((rows**2).sum(axis=0)), 1e-300)
    values, _, rank, _ = np.linalg.lstsq(rows, image.errors_px, rcond=_RANK)
    return image.errors_px - rows @ values, int(rank)


def _deviation(errors: np.ndarray) -> float:
    return 1.4826 * float(np.median(np.abs(errors)))


def _differ(squares: np.ndarray, freedom: np.ndarray) -> bool:
    """Whether some images are noisier than others: Bartlett's test (M. S. Bartlett, Proc. R. Soc. A 160, 1937)."""
    if len(freedom) < 2:
        return False
    pooled = float(squares.sum() / freedom.sum())
    statistic = float(freedom.sum() * np.log(pooled) - freedom @ np.log(squares / freedom))
    correction = 1.0 + ((1.0 / freedom).sum() - 1.0 / freedom.sum()) / (3.0 * (len(freedom) - 1))
    return bool(chi2.sf(statistic / correction, len(freedom) - 1) < SIGNIFICANCE)


def _moderated(squares: np.ndarray, freedom: np.ndarray) -> np.ndarray:
    """The noise of every image, drawn towards the usual one by as many coordinates as the scatter of the noises is
    worth, which matters for images of few points (G. K. Smyth, Stat. Appl. Genet. Mol. Biol. 3, 2004).
    """
    is_known = freedom > 0
    logarithms = np.log(squares[is_known] / freedom[is_known])
    excess = max(float(np.var(logarithms, ddof=1) - polygamma(1, freedom[is_known] / 2.0).mean()), 1e-6)
    n_usual = (1.0 + np.sqrt(1.0 + 2.0 * excess)) / excess  # of trigamma(n / 2) = excess, by its series
    usual = float(np.exp(logarithms.mean()))
    variances = (np.where(is_known, squares, 0.0) + n_usual * usual) / (np.maximum(freedom, 0) + n_usual)
    return np.sqrt(variances)
