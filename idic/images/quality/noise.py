"""Grey-value noise of a camera, from images in which nothing moves or, failing these, from one image.

Every chi^2 and every error bar is in units of the noise sigma of one image: still frames give it best (docs/method.md,
equation 11.5).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from idic.errors import InputError

_WHITE_QUANTILE = 0.2  # of the blocks of an image, ordered by their fourth differences: the smoothest ones
# 4th difference in both directions: zero for any texture that is a cubic over 5 px
_FOURTH_DIFFERENCE = np.array([1.0, -4.0, 6.0, -4.0, 1.0])


@dataclass(frozen=True)
class NoiseEstimate:
    """Standard deviation of one image's noise (GV), and where it comes from."""

    std_gv: float
    source: str  # still_frames | one_image


@dataclass(frozen=True)
class NoiseModel:
    """Variance that may depend on the grey value: ``variance = offset + slope * grey`` (read-out and shot noise).

    offset : GV^2.  slope : GV (0 for noise that does not depend on the intensity).
    """

    offset: float
    slope: float = 0.0

    def variance(self, grey: np.ndarray) -> np.ndarray:
        """Variance at grey values (shape kept), never below a hundredth of its mean."""
        value = self.offset + self.slope * np.asarray(grey, dtype=float)
        return np.maximum(value, 0.01 * max(float(np.mean(value)), np.finfo(float).tiny))

    @classmethod
    def of(cls, images: Sequence[np.ndarray], mask: np.ndarray | None = None, n_bins: int = 16) -> NoiseModel:
        """Intensity-dependent noise from still frames: variance against grey value in bins of equal population."""
        pairs = _differences(images, mask)
        grey, square = np.concatenate([g for _, g in pairs]), np.concatenate([d**2 / 2.0 for d, _ in pairs])
        order = np.argsort(grey, kind="stable")
        level = np.array([chunk.mean() for chunk in np.array_split(grey[order], n_bins)])
        variance = np.array([chunk.mean() for chunk in np.array_split(square[order], n_bins)])
        if np.ptp(level) == 0 or not variance.any():
            return cls(float(variance.mean()))
        weight = 1.0 / np.maximum(variance, 1e-3 * variance.mean())  # the scatter of a variance is proportional to it
        slope, offset = np.polyfit(level, variance, 1, w=weight)
        return cls(float(offset), float(slope))


def still_noise(images: Sequence[np.ndarray], mask: np.ndarray | None = None) -> NoiseEstimate:
    """Noise of one image from two or more images of the specimen at rest.

    Half the mean square of the difference of consecutive images, after a change of
    brightness (gain, offset) and a shift by a fraction of a pixel (vibration) are fitted out by least squares.

    Parameters
    ----------
    images : sequence of arrays (ny, nx)
    mask : array (ny, nx), bool, optional
        Pixels to use; those without a value (gaps of height images) are left out anyway.

    Raises
    ------
    InputError
        With fewer than two images, images of different size, or an empty mask.
    """
    pairs = _differences(images, mask)
    variance = float(np.mean([np.mean(difference**2) / 2.0 for difference, _ in pairs]))
    return NoiseEstimate(float(np.sqrt(variance)), "still_frames")


def image_noise(image: np.ndarray, mask: np.ndarray | None = None, block: int = 16) -> NoiseEstimate:
    """Noise from one image: fourth differences, in the smoothest blocks.

    An upper bound where the speckle is fine (features below about 5 px leave a trace in fourth differences everywhere):
    a fallback for a first look, not a basis for error bars.

    Raises
    ------
    InputError
        Where fewer than two blocks fit in the image or the mask.
    """
    image = np.asarray(image, dtype=float)
    kernel = _FOURTH_DIFFERENCE / np.sqrt((_FOURTH_DIFFERENCE**2).sum())
    rows = sum(w * image[i : image.shape[0] - 4 + i] for i, w in enumerate(kernel))
    fourth_differences = sum(w * rows[:, j : rows.shape[1] - 4 + j] for j, w in enumerate(kernel))
    usable = np.ones(fourth_differences.shape, dtype=bool) if mask is None else np.asarray(mask, dtype=bool)[2:-2, 2:-2]
    ny, nx = (n // block for n in fourth_differences.shape)
    cut = (slice(0, ny * block), slice(0, nx * block))
    square = (fourth_differences[cut] ** 2).reshape(ny, block, nx, block).mean(axis=(1, 3))
    full_blocks = usable[cut].reshape(ny, block, nx, block).all(axis=(1, 3))
    if np.count_nonzero(full_blocks) < 2:
        raise InputError("too little of the image to estimate its noise",
                         expected=f"two blocks of {block} x {block} px", remedy="give camera.noise_std_gv")
    variance = float(np.quantile(square[full_blocks], _WHITE_QUANTILE)) / _white_quantile(block)
    return NoiseEstimate(float(np.sqrt(variance)), "one_image")


def _white_quantile(block):
    """The quantile of the block mean of white noise of variance 1 after the filter (normal approximation)."""
    correlation = np.correlate(_FOURTH_DIFFERENCE, _FOURTH_DIFFERENCE, "full") / (_FOURTH_DIFFERENCE**2).sum()
    independent = block**2 / (correlation**2).sum() ** 2  # effective number of squares in the mean
    return 1.0 - 0.8416 * np.sqrt(2.0 / independent)  # 0.8416: normal quantile of 0.2


def _differences(images, mask):
    """(difference freed of brightness and shift, mean of the two) of consecutive images, masked pixels only."""
    if len(images) < 2:
        raise InputError("noise from still frames needs two or more images", expected="2 or more", found=len(images),
                         remedy="name further images taken at rest")
    shapes = {np.shape(image) for image in images}
    if len(shapes) > 1:
        raise InputError("still frames of different size", found=", ".join(map(str, shapes)),
                         remedy="name images of one size")
    keep = np.ones(shapes.pop(), dtype=bool) if mask is None else np.asarray(mask, dtype=bool)
    if np.count_nonzero(keep) < 100:
        raise InputError("too few pixels to estimate the noise", expected=">= 100 px",
                         found=int(np.count_nonzero(keep)), remedy="give camera.noise_std_gv")
    pairs = []
    for first, second in pairwise(images):
        mean = (np.asarray(first,
                           dtype=float) + second) / 2.0  # its noise is not correlated with that of the difference
        slopes = np.gradient(mean)
        usable = keep & np.isfinite(slopes[0]) & np.isfinite(slopes[1]) & np.isfinite(mean)  # height images have gaps
        if np.count_nonzero(usable) < 100:
            raise InputError("too few pixels with a value to estimate the noise", expected=">= 100 px",
                             found=int(np.count_nonzero(usable)), remedy="give camera.noise_std_gv")
        grey = mean[usable]
        columns = np.stack([np.ones(len(grey)), grey - grey.mean(), slopes[0][usable], slopes[1][usable]], axis=1)
        difference = (np.asarray(first, dtype=float) - second)[usable]
        fit = np.linalg.lstsq(columns.T @ columns, columns.T @ difference, rcond=None)[0]
        pairs.append((difference - columns @ fit, grey))
    return pairs
