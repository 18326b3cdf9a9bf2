"""The image kernel of a cross-section: sums over the rows of every image column.

    r = f + h - g(x + u)    with u and h a function of the column alone

A block of 32 rows is turned round so that a column is a short vector: the spline's recursive filter runs along the
section for 32 rows at a time, and the six taps and their weights are the same for all of them. Nothing is filtered or
interpolated across the rows, which stay at whole pixels. float32 within a block, float64 across blocks.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import njit

from idic.images import POLES, filter_block, weight_polynomials

N_LANES = 32
N_TAPS = 6
N_SUMS = 4  # sum over rows of r, r f_x, r^2, r y
_FAST = {"contract", "reassoc", "nsz"}
_polynomials = cache(weight_polynomials)


def poles(degree: int) -> np.ndarray:
    return np.array(POLES[degree], dtype=np.float64)


def tap_weights(position: np.ndarray, degree: int, reach: tuple[int, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First tap, its six weights (cubic: the outer ones are 0) and the fraction of every position.

    position : (n,) px.  reach : lowest and highest position allowed; first tap -1 beyond.

    Returns
    -------
    first (n,) int32, weights (n, 6) float32, fraction (n,)
    """
    floor = np.floor(position)
    fraction = position - floor
    powers = fraction[:, None] ** np.arange(degree + 1)
    weights = np.zeros((len(position), N_TAPS), dtype=np.float32)
    weights[:, (5 - degree) // 2:N_TAPS - (5 - degree) // 2] = powers @ _polynomials(degree)
    inside = (position >= reach[0]) & (position <= reach[1])
    return np.where(inside, floor - 2, -1).astype(np.int32), weights, fraction


def to_blocks(image: np.ndarray) -> np.ndarray:
    """(ny, n_columns) as (n_blocks, n_columns, N_LANES) float32, rows missing at the end 0."""
    ny, n = image.shape
    blocks = -(-ny // N_LANES)
    padded = np.zeros((blocks * N_LANES, n), dtype=np.float32)
    padded[:ny] = image
    return np.ascontiguousarray(padded.reshape(blocks, N_LANES, n).transpose(0, 2, 1))


def from_blocks(blocks: np.ndarray, ny: int) -> np.ndarray:
    """The inverse of `to_blocks`  # (ny, n_columns)"""
    return blocks.transpose(0, 2, 1).reshape(-1, blocks.shape[1])[:ny]


@njit(cache=True, nogil=True)
def _load_block(image, level, start, t):
    """Rows start ... start + N_LANES of the image less `level`, turned round  # t (nx, N_LANES)"""
    rows = min(N_LANES, image.shape[0] - start)
    for j0 in range(0, image.shape[1], N_LANES):
        j1 = min(j0 + N_LANES, image.shape[1])
        for i in range(rows):
            for j in range(j0, j1):
                t[j, i] = image[start + i, j] - level
    for i in range(rows, N_LANES):
        for j in range(image.shape[1]):
            t[j, i] = np.float32(0.0)


@njit(cache=True, nogil=True, fastmath=_FAST)
def _residuals(t, first, c, shift, f, w, r):
    """Residuals of one column in one block  # f, w, r (N_LANES,)"""
    a0, a1, a2, a3, a4, a5 = t[first], t[first + 1], t[first + 2], t[first + 3], t[first + 4], t[first + 5]
    c0, c1, c2, c3, c4, c5 = c[0], c[1], c[2], c[3], c[4], c[5]
    for i in range(N_LANES):
        g = c0 * a0[i] + c1 * a1[i] + c2 * a2[i] + c3 * a3[i] + c4 * a4[i] + c5 * a5[i]
        r[i] = w[i] * (f[i] + shift - g)


@njit(cache=True, nogil=True, fastmath=_FAST)
def _add_sums(r, fx, y, out):
    s0 = s1 = s2 = s3 = np.float32(0.0)
    for i in range(N_LANES):
        s = r[i]
        s0 += s
        s1 += s * fx[i]
        s2 += s * s
        s3 += s * y[i]
    out[0] += s0
    out[1] += s1
    out[2] += s2
    out[3] += s3


@njit(cache=True, nogil=True)
def section_sums(image, level, pole, first, weights, shift, f, fx, w, y, sums):
    """Column sums of a frame.

    image (ny, nx) float32; level: subtracted from it first; first (n,) int32, -1 where the column left the image;
    weights (n, 6) float32; shift (n,) float32: what r adds to f; f, fx, w (n_blocks, n, N_LANES) float32, w 0 or 1;
    y (n_blocks, N_LANES) float32; sums (n, N_SUMS) float64: the result.
    """
    t = np.empty((image.shape[1], N_LANES), dtype=np.float32)
    r = np.empty(N_LANES, dtype=np.float32)
    sums[:] = 0.0
    for b in range(f.shape[0]):
        _load_block(image, level, b * N_LANES, t)
        filter_block(t.ravel(), image.shape[1], N_LANES, pole)
        for k in range(first.size):
            if first[k] >= 0:
                _residuals(t, first[k], weights[k], shift[k], f[b, k], w[b, k], r)
                _add_sums(r, fx[b, k], y[b], sums[k])


@njit(cache=True, nogil=True)
def section_residuals(image, level, pole, first, weights, shift, f, w, out):
    """Residual of every pixel  # out (n_blocks, n, N_LANES); other arguments as in `section_sums`"""
    t = np.empty((image.shape[1], N_LANES), dtype=np.float32)
    for b in range(f.shape[0]):
        _load_block(image, level, b * N_LANES, t)
        filter_block(t.ravel(), image.shape[1], N_LANES, pole)
        for k in range(first.size):
            if first[k] >= 0:
                _residuals(t, first[k], weights[k], shift[k], f[b, k], w[b, k], out[b, k])
            else:
                out[b, k] = 0.0
