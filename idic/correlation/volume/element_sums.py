"""Sums of the reference scan over each element, and the nodal sums of a scan.

    H_e[i, j] = sum N_i N_j grad f (x) grad f     (3 x 3 per pair of nodes, stored as xx, xy, yy, xz, yz, zz for j <= i)
    g_e[i]    = sum N_i grad f (x) (f, 1)         (coupling to gain and offset)

A scan has the convected gradient: H_e -> F^-1 H_e F^-T (docs/method.md, equations 3.7 and 4.3).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from idic.correlation.pixels.blocks import dot3, to_nodes
from idic.correlation.volume.solid_cells import N_TERMS, fill_monomials, local_places
from idic.correlation.volume.volume_kernel import BUFFER, fill_places


@njit(cache=True, nogil=True)
def element_sums(elements, begin, kind, n_terms, transforms, run_start, run, start, affine, middle, places, table_start,
                 table, f, gx, gy, gz, valid, hessian, coupling, grey):
    """Sums of the elements over their valid voxels into hessian (n_elements, n_pairs, 6), coupling (n_elements, n_max,
    3, 2), grey (n_elements, 3: voxels, sum of f, sum of f^2); begin : voxel where f, gx, gy, gz, valid begin."""
    powers = np.zeros((N_TERMS, BUFFER), np.float32)
    x, y, z = np.empty(BUFFER, np.int32), np.empty(BUFFER, np.int32), np.empty(BUFFER, np.int32)
    place = np.empty((3, BUFFER), np.float32)
    weight, slope = np.empty((6, BUFFER), np.float32), np.empty((5, BUFFER), np.float32)
    for e in elements:
        n = n_terms[kind[e]]
        products, moments = np.zeros((n, n, 6)), np.zeros((n, 3, 2))
        j, passed, s = run_start[e], 0, start[e]
        grey[e, 0] = grey[e, 1] = grey[e, 2] = 0.0
        while s < start[e + 1]:
            t = min(s + BUFFER, start[e + 1])
            size, a, b = t - s, s - begin, t - begin
            j, passed = fill_places(run, j, passed, size, x, y, z)
            local_places(affine[e], middle[e], places[e], table, table_start[e] + s - start[e], size, x, y, z, place)
            fill_monomials(kind[e], place, size, powers)
            _weights(f[a:b], gx[a:b], gy[a:b], gz[a:b], valid[a:b], weight, slope)
            for k in range(n):
                for m in range(k + 1):
                    for half in range(0, 6, 3):
                        v0, v1, v2 = dot3(powers[k, :size], powers[m, :size], weight[half, :size],
                                           weight[half + 1, :size], weight[half + 2, :size])
                        products[k, m, half] += v0
                        products[k, m, half + 1] += v1
                        products[k, m, half + 2] += v2
                for c in range(3):
                    v0, v1, v2 = dot3(powers[k, :size], slope[c, :size], slope[3, :size], slope[4, :size],
                                       slope[4, :size])
                    moments[k, c, 0] += v0
                    moments[k, c, 1] += v1
            v0, v1, v2 = dot3(slope[4, :size], slope[4, :size], slope[4, :size], slope[3, :size], slope[3, :size])
            grey[e, 0] += v0
            grey[e, 1] += v1
            v0, v1, v2 = dot3(slope[3, :size], slope[4, :size], slope[3, :size], slope[3, :size], slope[3, :size])
            grey[e, 2] += v0
            s = t
        hessian[e, :n * (n + 1) // 2] = 0.0
        coupling[e] = 0.0
        to_nodes(products, transforms[kind[e]], n, hessian[e])
        for i in range(n):
            for k in range(n):
                for c in range(3):
                    for m in range(2):
                        coupling[e, i, c, m] += transforms[kind[e], k, i] * moments[k, c, m]


@njit(cache=True, nogil=True)
def _weights(f, gx, gy, gz, valid, weight, slope):
    for k in range(f.size):
        w = np.float32(valid[k])
        x, y, z = w * gx[k], w * gy[k], w * gz[k]
        weight[0, k], weight[1, k], weight[2, k] = x * x, x * y, y * y
        weight[3, k], weight[4, k], weight[5, k] = x * z, y * z, z * z
        slope[0, k], slope[1, k], slope[2, k], slope[3, k], slope[4, k] = x, y, z, w * f[k], w


@njit(cache=True, nogil=True)
def scatter(conn, kind, n_nodes, transforms, inverse, sums, coupling, centre, place_b, stride_b, q, data_b):
    """Element sums -> nodes, with the convected gradient: d_new[c] = sum_k inverse[k, c] d[k] (F^-T d)."""
    d, n_max = np.empty(3), conn.shape[1]
    for e in range(conn.shape[0]):
        n = n_nodes[kind[e]]
        t, G = transforms[kind[e]], inverse[e]
        for i in range(n):
            node = conn[e, i]
            d[:] = 0.0
            for k in range(n):
                for c in range(3):
                    d[c] += t[k, i] * sums[e, c * n_max + k]
            for c in range(3):
                q[3 * node + c] += G[0, c] * d[0] + G[1, c] * d[1] + G[2, c] * d[2]
            for m in range(2):  # columns -f_centred, -1
                for c in range(3):
                    d[c] = coupling[e, i, c, m] - (centre[e] * coupling[e, i, c, 1] if m == 0 else 0.0)
                for c in range(3):
                    data_b[place_b[e, i] + c * stride_b[node] + m] -= G[0, c] * d[0] + G[1, c] * d[1] + G[2, c] * d[2]


@njit(cache=True, nogil=True)
def scatter_matrix(conn, kind, n_nodes, inverse, hessian, place, stride, data):
    """The matrix of the nodes from the blocks of the elements: F^-1 D F^-T of each pair of nodes."""
    D, half = np.empty((3, 3)), np.empty((3, 3))
    for e in range(conn.shape[0]):
        G = inverse[e]
        for i in range(n_nodes[kind[e]]):
            node = conn[e, i]
            for j in range(i + 1):
                xx, xy, yy, xz, yz, zz = hessian[e, i * (i + 1) // 2 + j]
                D[0, 0], D[0, 1], D[0, 2] = xx, xy, xz
                D[1, 0], D[1, 1], D[1, 2] = xy, yy, yz
                D[2, 0], D[2, 1], D[2, 2] = xz, yz, zz
                for r in range(3):
                    for c in range(3):
                        half[r, c] = D[r, 0] * G[0, c] + D[r, 1] * G[1, c] + D[r, 2] * G[2, c]
                for r in range(3):
                    for c in range(3):
                        value = G[0, r] * half[0, c] + G[1, r] * half[1, c] + G[2, r] * half[2, c]
                        data[place[e, i, j] + r * stride[node] + c] += value
                        if j < i:  # symmetric: so is every block
                            data[place[e, j, i] + r * stride[conn[e, j]] + c] += value
