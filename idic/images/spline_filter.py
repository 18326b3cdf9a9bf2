"""B-spline coefficients of an image by recursive filtering, compiled (docs/method.md, equation 1.7).

Source: Unser, Aldroubi and Eden 1993, doi:10.1109/78.193220. Mirror boundary as `scipy.ndimage` understands it
(d c b | a b c d | c b a), float32, in place. Rows are filtered in blocks of 16 that are transposed on the way in and
out, columns in strips of 64: both passes become vector code. `idic.images.spline_reference` is the same by SciPy.
"""

from __future__ import annotations

import numpy as np
from numba import njit

MIRROR_PAD_PX = 8  # mirrored coefficients on every side: the kernels need no boundary branch
POLES = {3: (np.sqrt(3.0) - 2.0,), 5: (-0.43057534709997379, -0.04309628820326465)}
_MIRROR_TERMS = 40  # |pole|^40 < 3e-15: the infinite mirror sum needs no more terms in float32
_ROWS, _STRIP = 16, 64


def filter_in_place(coefficients: np.ndarray, degree: int) -> None:
    """Turn grey values in the interior of a padded float32 array into coefficients and mirror them into the rim.

    Parameters
    ----------
    coefficients : array (ny + 2 MIRROR_PAD_PX, nx + 2 MIRROR_PAD_PX), float32
        Grey values in ``[MIRROR_PAD_PX:-MIRROR_PAD_PX, MIRROR_PAD_PX:-MIRROR_PAD_PX]`` on entry.
    degree : {3, 5}
    """
    poles = np.array(POLES[degree], dtype=np.float64)
    _filter_rows(coefficients, poles)
    _filter_columns(coefficients, poles)
    _mirror_rim(coefficients)


def _mirror_rim(c):
    for k in range(1, MIRROR_PAD_PX + 1):
        c[MIRROR_PAD_PX - k] = c[MIRROR_PAD_PX + k]
        c[-MIRROR_PAD_PX - 1 + k] = c[-MIRROR_PAD_PX - 1 - k]
    for k in range(1, MIRROR_PAD_PX + 1):
        c[:, MIRROR_PAD_PX - k] = c[:, MIRROR_PAD_PX + k]
        c[:, -MIRROR_PAD_PX - 1 + k] = c[:, -MIRROR_PAD_PX - 1 - k]


@njit(cache=True, nogil=True, fastmath={"contract"})
def filter_block(t, n, width, poles):
    """Filter along the first axis of t (n, >= width), every column on its own."""
    gain = 1.0
    for z in poles:
        gain *= (1.0 - z) * (1.0 - 1.0 / z)
    for k in range(poles.size):
        z = np.float32(poles[k])
        lam = np.float32(gain) if k == 0 else np.float32(1.0)
        first = np.zeros(width, dtype=np.float32)
        _mirror_sum(t, n, width, poles[k], first)
        for j in range(width):
            t[0, j] = lam * first[j]
        for i in range(1, n):
            row = t[i]
            previous = t[i - 1]
            for j in range(width):
                row[j] = lam * row[j] + z * previous[j]
        end = np.float32(poles[k] / (poles[k] * poles[k] - 1.0))
        end_row = t[n - 1]
        second_last = t[n - 2]
        for j in range(width):
            end_row[j] = end * (end_row[j] + z * second_last[j])
        for i in range(n - 2, -1, -1):
            row = t[i]
            next_row = t[i + 1]
            for j in range(width):
                row[j] = z * (next_row[j] - row[j])


@njit(cache=True, nogil=True, fastmath={"contract"})
def _mirror_sum(t, n, width, z, first):
    """Start value of the causal recursion: sum of z^k s_k over the mirrored signal (exact for short signals)."""
    terms = min(n, _MIRROR_TERMS)
    for k in range(terms):
        weight = z**k
        if n <= _MIRROR_TERMS:
            if 0 < k < n - 1:
                weight += z ** (2 * n - 2 - k)
            weight /= 1.0 - z ** (2 * n - 2)
        w = np.float32(weight)
        row = t[k]
        for j in range(width):
            first[j] += w * row[j]


@njit(cache=True, nogil=True)
def _filter_rows(c, poles):
    ny, nx = c.shape[0] - 2 * MIRROR_PAD_PX, c.shape[1] - 2 * MIRROR_PAD_PX
    t = np.zeros((nx, _ROWS), dtype=np.float32)
    for i0 in range(MIRROR_PAD_PX, MIRROR_PAD_PX + ny, _ROWS):
        rows = min(_ROWS, MIRROR_PAD_PX + ny - i0)
        for r in range(rows):
            source = c[i0 + r]
            for j in range(nx):
                t[j, r] = source[j + MIRROR_PAD_PX]
        filter_block(t, nx, _ROWS, poles)
        for r in range(rows):
            target = c[i0 + r]
            for j in range(nx):
                target[j + MIRROR_PAD_PX] = t[j, r]


@njit(cache=True, nogil=True)
def _filter_columns(c, poles):
    ny, nx = c.shape[0] - 2 * MIRROR_PAD_PX, c.shape[1] - 2 * MIRROR_PAD_PX
    for j0 in range(MIRROR_PAD_PX, MIRROR_PAD_PX + nx, _STRIP):
        j1 = min(j0 + _STRIP, MIRROR_PAD_PX + nx)
        filter_block(c[MIRROR_PAD_PX : MIRROR_PAD_PX + ny, j0:j1], ny, j1 - j0, poles)
