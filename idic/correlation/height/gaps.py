"""Pixels without a value in a height image: filled for the spline, and left out of all sums.

A profilometer loses pixels on steep flanks and on dark or shiny spots. The spline needs a value everywhere, so a gap
takes the value of a plane through its neighbours. Every position whose taps reach into a gap counts as lost. Beyond
these taps the error of the filling, about the roughness, decays with the cardinal function of the spline: some per cent
for the quintic, less for the cubic.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from idic.errors import InputError
from idic.images import MIRROR_PAD_PX, REACH_STDS, Spline, prefilter

_FILL_STD_PX = 2.0  # standard deviation of the neighbourhood that a gap is filled from


@dataclass(frozen=True, eq=False)
class HeightFrame:
    """One height image, ready for the kernel.

    spline : of the heights above the level of the reference.
    gap_windows : array of the size of the spline's coefficients, uint8, or (0, 0) without gaps: 1 where the window of
    (degree + 1)^2 taps that begins there holds a gap.
    """

    spline: Spline
    gap_windows: np.ndarray


def height_frame(image: np.ndarray, level: float, degree: int, lowpass_px: float = 0.0) -> HeightFrame:
    """Prepare a height image, NaN where it has no value  # (ny, nx)

    Raises
    ------
    InputError
        If no pixel has a value.
    """
    image = np.asarray(image, dtype=np.float64) - level
    gaps = ~np.isfinite(image)
    if not gaps.any():
        return HeightFrame(prefilter(image.astype(np.float32), degree, lowpass_px), np.zeros((0, 0), np.uint8))
    filled = fill_gaps(image, gaps).astype(np.float32)
    if lowpass_px > 0:
        reach = int(np.ceil(REACH_STDS * lowpass_px))
        gaps = scipy.ndimage.binary_dilation(gaps, np.ones((3, 3), bool), iterations=reach)
    return HeightFrame(prefilter(filled, degree, lowpass_px), _windows_with(gaps, degree))


def pixels_at_gaps(frame: HeightFrame) -> np.ndarray:
    """Pixels whose own spline value reaches into a gap  # (ny, nx) bool"""
    ny, nx = frame.spline.shape
    if not frame.gap_windows.size:
        return np.zeros((ny, nx), dtype=bool)
    first = MIRROR_PAD_PX - (frame.spline.degree - 1) // 2
    return frame.gap_windows[first:first + ny, first:first + nx] > 0


def fill_gaps(image: np.ndarray, gaps: np.ndarray) -> np.ndarray:
    """The image with its gaps filled by the plane that fits their neighbours best (Gaussian weights)  # (ny, nx)

    Far from any value the gap takes the mean of the image.

    Raises
    ------
    InputError
        If no pixel has a value.
    """
    if gaps.all():
        raise InputError("a height image without a single value", expected="heights", found="gaps only",
                         remedy="exclude the frame")
    weight = (~gaps).astype(float)
    mean = float(image[~gaps].mean())
    values = np.where(gaps, 0.0, image - mean)
    row, column = np.indices(image.shape, dtype=float)

    def blurred(field):
        return scipy.ndimage.gaussian_filter(field, _FILL_STD_PX, mode="constant", truncate=4.0)[gaps]

    x, y = column[gaps], row[gaps]
    w, wx, wy = blurred(weight), blurred(weight * column), blurred(weight * row)
    wxx, wxy, wyy = blurred(weight * column**2), blurred(weight * column * row), blurred(weight * row**2)
    v, vx, vy = blurred(values), blurred(values * column), blurred(values * row)
    # moments about the gap itself; the plane's value there is the fill
    sx, sy = wx - w * x, wy - w * y
    sxx, sxy, syy = wxx - 2 * x * wx + w * x**2, wxy - x * wy - y * wx + w * x * y, wyy - 2 * y * wy + w * y**2
    tx, ty = vx - v * x, vy - v * y
    small = 1e-3 * w  # keeps a one-sided neighbourhood solvable; negligible with neighbours all round
    matrix = np.stack([w + 1e-9, sx, sy, sx, sxx + small, sxy, sy, sxy, syy + small], axis=-1).reshape(-1, 3, 3)
    matrix += 1e-9 * np.eye(3)
    solved = np.linalg.solve(matrix, np.stack([v, tx, ty], axis=-1)[:, :, None])[:, 0, 0]
    low, high = values[~gaps].min(), values[~gaps].max()
    filled = values.copy()
    filled[gaps] = np.where(w > 1e-4, np.clip(solved, low, high), 0.0)
    return filled + mean


def _windows_with(gaps: np.ndarray, degree: int) -> np.ndarray:
    """1 where the window of (degree + 1)^2 coefficients that begins there holds a gap  # (ny, nx) -> padded, uint8"""
    padded = np.pad(gaps, MIRROR_PAD_PX, mode="reflect")
    for axis in range(2):
        reach = padded.copy()
        for shift in range(1, degree + 1):
            ahead = np.zeros_like(padded)
            source, target = [slice(None)] * 2, [slice(None)] * 2
            source[axis], target[axis] = slice(shift, None), slice(None, -shift)
            ahead[tuple(target)] = padded[tuple(source)]
            reach |= ahead
        padded = reach
    return padded.astype(np.uint8)
