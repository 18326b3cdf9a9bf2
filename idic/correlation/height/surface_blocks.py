"""Sums of a reference height image over each element, carried to the nodes under a finite motion.

    D_e[i, j] = sum_px N_i N_j d d^T,       d = (f_x, f_y, -1)          (3 x 3 per pair of nodes)

A frame's own blocks follow without a pixel: with the convected gradient

    L phi = F^-T (grad f + grad h) . phi_xy - phi_h = d . G phi,        G = [F^-1, 0; -(grad h)^T F^-1, 1]

so H_e = G^T D_e G and q_e = G^T sum N d r, with F and grad h at the centre of the element (docs/method.md, equations
9.3 and 9.4).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from idic.correlation.pixels.blocks import dot3, to_nodes
from idic.correlation.pixels.cells import N_NODES, TRANSFORMS
from idic.correlation.pixels.pixel_map import PixelMap

_PIXELS_PER_BLOCK = 256


def height_blocks(pixel_map: PixelMap, fx, fy, elements=None, valid=None) -> np.ndarray:
    """Blocks D of these elements (all of them where None) from their valid pixels.

    fx, fy: float32 (n_pixels,); elements (n,); valid (n_pixels,) uint8.

    Returns
    -------
    array (n, n_pairs, 6)
        xx, xy, yy, xz, yz, zz of node pair i (i + 1) / 2 + j, j <= i; z is the height.
    """
    pm = pixel_map
    elements = np.arange(pm.n_elements) if elements is None else np.asarray(elements, dtype=np.int64)
    valid = np.ones(0, dtype=np.uint8) if valid is None else valid
    n_max = int(N_NODES[pm.kind].max())
    blocks = np.zeros((len(elements), n_max * (n_max + 1) // 2, 6))
    _block_sums(elements, pm.start, pm.a, pm.b, fx, fy, valid, pm.kind, TRANSFORMS, N_NODES, blocks)
    return blocks


@njit(cache=True, nogil=True)
def _block_sums(elements, start, a, b, fx, fy, valid, kind, transforms, n_nodes, out):
    powers = np.empty((8, _PIXELS_PER_BLOCK), np.float32)
    weight = np.empty((6, _PIXELS_PER_BLOCK), np.float32)
    for index in range(elements.size):
        e = elements[index]
        n = n_nodes[kind[e]]
        products = np.zeros((8, 8, 6))
        for s in range(start[e], start[e + 1], _PIXELS_PER_BLOCK):
            t = min(s + _PIXELS_PER_BLOCK, start[e + 1])
            keep = valid[s:t] if valid.size else valid
            _fill(a[s:t], b[s:t], fx[s:t], fy[s:t], keep, powers, weight)
            for k in range(n):
                p = powers[k, :t - s]
                for m in range(k + 1):
                    q = powers[m, :t - s]
                    for half in range(0, 6, 3):
                        x, y, z = dot3(p, q, weight[half, :t - s], weight[half + 1, :t - s], weight[half + 2, :t - s])
                        products[k, m, half] += x
                        products[k, m, half + 1] += y
                        products[k, m, half + 2] += z
        to_nodes(products, transforms[kind[e]], n, out[index])


@njit(cache=True, nogil=True)
def _fill(a, b, fx, fy, keep, powers, weight):
    for k in range(a.size):
        p, q = a[k], b[k]
        w = np.float32(1.0)
        if keep.size and keep[k] == 0:
            w = np.float32(0.0)
        powers[0, k], powers[1, k], powers[2, k], powers[3, k] = np.float32(1.0), p, q, p * q
        powers[4, k], powers[5, k], powers[6, k], powers[7, k] = p * p, q * q, p * p * q, p * q * q
        x, y = w * fx[k], w * fy[k]
        weight[0, k], weight[1, k], weight[2, k] = x * x, x * y, y * y
        weight[3, k], weight[4, k], weight[5, k] = -x, -y, w


@njit(cache=True, nogil=True)
def convection(motion, centre, inverse_jacobian, inverse, out):
    """G of every element  # motion (n_elements, 3, 8), inverse: F^-1 (n_elements, 2, 2) -> out (n_elements, 3, 3)"""
    for e in range(motion.shape[0]):
        a, b = centre[e]
        m = motion[e, 2]
        by_a = m[1] + b * m[3] + 2.0 * a * m[4] + 2.0 * a * b * m[6] + b * b * m[7]
        by_b = m[2] + a * m[3] + 2.0 * b * m[5] + a * a * m[6] + 2.0 * a * b * m[7]
        x = by_a * inverse_jacobian[e, 0, 0] + by_b * inverse_jacobian[e, 1, 0]
        y = by_a * inverse_jacobian[e, 0, 1] + by_b * inverse_jacobian[e, 1, 1]
        out[e] = 0.0
        out[e, 2, 2] = 1.0
        for c in range(2):
            out[e, 0, c], out[e, 1, c] = inverse[e, 0, c], inverse[e, 1, c]
            out[e, 2, c] = -(x * inverse[e, 0, c] + y * inverse[e, 1, c])


@njit(cache=True, nogil=True)
def scatter(conn, kind, n_nodes, transforms, G, sums, slot, blocks, blocks_lost, place, stride, q, data):
    """Element sums -> nodes: q += G^T sum N d r, H += G^T D G. slot[e] = -1: the full block of the element holds."""
    D, half = np.empty((3, 3)), np.empty((3, 3))
    d = np.empty(3)
    for e in range(conn.shape[0]):
        n = n_nodes[kind[e]]
        t = transforms[kind[e]]
        pairs = blocks[e] if slot[e] < 0 else blocks_lost[slot[e]]
        for i in range(n):
            node = conn[e, i]
            d[:] = 0.0
            for k in range(n):
                d[0] += t[k, i] * sums[e, k]
                d[1] += t[k, i] * sums[e, 8 + k]
                d[2] -= t[k, i] * sums[e, 16 + k]
            for c in range(3):
                q[3 * node + c] += G[e, 0, c] * d[0] + G[e, 1, c] * d[1] + G[e, 2, c] * d[2]
            for j in range(i + 1):
                xx, xy, yy, xz, yz, zz = pairs[i * (i + 1) // 2 + j]
                D[0, 0], D[0, 1], D[0, 2] = xx, xy, xz
                D[1, 0], D[1, 1], D[1, 2] = xy, yy, yz
                D[2, 0], D[2, 1], D[2, 2] = xz, yz, zz
                for r in range(3):
                    for c in range(3):
                        half[r, c] = D[r, 0] * G[e, 0, c] + D[r, 1] * G[e, 1, c] + D[r, 2] * G[e, 2, c]
                for r in range(3):
                    for c in range(3):
                        value = G[e, 0, r] * half[0, c] + G[e, 1, r] * half[1, c] + G[e, 2, r] * half[2, c]
                        data[place[e, i, j] + r * stride[node] + c] += value
                        if j < i:  # symmetric: so is every block
                            data[place[e, j, i] + r * stride[conn[e, j]] + c] += value
