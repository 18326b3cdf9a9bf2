"""The hot element kernels for three dimensions: as in ``kernels.py``, with loops that the compiler can vectorise.

Gradients of a point are turned to (3, nn), so that the innermost loop runs over the nodes of the element in order.
"""

from __future__ import annotations

import numpy as np

from idic.fe.solver.compilation import kernel


@kernel
def element_stiffness(grads, weights, A, Ke):
    """As `kernels.element_stiffness`; grads (n_points, nn, 3), A (n_points, 9, 9), Ke (n_el, 3 nn, 3 nn)."""
    n_points, nn, _ = grads.shape
    n_el = Ke.shape[0]
    nq = n_points // n_el
    g, T, block = np.empty((3, nn)), np.empty((9, 3 * nn)), np.empty((3 * nn, 3 * nn))  # columns k nn + b
    for e in range(n_el):
        block[:] = 0.0
        for p in range(e * nq, (e + 1) * nq):
            for b in range(nn):
                g[0, b], g[1, b], g[2, b] = grads[p, b, 0], grads[p, b, 1], grads[p, b, 2]
            w = weights[p]
            for ij in range(9):
                for k in range(3):
                    x, y, z = w * A[p, ij, 3 * k], w * A[p, ij, 3 * k + 1], w * A[p, ij, 3 * k + 2]
                    row = T[ij, k * nn:(k + 1) * nn]
                    for b in range(nn):
                        row[b] = x * g[0, b] + y * g[1, b] + z * g[2, b]
            for i in range(3):
                first, second, third = T[3 * i], T[3 * i + 1], T[3 * i + 2]
                for a in range(nn):
                    x, y, z = g[0, a], g[1, a], g[2, a]
                    row = block[3 * a + i]
                    for c in range(3 * nn):
                        row[c] += x * first[c] + y * second[c] + z * third[c]
        for r in range(3 * nn):
            for k in range(3):
                for b in range(nn):
                    Ke[e, r, 3 * b + k] = block[r, k * nn + b]


@kernel
def tangent_finite(F, scale, Jbar, grads, weights, P_eff, A, g):
    """As `locking.tangent_finite`, with the powers of c outside of all loops."""
    n_points, nn, _ = grads.shape
    n_el = g.shape[0]
    nq = n_points // n_el
    Q, inverse = np.empty(9), np.empty(9)
    g[:] = 0.0
    for p in range(n_points):
        e = p // nq
        c = scale[p]
        f = F[p]
        J = (f[0, 0] * (f[1, 1] * f[2, 2] - f[1, 2] * f[2, 1]) - f[0, 1] * (f[1, 0] * f[2, 2] - f[1, 2] * f[2, 0])
             + f[0, 2] * (f[1, 0] * f[2, 1] - f[1, 1] * f[2, 0]))
        for i in range(3):  # F^-T
            i1, i2 = (i + 1) % 3, (i + 2) % 3
            for j in range(3):
                j1, j2 = (j + 1) % 3, (j + 2) % 3
                inverse[3 * i + j] = (f[i1, j1] * f[i2, j2] - f[i1, j2] * f[i2, j1]) / J
        over, square = 1.0 / c, 1.0 / (c * c)
        for ij in range(9):
            value = 0.0
            for k in range(3):
                value += (A[p, ij, 3 * k] * f[k, 0] + A[p, ij, 3 * k + 1] * f[k, 1] + A[p, ij, 3 * k + 2] * f[k, 2])
            Q[ij] = square * value - 2.0 * over * P_eff[p, ij // 3, ij % 3]
            factor = c / 3.0 * Q[ij]
            row = A[p, ij]
            for kl in range(9):
                row[kl] = over * row[kl] - factor * inverse[kl]
        factor = weights[p] * c / (3.0 * Jbar[e])
        for a in range(nn):
            x, y, z = factor * grads[p, a, 0], factor * grads[p, a, 1], factor * grads[p, a, 2]
            for i in range(3):
                g[e, 3 * a + i] += Q[3 * i] * x + Q[3 * i + 1] * y + Q[3 * i + 2] * z


@kernel
def gradient_changes(connectivity, grads, du, dF):
    """As `kernels.gradient_changes`; the nodal values of an element are gathered once."""
    n_el, nn = connectivity.shape
    n_points = grads.shape[0]
    nq = n_points // n_el
    nd = du.shape[2]
    local, total = np.empty((nn, 3, nd)), np.empty((3, 3, nd))
    for e in range(n_el):
        for a in range(nn):
            local[a] = du[connectivity[e, a]]
        for p in range(e * nq, (e + 1) * nq):
            total[:] = 0.0
            for a in range(nn):
                for i in range(3):
                    source = local[a, i]
                    for j in range(3):
                        x, row = grads[p, a, j], total[i, j]
                        for k in range(nd):
                            row[k] += x * source[k]
            for k in range(nd):
                for i in range(3):
                    for j in range(3):
                        dF[p, k, i, j] = total[i, j, k]


@kernel
def add_internal_force_changes(connectivity, grads, weights, dP, force):
    """As `kernels.add_internal_force_changes`; the forces of an element are summed before they are added."""
    n_el, nn = connectivity.shape
    n_points = grads.shape[0]
    nq = n_points // n_el
    nd = dP.shape[1]
    stress, total = np.empty((3, 3, nd)), np.empty((nn, 3, nd))
    for e in range(n_el):
        total[:] = 0.0
        for p in range(e * nq, (e + 1) * nq):
            w = weights[p]
            for k in range(nd):
                for i in range(3):
                    for j in range(3):
                        stress[i, j, k] = w * dP[p, k, i, j]
            for a in range(nn):
                x, y, z = grads[p, a, 0], grads[p, a, 1], grads[p, a, 2]
                for i in range(3):
                    row, first, second, third = total[a, i], stress[i, 0], stress[i, 1], stress[i, 2]
                    for k in range(nd):
                        row[k] += x * first[k] + y * second[k] + z * third[k]
        for a in range(nn):
            force[connectivity[e, a]] += total[a]
