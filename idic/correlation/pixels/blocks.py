"""Sums of the reference image over each element, and the sparse matrix that the elements add up to.

    H_e[i, j] = sum_px N_i N_j grad f (x) grad f          (2 x 2 per pair of nodes, stored as xx, xy, yy for j <= i)
    g_e[i]    = sum_px N_i grad f (x) (f, 1)              (coupling to gain and offset)

docs/method.md, equation 3.7.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from idic.correlation.pixels.cells import N_NODES, TRANSFORMS
from idic.correlation.pixels.pixel_map import PixelMap

_PIXELS_PER_BLOCK = 256
_FAST = {"contract", "reassoc", "nsz"}


@dataclass(frozen=True, eq=False)
class ElementBlocks:
    """Sums over the pixels of each element (float64); grey values counted from the mean of the ROI.

    Attributes
    ----------
    hessian : array (n_elements, n_pairs, 3)
        xx, xy, yy of node pair i (i + 1) / 2 + j, j <= i.
    coupling : array (n_elements, n_max, 2, 2)
        [node, column/row, f/1].
    grey : array (n_elements, 3)
        Pixels, sum of f, sum of f^2.
    """

    hessian: np.ndarray
    coupling: np.ndarray
    grey: np.ndarray


@dataclass(frozen=True, eq=False)
class Pattern:
    """Where the blocks (2 x 2, 3 x 3) of the elements go in the data of a CSR matrix: row size n + c is of node n.

    ``place[e, ...]``: first entry of a block of element e; its next row is ``stride[node]`` entries further.
    """

    indices: np.ndarray
    indptr: np.ndarray
    place: np.ndarray
    stride: np.ndarray


def element_blocks(pixel_map: PixelMap, f, fx, fy, elements=None, valid=None) -> ElementBlocks:
    """Blocks of these elements (all of them where None) from their valid pixels.

    f (grey value above the mean), fx, fy: float32 (n_pixels,); elements (n,); valid (n_pixels,) uint8.
    """
    pm = pixel_map
    elements = np.arange(pm.n_elements) if elements is None else np.asarray(elements, dtype=np.int64)
    valid = np.ones(0, dtype=np.uint8) if valid is None else valid
    n_max = int(N_NODES[pm.kind].max())
    hessian = np.zeros((len(elements), n_max * (n_max + 1) // 2, 3))
    coupling = np.zeros((len(elements), n_max, 2, 2))
    grey = np.zeros((len(elements), 3))
    _element_sums(elements, pm.start, pm.a, pm.b, f, fx, fy, valid, pm.kind, TRANSFORMS, N_NODES,
                  hessian, coupling, grey)
    return ElementBlocks(hessian, coupling, grey)


def sparsity(pixel_map: PixelMap, size: int = 2) -> Pattern:
    """The pattern of H: every pair of nodes that share a visible element; ``place`` (n_elements, n_max, n_max).

    size : components per node.
    """
    conn, used = element_nodes(pixel_map)
    pairs = used[:, :, None] & used[:, None, :]
    rows, columns = np.broadcast_arrays(conn[:, :, None], conn[:, None, :])
    return block_pattern(rows, columns, pairs, pixel_map.n_nodes, pixel_map.n_nodes, size)


def element_nodes(pixel_map: PixelMap) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of every element, and which of the columns are nodes at all  # (n_elements, n_max) int64, bool"""
    n_max = int(N_NODES[pixel_map.kind].max())
    return pixel_map.conn[:, :n_max].astype(np.int64), np.arange(n_max) < N_NODES[pixel_map.kind][:, None]


def block_pattern(rows, columns, used, n_rows: int, n_columns: int, size: int | tuple[int, int] = 2) -> Pattern:
    """CSR pattern of a matrix of blocks at (rows, columns), arrays shaped as `used` (False: no entry).

    size : rows and columns of a block; one number: of both
    """
    n, m = (size, size) if isinstance(size, int) else size
    keys, inverse = np.unique(rows[used] * n_columns + columns[used], return_inverse=True)
    row, column = np.divmod(keys, n_columns)
    first = np.searchsorted(row, np.arange(n_rows + 1))  # first block of each row
    length = np.diff(first)
    start = n * m * first[row] + m * (np.arange(len(keys)) - first[row])  # (n_blocks,) of the upper left entry
    indices = np.empty(n * m * len(keys), dtype=np.int32)
    indptr = np.empty(n * n_rows + 1, dtype=np.int32)
    indptr[0::n] = n * m * first
    for i in range(n):
        for j in range(m):
            indices[start + m * i * length[row] + j] = m * column + j
        indptr[i:-1:n] = n * m * first[:-1] + m * i * length
    place = np.zeros(used.shape, dtype=np.int64)
    place[used] = start[inverse]
    return Pattern(indices, indptr, place, m * length)


