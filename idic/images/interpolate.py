"""Cubic and quintic B-spline interpolation of images, and its noise gain (docs/method.md, equations 1.7 and 11.1).

The spline passes through the grey values; positions are (column, row), pixel centres at integers. Bias and noise of
the choices: degree 3 is right for most tests, degree 5 has four times less sub-pixel bias at 0.6 of the speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache, reduce

import numpy as np
from numba import njit

from idic.errors import InputError
from idic.images.gaussian_lowpass import lowpass_weights
from idic.images.spline_filter import MIRROR_PAD_PX, POLES, spline_coefficients
from idic.images.taps import weight_polynomials

DEGREES = {"cubic": 3, "quintic": 5}


@dataclass(frozen=True, eq=False)
class Spline:
    """The B-spline of one image.

    Attributes
    ----------
    coefficients : array (ny + 16, nx + 16), float32
        Mirrored 8 px beyond the image on every side.
    degree : {3, 5}
    lowpass_px : float
        Standard deviation of the Gaussian that the image was blurred with before.
    """

    coefficients: np.ndarray
    degree: int
    lowpass_px: float = 0.0

    @property
    def shape(self) -> tuple[int, int]:
        """(ny, nx) of the image."""
        return self.coefficients.shape[0] - 2 * MIRROR_PAD_PX, self.coefficients.shape[1] - 2 * MIRROR_PAD_PX

    @property
    def nbytes(self) -> int:
        return self.coefficients.nbytes

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Grey values at sub-pixel positions  # points (n, 2) (column, row) px -> (n,), nan outside the image"""
        return _sample(self, points)[:, 0]

    def gradient(self, points: np.ndarray) -> np.ndarray:
        """Spline gradient d/d(column), d/d(row)  # points (n, 2) px -> (n, 2) GV/px, nan outside the image"""
        return _sample(self, points)[:, 1:]

    def gradient_at_pixels(self, ix: np.ndarray, iy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Spline gradient at whole pixels (columns ix, rows iy), fast  # (n,) int32 -> two (n,) float32, GV/px"""
        polynomials = _WEIGHTS[self.degree]
        gx, gy = np.empty(len(ix), dtype=np.float32), np.empty(len(ix), dtype=np.float32)
        taps = self.degree  # at fraction 0 the last tap has no weight
        _sample_gradients(self.coefficients, polynomials[0, :taps], polynomials[1, :taps], ix, iy, gx, gy)
        return gx, gy


def prefilter(image: np.ndarray, degree: int = 3, lowpass_px: float = 0.0) -> Spline:
    """The interpolating spline of an image, after a low-pass where `lowpass_px` is not 0 (mirror boundary, float32).

    Parameters
    ----------
    image : array (ny, nx), any real dtype
    degree : {3, 5}
    lowpass_px : float
        Standard deviation (px) of a Gaussian against aliasing (`idic.images.gaussian_lowpass`); 0: none.

    Raises
    ------
    InputError
        Where the image is not 2D, smaller than 9 px, or holds values that are not finite.
    """
    image = np.asarray(image)
    if degree not in POLES:
        raise InputError("no such interpolation", key="interpolation", found=degree,
                         expected="degree 3 (cubic) or 5 (quintic)", remedy='write "cubic" or "quintic"')
    if image.ndim != 2 or min(image.shape) <= MIRROR_PAD_PX:
        raise InputError("not a usable grey image", expected=f"(ny, nx), both above {MIRROR_PAD_PX} px",
                         found=str(image.shape), remedy="give a single-channel image that is larger than this")
    if image.dtype.kind == "f" and not np.isfinite(image).all():
        raise InputError("the image holds values that are not finite", expected="finite grey values everywhere",
                         found=f"{np.count_nonzero(~np.isfinite(image))} px of nan or inf",
                         remedy="replace them and leave them out with a mask")
    return Spline(spline_coefficients(image, degree, lowpass_weights(lowpass_px)), degree, lowpass_px)


def noise_gain(*fractions: np.ndarray, degree: int = 3, lowpass_px: float = 0.0) -> np.ndarray:
    """Variance of the interpolated value / variance of the pixels, w^2 (independent noise)  # shape of the fractions

    The product over the axes of the sum of squares of the weights of the pixels; without a low-pass 1 at a pixel. On
    average 0.764 for the cubic, 0.843 for the quintic spline in two dimensions: a residual f - g(x + u) of pure noise
    has the variance ``sigma^2 (1 + w^2)``, not ``2 sigma^2``.

    fractions : places between two pixels, px, along each axis
    """
    axes, table = np.broadcast_arrays(*fractions), _gain_table(degree, lowpass_px)
    gain = np.empty(axes[0].shape)
    flat, places = gain.reshape(-1), [axis.reshape(-1) for axis in axes]
    for first in range(0, gain.size, _PIXELS_AT_A_TIME):  # a value takes some arrays of 8 bytes
        block = slice(first, first + _PIXELS_AT_A_TIME)
        flat[block] = reduce(np.multiply, (np.interp(at - np.floor(at), _GAIN_FRACTIONS, table)
                                           for at in (place[block].astype(float) for place in places)))
    return gain


def _sample(spline, points):
    points = np.ascontiguousarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"points must be (n, 2), got {points.shape}")
    out = np.empty((len(points), 3))
    _sample_points(spline.coefficients, _WEIGHTS[spline.degree], points, out)
    return out


