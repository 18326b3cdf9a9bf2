"""B-spline coefficients of a blurred image by recursive filtering, compiled (docs/method.md, equation 1.7).

Source: Unser, Aldroubi and Eden 1993, doi:10.1109/78.193220. Mirror boundary as `scipy.ndimage` understands it
(d c b | a b c d | c b a), float32. Low-pass and spline filter act along each axis on their own, so that both run along
the rows first and along the columns after, in strips of a width that stays in the cache: of rows, turned round on the
way in and out, then of columns. Strips are flat arrays with unsigned offsets, which the compiler turns into vector
code. `tests/images/spline_reference.py` is the same by SciPy.
"""

from __future__ import annotations

import numpy as np
from numba import njit

MIRROR_PAD_PX = 8  # mirrored coefficients on every side: the kernels need no boundary branch
POLES = {3: (np.sqrt(3.0) - 2.0,), 5: (-0.43057534709997379, -0.04309628820326465)}
_MIRROR_TERMS = 40  # |pole|^40 < 3e-15: the infinite mirror sum needs no more terms in float32
_ROWS, _COLUMNS, _TILE = 32, 32, 16  # lines of a strip; pixels that are turned round together
_U = np.uint64


def spline_coefficients(image: np.ndarray, degree: int, lowpass_weights: tuple[float, ...] = (1.0,)) -> np.ndarray:
    """Coefficients of the interpolating spline of an image after a separable symmetric low-pass.

    Parameters
    ----------
    image : array (ny, nx), both above MIRROR_PAD_PX
    degree : {3, 5}
    lowpass_weights : tuple of odd length
        Symmetric weights along an axis (`idic.images.gaussian_lowpass.lowpass_weights`).

    Returns
    -------
    array (ny + 2 MIRROR_PAD_PX, nx + 2 MIRROR_PAD_PX), float32
        Mirrored beyond the image.
    """
    image = np.ascontiguousarray(image, dtype=np.float32)
    weights = np.array(lowpass_weights[len(lowpass_weights) // 2 :], dtype=np.float32)  # from the middle on
    poles = np.array(POLES[degree], dtype=np.float64)
    padded = np.empty((image.shape[0] + 2 * MIRROR_PAD_PX, image.shape[1] + 2 * MIRROR_PAD_PX), dtype=np.float32)
    _filter_rows(image, padded, weights, poles)
    _filter_columns(padded, weights, poles)
    _mirror_rim(padded)
    return padded


def _mirror_rim(c):
    for k in range(1, MIRROR_PAD_PX + 1):
        c[MIRROR_PAD_PX - k] = c[MIRROR_PAD_PX + k]
        c[-MIRROR_PAD_PX - 1 + k] = c[-MIRROR_PAD_PX - 1 - k]
    for k in range(1, MIRROR_PAD_PX + 1):
        c[:, MIRROR_PAD_PX - k] = c[:, MIRROR_PAD_PX + k]
        c[:, -MIRROR_PAD_PX - 1 + k] = c[:, -MIRROR_PAD_PX - 1 - k]


@njit(cache=True, nogil=True)
def filter_block(t, n, width, poles):
    """Filter every column of a strip on its own, in place  # t (>= n * width,) float32: n values of `width` columns"""
    gain = 1.0
    for z in poles:
        gain *= (1.0 - z) * (1.0 - 1.0 / z)
    first = np.empty(width, dtype=np.float32)
    w = _U(width)
    for k in range(poles.size):
        z = np.float32(poles[k])
        lam = np.float32(gain) if k == 0 else np.float32(1.0)
        _mirror_sum(t, n, width, poles[k], first)
        for j in range(width):
            t[_U(j)] = lam * first[_U(j)]
        for i in range(1, n):
            line = _U(i) * w
            previous = line - w
            for j in range(width):
                t[line + _U(j)] = lam * t[line + _U(j)] + z * t[previous + _U(j)]
        end = np.float32(poles[k] / (poles[k] * poles[k] - 1.0))
        line = _U(n - 1) * w
        previous = line - w
        for j in range(width):
            t[line + _U(j)] = end * (t[line + _U(j)] + z * t[previous + _U(j)])
        for i in range(n - 2, -1, -1):
            line = _U(i) * w
            following = line + w
            for j in range(width):
                t[line + _U(j)] = z * (t[following + _U(j)] - t[line + _U(j)])


@njit(cache=True, nogil=True)
def _mirror_sum(t, n, width, z, first):
    """Start value of the causal recursion: sum of z^k s_k over the mirrored signal (exact for short signals)."""
    first[:] = np.float32(0.0)
    for k in range(min(n, _MIRROR_TERMS)):
        weight = z**k
        if n <= _MIRROR_TERMS:
            if 0 < k < n - 1:
                weight += z ** (2 * n - 2 - k)
            weight /= 1.0 - z ** (2 * n - 2)
        share = np.float32(weight)
        line = _U(k) * _U(width)
        for j in range(width):
            first[_U(j)] += share * t[line + _U(j)]


@njit(cache=True, nogil=True)
def _mirror_ends(s, n, width, reach):
    """Mirror n lines, the first of which is line `reach` of s, at both ends; further than once around if need be."""
    period = 2 * (n - 1)
    for k in range(1, reach + 1):
        inner = k % period
        inner = min(inner, period - inner)
        for j in range(width):
            s[(reach - k) * width + j] = s[(reach + inner) * width + j]
            s[(reach + n - 1 + k) * width + j] = s[(reach + n - 1 - inner) * width + j]


@njit(cache=True, nogil=True)
def _blur(s, t, n, width, weights):
    """Symmetric low-pass of every column of a strip; weights from the middle on.

    s ((n + 2 reach) * width,) with mirrored ends -> t (n * width,)
    """
    reach = weights.size - 1
    w = _U(width)
    if reach == 3:  # the default low-pass, in one sweep
        w0, w1, w2, w3 = weights[0], weights[1], weights[2], weights[3]
        for i in range(n * width):
            k = _U(i)
            t[k] = (w0 * s[k + _U(3) * w] + w1 * (s[k + _U(2) * w] + s[k + _U(4) * w])
                    + w2 * (s[k + w] + s[k + _U(5) * w]) + w3 * (s[k] + s[k + _U(6) * w]))
        return
    middle = _U(reach) * w
    for i in range(n * width):
        t[_U(i)] = weights[0] * s[_U(i) + middle]
    for distance in range(1, reach + 1):
        share, d = weights[distance], _U(distance) * w
        for i in range(n * width):
            t[_U(i)] += share * (s[_U(i) + middle - d] + s[_U(i) + middle + d])


@njit(cache=True, nogil=True)
def _filter_rows(image, c, weights, poles):
    """Rows of the image, blurred and filtered, into the interior of c."""
    ny, nx = image.shape
    reach, width, pad = weights.size - 1, _U(_ROWS), _U(MIRROR_PAD_PX)
    s, t = np.zeros((nx + 2 * reach) * _ROWS, dtype=np.float32), np.empty(nx * _ROWS, dtype=np.float32)
    for i0 in range(0, ny, _ROWS):
        rows = min(_ROWS, ny - i0)
        for j0 in range(0, nx, _TILE):
            j1 = min(j0 + _TILE, nx)
            for r in range(rows):
                for j in range(j0, j1):
                    s[_U(j + reach) * width + _U(r)] = image[_U(i0 + r), _U(j)]
        _mirror_ends(s, nx, _ROWS, reach)
        _blur(s, t, nx, _ROWS, weights)
        filter_block(t, nx, _ROWS, poles)
        for j0 in range(0, nx, _TILE):
            j1 = min(j0 + _TILE, nx)
            for r in range(rows):
                for j in range(j0, j1):
                    c[_U(i0 + r) + pad, _U(j) + pad] = t[_U(j) * width + _U(r)]


@njit(cache=True, nogil=True)
def _filter_columns(c, weights, poles):
    """Columns of the interior of c, blurred and filtered in place."""
    ny, nx = c.shape[0] - 2 * MIRROR_PAD_PX, c.shape[1] - 2 * MIRROR_PAD_PX
    reach, width, pad = weights.size - 1, _U(_COLUMNS), _U(MIRROR_PAD_PX)
    s, t = np.zeros((ny + 2 * reach) * _COLUMNS, dtype=np.float32), np.empty(ny * _COLUMNS, dtype=np.float32)
    for j0 in range(0, nx, _COLUMNS):
        columns = min(_COLUMNS, nx - j0)
        for i in range(ny):
            for j in range(columns):
                s[_U(i + reach) * width + _U(j)] = c[_U(i) + pad, _U(j0 + j) + pad]
        _mirror_ends(s, ny, _COLUMNS, reach)
        _blur(s, t, ny, _COLUMNS, weights)
        filter_block(t, ny, _COLUMNS, poles)
        for i in range(ny):
            for j in range(columns):
                c[_U(i) + pad, _U(j0 + j) + pad] = t[_U(i) * width + _U(j)]