@njit(cache=True, nogil=True)
def _element_sums(elements, start, a, b, f, fx, fy, valid, kind, transforms, n_nodes, hessian, coupling, grey):
    powers = np.empty((8, _PIXELS_PER_BLOCK), np.float32)
    weight = np.empty((5, _PIXELS_PER_BLOCK), np.float32)  # fx^2, fx fy, fy^2, f, 1
    slope = np.empty((2, _PIXELS_PER_BLOCK), np.float32)
    for index in range(elements.size):
        e = elements[index]
        n = n_nodes[kind[e]]
        products = np.zeros((8, 8, 3))
        moments = np.zeros((8, 2, 2))
        for s in range(start[e], start[e + 1], _PIXELS_PER_BLOCK):
            t = min(s + _PIXELS_PER_BLOCK, start[e + 1])
            keep = valid[s:t] if valid.size else valid
            _fill(a[s:t], b[s:t], f[s:t], fx[s:t], fy[s:t], keep, powers, weight, slope)
            _accumulate(powers, weight, slope, n, t - s, products, moments, grey[index])
        transform = transforms[kind[e]]
        to_nodes(products, transform, n, hessian[index])
        for i in range(n):
            for k in range(n):
                for c in range(2):
                    for m in range(2):
                        coupling[index, i, c, m] += transform[k, i] * moments[k, c, m]


@njit(cache=True, nogil=True)
def _fill(a, b, f, fx, fy, keep, powers, weight, slope):
    for k in range(a.size):
        p, q = a[k], b[k]
        w = np.float32(1.0)
        if keep.size and keep[k] == 0:
            w = np.float32(0.0)
        powers[0, k], powers[1, k], powers[2, k], powers[3, k] = np.float32(1.0), p, q, p * q
        powers[4, k], powers[5, k], powers[6, k], powers[7, k] = p * p, q * q, p * p * q, p * q * q
        x, y = w * fx[k], w * fy[k]
        slope[0, k], slope[1, k] = x, y
        weight[0, k], weight[1, k], weight[2, k], weight[3, k], weight[4, k] = x * x, x * y, y * y, w * f[k], w


@njit(cache=True, nogil=True, fastmath=_FAST)
def dot3(p, q, x, y, z):
    sx = sy = sz = np.float32(0.0)
    for k in range(p.size):
        m = p[k] * q[k]
        sx += m * x[k]
        sy += m * y[k]
        sz += m * z[k]
    return sx, sy, sz


@njit(cache=True, nogil=True)
def _accumulate(powers, weight, slope, n, count, products, moments, grey):
    ones, f = weight[4, :count], weight[3, :count]
    for k in range(n):
        p = powers[k, :count]
        for m in range(k + 1):
            xx, xy, yy = dot3(p, powers[m, :count], weight[0, :count], weight[1, :count], weight[2, :count])
            products[k, m, 0] += xx
            products[k, m, 1] += xy
            products[k, m, 2] += yy
        for c in range(2):
            with_f, with_one, _ = dot3(p, slope[c, :count], f, ones, ones)
            moments[k, c, 0] += with_f
            moments[k, c, 1] += with_one
    number, total, square = dot3(ones, powers[0, :count], ones, f, f)
    _, square, _ = dot3(f, powers[0, :count], ones, f, f)
    grey[0] += number
    grey[1] += total
    grey[2] += square


@njit(cache=True, nogil=True)
def to_nodes(products, transform, n, out):
    """sum_kl T[k, i] T[l, j] S[k, l] for j <= i of every component.

    products (>= n, >= n, n_components) holds the lower half of S; out (n (n + 1) / 2, n_components).
    """
    n_components = products.shape[2]
    half = np.zeros((n, n, n_components))
    for k in range(n):
        for m in range(n):
            source = products[k, m] if m <= k else products[m, k]
            for j in range(n):
                for c in range(n_components):
                    half[k, j, c] += transform[m, j] * source[c]
    for i in range(n):
        for j in range(i + 1):
            for k in range(n):
                for c in range(n_components):
                    out[i * (i + 1) // 2 + j, c] += transform[k, i] * half[k, j, c]