@njit(cache=True, nogil=True)
def _sample_points(c, polynomials, points, out):
    taps = polynomials.shape[0]
    nx, ny = c.shape[1] - 2 * MIRROR_PAD_PX, c.shape[0] - 2 * MIRROR_PAD_PX
    weights = np.empty((2, taps))
    slopes = np.empty((2, taps))
    cell = np.empty(2, dtype=np.int64)
    for p in range(points.shape[0]):
        x, y = points[p, 0], points[p, 1]
        if not (0.0 <= x <= nx - 1.0 and 0.0 <= y <= ny - 1.0):
            out[p, :] = np.nan
            continue
        for axis in range(2):
            floor = np.floor(points[p, axis])
            cell[axis] = np.int64(floor)
            t = points[p, axis] - floor
            for j in range(taps):
                w, s = 0.0, 0.0
                for power in range(taps - 1, -1, -1):
                    s = s * t + w
                    w = w * t + polynomials[power, j]
                weights[axis, j] = w
                slopes[axis, j] = s
        value, gx, gy = 0.0, 0.0, 0.0
        row0, column0 = cell[1] + MIRROR_PAD_PX - taps // 2 + 1, cell[0] + MIRROR_PAD_PX - taps // 2 + 1
        for i in range(taps):
            along, slope = 0.0, 0.0
            for j in range(taps):
                along += weights[0, j] * c[row0 + i, column0 + j]
                slope += slopes[0, j] * c[row0 + i, column0 + j]
            value += weights[1, i] * along
            gx += weights[1, i] * slope
            gy += slopes[1, i] * along
        out[p, 0], out[p, 1], out[p, 2] = value, gx, gy


@njit(cache=True, nogil=True)
def _sample_gradients(c, weights, slopes, ix, iy, gx, gy):
    taps = weights.size
    for p in range(ix.size):
        x, y = 0.0, 0.0
        row0, column0 = iy[p] + MIRROR_PAD_PX - taps // 2, ix[p] + MIRROR_PAD_PX - taps // 2
        for i in range(taps):
            along, slope = 0.0, 0.0
            for j in range(taps):
                along += weights[j] * c[row0 + i, column0 + j]
                slope += slopes[j] * c[row0 + i, column0 + j]
            x += weights[i] * slope
            y += slopes[i] * along
        gx[p], gy[p] = x, y


@lru_cache(maxsize=32)
def _gain_table(degree, lowpass_px):
    """sum_k h_k(t)^2, h the cardinal spline (tap weights convolved with the inverse filter) of the blurred pixels."""
    polynomials = weight_polynomials(degree)
    weights = np.power.outer(_GAIN_FRACTIONS, np.arange(degree + 1)) @ polynomials  # (n, taps)
    impulse = np.zeros(129)
    impulse[64 - (degree - 1) // 2 : 64 + (degree - 1) // 2 + 1] = polynomials[0, :degree]  # spline at the integers
    inverse = np.real(np.fft.ifft(1.0 / np.fft.fft(np.fft.ifftshift(impulse))))
    inverse = np.convolve(np.fft.fftshift(inverse), lowpass_weights(lowpass_px))
    return np.array([(np.convolve(row, inverse) ** 2).sum() for row in weights])


_WEIGHTS = {degree: weight_polynomials(degree) for degree in POLES}
_GAIN_FRACTIONS = np.linspace(0.0, 1.0, 513)
_PIXELS_AT_A_TIME = 2**16
