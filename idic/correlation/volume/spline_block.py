"""Spline coefficients of a block of a volume, by the recursive filter along its three axes.

    c+_i = lambda s_i + z c+_{i-1},     c_i = z (c_{i+1} - c+_i)          Unser 1999, doi:10.1109/79.799930

Of a pole z the filter forgets what is k voxels away by z^k: a block that is wider than wanted by `REACH` voxels on
every side has the coefficients of the whole volume in its middle, to single precision.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from idic.images import POLES, filter_block

_TILE = 16
_STRIP = 512  # columns that pass along the slices together: with 150 of them they stay in the second cache


def coefficients_in(block: np.ndarray, degree: int, reach: int, room: int) -> np.ndarray:
    """Coefficients of the block without `reach` voxels on every side, row by row, and `room` zeros behind them.

    block : (nz, ny, nx) float32, overwritten  # -> flat float32
    """
    nz, ny, nx = block.shape
    inner = (nz - 2 * reach, ny - 2 * reach, nx - 2 * reach)
    flat = np.zeros(int(np.prod(inner)) + room, dtype=np.float32)
    poles = np.array(POLES[degree])
    _along_slices(block.reshape(nz, ny * nx), poles)
    _in_planes(block[reach:nz - reach], poles, reach, flat[:int(np.prod(inner))].reshape(inner))
    return flat


@njit(cache=True, nogil=True)
def _along_slices(block, poles):
    n, width = block.shape
    strip = np.empty(n * _STRIP, dtype=np.float32)
    for first in range(0, width, _STRIP):
        m = min(_STRIP, width - first)
        for i in range(n):
            for j in range(m):
                strip[i * m + j] = block[i, first + j]
        filter_block(strip, n, m, poles)
        for i in range(n):
            for j in range(m):
                block[i, first + j] = strip[i * m + j]


@njit(cache=True, nogil=True)
def _in_planes(block, poles, reach, out):
    """Along the rows' direction and the columns' of every slice; out : (nz, ny - 2 reach, nx - 2 reach)"""
    nz, ny, nx = block.shape
    turned = np.empty(nx * ny, dtype=np.float32)
    rows = ny - 2 * reach
    for k in range(nz):
        filter_block(block[k].reshape(ny * nx), ny, nx, poles)
        _transpose(block[k, reach:ny - reach], turned[:nx * rows].reshape(nx, rows))
        filter_block(turned, nx, rows, poles)
        _transpose(turned[reach * rows:(nx - reach) * rows].reshape(nx - 2 * reach, rows), out[k])


@njit(cache=True, nogil=True)
def _transpose(rows, columns):
    """rows (n, m) -> columns (m, n), tile by tile: both stay in the first cache"""
    n, m = rows.shape
    for first in range(0, n, _TILE):
        for start in range(0, m, _TILE):
            for i in range(first, min(first + _TILE, n)):
                for j in range(start, min(start + _TILE, m)):
                    columns[j, i] = rows[i, j]
