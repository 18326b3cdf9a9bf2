"""Element kernels: deformation gradients out of nodal values, nodal forces and element matrices out of stresses.

Total Lagrangian, first Piola-Kirchhoff stress P. Points are numbered element by element; ``grads`` (n_points, nn, d)
holds dN/dX, ``weights`` (n_points,) the volumes (mm³; 2D: times the thickness). Serial and ``nogil``; the slow NumPy
versions are in ``tests/fe/test_kernels.py``.
"""

from __future__ import annotations

import numpy as np

from idic.fe.solver.compilation import kernel


@kernel
def deformation_gradients(connectivity, grads, u, F):
    """F = I + du/dX; u (n_nodes, d), F (n_points, d, d); returns the smallest determinant."""
    n_el, nn = connectivity.shape
    n_points, _, d = grads.shape
    nq = n_points // n_el
    smallest = np.inf
    for p in range(n_points):
        e = p // nq
        for i in range(d):
            for j in range(d):
                value = 1.0 if i == j else 0.0
                for a in range(nn):
                    value += u[connectivity[e, a], i] * grads[p, a, j]
                F[p, i, j] = value
        smallest = min(smallest, determinant(F[p]))
    return smallest


@kernel
def determinant(F):
    """Determinant of a 2 x 2 or 3 x 3 matrix."""
    if F.shape[0] == 2:
        return F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]
    return (F[0, 0] * (F[1, 1] * F[2, 2] - F[1, 2] * F[2, 1])
            - F[0, 1] * (F[1, 0] * F[2, 2] - F[1, 2] * F[2, 0])
            + F[0, 2] * (F[1, 0] * F[2, 1] - F[1, 1] * F[2, 0]))


@kernel
def gradient_changes(connectivity, grads, du, dF):
    """dF = d(du)/dX of several nodal fields; du (n_nodes, d, nd), dF (n_points, nd, d, d)."""
    n_el, nn = connectivity.shape
    n_points, _, d = grads.shape
    nq = n_points // n_el
    nd = du.shape[2]
    for p in range(n_points):
        e = p // nq
        for k in range(nd):
            for i in range(d):
                for j in range(d):
                    value = 0.0
                    for a in range(nn):
                        value += du[connectivity[e, a], i, k] * grads[p, a, j]
                    dF[p, k, i, j] = value


@kernel
def add_internal_forces(connectivity, grads, weights, P, force):
    """force[node, i] += sum over points of w P_ij dN/dX_j; force (n_nodes, d) N."""
    n_el, nn = connectivity.shape
    n_points, _, d = grads.shape
    nq = n_points // n_el
    for p in range(n_points):
        e = p // nq
        for a in range(nn):
            node = connectivity[e, a]
            for i in range(d):
                value = 0.0
                for j in range(d):
                    value += P[p, i, j] * grads[p, a, j]
                force[node, i] += weights[p] * value


@kernel
def add_internal_force_changes(connectivity, grads, weights, dP, force):
    """As `add_internal_forces` for several stress changes; dP (n_points, nd, d, d), force (n_nodes, d, nd)."""
    n_el, nn = connectivity.shape
    n_points, _, d = grads.shape
    nq = n_points // n_el
    nd = dP.shape[1]
    for p in range(n_points):
        e = p // nq
        for a in range(nn):
            node = connectivity[e, a]
            for i in range(d):
                for k in range(nd):
                    value = 0.0
                    for j in range(d):
                        value += dP[p, k, i, j] * grads[p, a, j]
                    force[node, i, k] += weights[p] * value


@kernel
def element_stiffness(grads, weights, A, Ke):
    """Ke[e, a d + i, b d + k] = sum over points of w dN_a/dX_j A[ij, kl] dN_b/dX_l; A (n_points, d d, d d)."""
    n_points, nn, d = grads.shape
    nq = n_points // Ke.shape[0]
    T = np.empty((d * d, nn * d))  # A[ij, kl] dN_b/dX_l
    for p in range(n_points):
        block = Ke[p // nq]
        if p % nq == 0:
            block[:] = 0.0
        for ij in range(d * d):
            for b in range(nn):
                for k in range(d):
                    value = 0.0
                    for m in range(d):
                        value += A[p, ij, k * d + m] * grads[p, b, m]
                    T[ij, b * d + k] = weights[p] * value
        for a in range(nn):
            for i in range(d):
                row = block[a * d + i]
                for j in range(d):
                    g = grads[p, a, j]
                    source = T[i * d + j]
                    for c in range(nn * d):
                        row[c] += g * source[c]


@kernel
def element_stiffness_plane(grads, weights, A, Ke):
    """As `element_stiffness` in two dimensions, with loops that the compiler vectorises.

    grads (n_points, nn, 2), A (n_points, 4, 4), Ke (n_el, 2 nn, 2 nn).
    """
    n_points, nn, _ = grads.shape
    n_el = Ke.shape[0]
    nq = n_points // n_el
    g, T, block = np.empty((2, nn)), np.empty((4, 2 * nn)), np.empty((2 * nn, 2 * nn))  # columns k nn + b
    for e in range(n_el):
        block[:] = 0.0
        for p in range(e * nq, (e + 1) * nq):
            for b in range(nn):
                g[0, b], g[1, b] = grads[p, b, 0], grads[p, b, 1]
            w = weights[p]
            for ij in range(4):
                for k in range(2):
                    x, y = w * A[p, ij, 2 * k], w * A[p, ij, 2 * k + 1]
                    row = T[ij, k * nn:(k + 1) * nn]
                    for b in range(nn):
                        row[b] = x * g[0, b] + y * g[1, b]
            for i in range(2):
                first, second = T[2 * i], T[2 * i + 1]
                for a in range(nn):
                    x, y = g[0, a], g[1, a]
                    row = block[2 * a + i]
                    for c in range(2 * nn):
                        row[c] += x * first[c] + y * second[c]
        for r in range(2 * nn):
            for k in range(2):
                for b in range(nn):
                    Ke[e, r, 2 * b + k] = block[r, k * nn + b]


@kernel
def add_stiffness_times(Ke, element_dofs, fields, out):
    """out += K fields by element matrices, all dofs; fields and out (n_dof, m)."""
    n_el, size = element_dofs.shape
    m = fields.shape[1]
    for e in range(n_el):
        for j in range(size):
            dof = element_dofs[e, j]
            for k in range(m):
                value = fields[dof, k]
                if value != 0.0:
                    for i in range(size):
                        out[element_dofs[e, i], k] += Ke[e, i, j] * value
