"""The reference image with the blur that a frame of a stretched specimen has (docs/method.md, equations 1.8 to 1.11).

The low-pass blurs every image along its own axes, and so does the area of a pixel. On a specimen that is deformed by F,
a blur of covariance v I of the frame is one of covariance v F^-1 F^-T on the material:

    R = v (F^-1 F^-T - I),        f_R = exp(q) f = f + q f + q q f / 2 + …,      q = R : grad grad / 2

f_R is what the frame shows. The eight derivatives of f of second and fourth order are maps of the reference, made once;
R is one per element. The weights of a low-pass are not quite a Gaussian and a pixel is a square: their fourth cumulant
joins the fourth derivatives.

Where the strain has a gradient, what a blurred pixel shows is also displaced, by about v/2 times the second derivative
of the motion (equation 1.12): the mean of a motion over the blur is not the motion of its middle.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy
from numba import njit

from idic.images.gaussian_lowpass import REACH_STDS, lowpass, lowpass_weights
from idic.images.interpolate import prefilter
from idic.images.spline_filter import MIRROR_PAD_PX
from idic.images.taps import weight_polynomials

PIXEL_BLUR_PX = 12**-0.5  # standard deviation of the area of a pixel
ORDERS = ((2, 0), (1, 1), (0, 2), (4, 0), (3, 1), (2, 2), (1, 3), (0, 4))  # of the maps, by column and by row
MIN_DIFFERENCE_PX2 = 0.002  # of R, in its norm: less changes a pixel by 0.001 |grad grad f|, about 0.02 GV of 255
MIN_STRETCH = 0.65  # more compression is matched like this: the series ends at waves that the pixels hardly show
LEAST_SHIFT_PX, LARGEST_SHIFT_PX = 1e-6, 0.1  # rounding; and a flattened element on the way of a search
_ANY = 1e3  # of a component of F^-1: a flattened element on the way of a search has no end
_DEGREE = 5  # of the spline that is differentiated, whatever the images are interpolated with


def matching_weights(inverse: np.ndarray, lowpass_px: float, camera_blur_px: float = PIXEL_BLUR_PX) -> np.ndarray:
    """Weights of the maps of `ORDERS` in f_R for each element, to the fourth order of derivatives (equation 1.10).

    Parameters
    ----------
    inverse : array (n_elements, 2, 2)
        F^-1 in pixel coordinates.
    lowpass_px, camera_blur_px : standard deviations of the low-pass and of the camera's own blur, px

    Returns
    -------
    array (n_elements, 8), px² and px⁴; 0 where F is all but a rotation
    """
    weights = np.empty((len(inverse), len(ORDERS)))
    _fill_weights(np.ascontiguousarray(inverse, dtype=np.float64), *_blur_cumulants(lowpass_px, camera_blur_px),
                  weights)
    return weights


def mean_shift(curvature: np.ndarray, fineness: float, lowpass_px: float,
               camera_blur_px: float = PIXEL_BLUR_PX) -> np.ndarray:
    """Displacement of the pattern of a blurred frame where the strain has a gradient (equation 1.12).

    Parameters
    ----------
    curvature : array (n_elements, 2, 2, 2), px/px²
        Second derivatives of the motion along the axes of the frame.
    fineness : float, px^-2
        Of the blurred pattern, see `fineness_of`.
    lowpass_px, camera_blur_px : as in `matching_weights`

    Returns
    -------
    array (n_elements, 2), px
    """
    variance, _ = _blur_cumulants(lowpass_px, camera_blur_px)
    part = variance * fineness
    along, divergence = np.trace(curvature, axis1=2, axis2=3), np.trace(curvature, axis1=1, axis2=2)
    shift = np.nan_to_num(0.5 * variance * ((1.0 - part) * along - 2.0 * part * divergence))
    shift = np.clip(shift, -LARGEST_SHIFT_PX, LARGEST_SHIFT_PX)
    return np.where(np.abs(shift) < LEAST_SHIFT_PX, 0.0, shift)


def fineness_of(image: np.ndarray, ix: np.ndarray, iy: np.ndarray) -> float:
    """Mean square of f,xy over that of f,x and f,y at these pixels, px^-2: 1/(2 s²) of a speckle exp(-d²/(4 s²))."""
    taps = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
    by_x, by_y = (scipy.ndimage.correlate1d(image, taps, axis=axis, mode="mirror") for axis in (1, 0))
    mixed_map = scipy.ndimage.correlate1d(by_x, taps, axis=0, mode="mirror")
    slopes, mixed = (float(np.mean(np.square(part[iy, ix], dtype=np.float64)))
                     for part in (np.hypot(by_x, by_y), mixed_map))
    return 2.0 * mixed / slopes if slopes > 0.0 else 0.0


def derivative_maps(image: np.ndarray, ix: np.ndarray, iy: np.ndarray) -> np.ndarray:
    """Derivatives of `ORDERS` of the quintic spline of an image at whole pixels.

    image : (ny, nx) GV, low-passed; ix, iy : (n_pixels,) columns and rows.

    Returns
    -------
    array (8, n_pixels), float32, GV/px² and GV/px⁴
    """
    coefficients = prefilter(np.asarray(image, dtype=np.float32), _DEGREE).coefficients
    taps = weight_polynomials(_DEGREE)[:, :_DEGREE]  # at a whole pixel the last tap has no weight
    factorial = (1.0, 1.0, 2.0, 6.0, 24.0)
    maps = np.empty((len(ORDERS), len(ix)), dtype=np.float32)
    for by_row in range(5):
        along = scipy.ndimage.correlate1d(coefficients, factorial[by_row] * taps[by_row], axis=0)
        for number, (by_column, order) in enumerate(ORDERS):
            if order == by_row:
                derivative = scipy.ndimage.correlate1d(along, factorial[by_column] * taps[by_column], axis=1)
                maps[number] = derivative[iy + MIRROR_PAD_PX, ix + MIRROR_PAD_PX]
    return maps


def matched_gain(weights: np.ndarray, lowpass_px: float) -> np.ndarray:
    """Variance of a pixel of f_R / variance of a pixel of the image (independent noise)  # (n, 8) -> (n,)

    Equation 1.11.
    """
    factors = np.column_stack([np.ones(len(weights)), weights])
    return np.einsum("ei,ij,ej->e", factors, _products(lowpass_px), factors)


@njit(cache=True, nogil=True)
def _fill_weights(inverse, variance, cumulant, weights):
    """R is cut off at `MIN_STRETCH` and shrunk by `MIN_DIFFERENCE_PX2`, hence continuous in F.

    A wave k of the reference is F^-T k in the frame: the fourth powers of its components, less those of k.
    """
    limit, end = variance * (MIN_STRETCH**-2 - 1.0), 1.0 / MIN_STRETCH
    for e in range(inverse.shape[0]):
        p1, p2 = min(max(inverse[e, 0, 0], -_ANY), _ANY), min(max(inverse[e, 0, 1], -_ANY), _ANY)
        q1, q2 = min(max(inverse[e, 1, 0], -_ANY), _ANY), min(max(inverse[e, 1, 1], -_ANY), _ANY)
        xx, yy = variance * (p1 * p1 + p2 * p2 - 1.0), variance * (q1 * q1 + q2 * q2 - 1.0)
        xy = variance * (p1 * q1 + p2 * q2)
        mean, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
        radius = np.sqrt(half * half + xy * xy)
        high, low = min(mean + radius, limit), min(mean - radius, limit)  # principal values
        norm = np.sqrt(high * high + low * low)
        if norm <= MIN_DIFFERENCE_PX2:
            weights[e, :] = 0.0
            continue
        shrinkage = 1.0 - MIN_DIFFERENCE_PX2 / norm
        mean, turned = 0.5 * shrinkage * (high + low), 0.5 * shrinkage * (high - low) / radius if radius > 0.0 else 0.0
        a, b, c = mean + turned * half, turned * xy, mean - turned * half
        p1, p2, q1, q2 = (min(max(p1, -end), end), min(max(p2, -end), end), min(max(q1, -end), end),
                          min(max(q2, -end), end))
        p11, p22, q11, q22 = p1 * p1, p2 * p2, q1 * q1, q2 * q2
        fourth = shrinkage * cumulant / 24.0
        weights[e, 0], weights[e, 1], weights[e, 2] = 0.5 * a, b, 0.5 * c
        weights[e, 3] = a * a / 8.0 + fourth * (p11 * p11 + p22 * p22 - 1.0)
        weights[e, 4] = 0.5 * a * b + fourth * 4.0 * (p11 * p1 * q1 + p22 * p2 * q2)
        weights[e, 5] = (2.0 * b * b + a * c) / 4.0 + fourth * 6.0 * (p11 * q11 + p22 * q22)
        weights[e, 6] = 0.5 * b * c + fourth * 4.0 * (p1 * q11 * q1 + p2 * q22 * q2)
        weights[e, 7] = c * c / 8.0 + fourth * (q11 * q11 + q22 * q22 - 1.0)


@lru_cache(maxsize=16)
def _blur_cumulants(lowpass_px: float, camera_blur_px: float) -> tuple[float, float]:
    """Second and fourth cumulant of the blur along an axis, px² and px⁴: of the weights as they are, and of the camera.

    Of the camera's blur the area of the pixel, at most, is a square; the rest is a Gaussian without a fourth cumulant.
    """
    weights = np.array(lowpass_weights(lowpass_px))
    position = np.arange(len(weights)) - len(weights) // 2
    second, fourth = float(weights @ position**2), float(weights @ position**4)
    square = min(camera_blur_px, PIXEL_BLUR_PX)
    return second + camera_blur_px**2, fourth - 3.0 * second**2 - 1.2 * square**4


@lru_cache(maxsize=16)
def _products(lowpass_px: float) -> np.ndarray:
    """Products of the kernels of the low-passed image and of its eight maps  # (9, 9)"""
    half = int(np.ceil(REACH_STDS * lowpass_px)) + 24  # the spline's recursion has died out: 0.43^24
    impulse = np.zeros((2 * half + 1, 2 * half + 1))
    impulse[half, half] = 1.0
    blurred = lowpass(impulse, lowpass_px)
    iy, ix = (part.ravel() for part in np.indices(impulse.shape))
    kernels = np.vstack([blurred.ravel(), derivative_maps(blurred, ix, iy)]).astype(float)
    return kernels @ kernels.T
