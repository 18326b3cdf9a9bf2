"""The remedy against volumetric locking: mean dilatation, as B-bar (small strain) and F-bar (finite strain).

The volume change of a point is replaced by the mean over its element. With m = 3 (solid) or 2 (plane strain, in plane):

* finite: F -> c F, c = (Jbar/J)^(1/m), Jbar = sum(w J)/sum(w), and ``P_eff = c^(1-m) P(c F)``, which is the Cauchy
  stress of the modified deformation acting on the true one (de Souza Neto et al. 1996,
  doi:10.1016/0020-7683(95)00259-6, with the mean instead of the centroid value). The tangent is unsymmetric.
* small: grad u -> grad u + (mean(div u) - div u)/m I, and its transpose on the stress (Hughes 1980,
  doi:10.1002/nme.1620150914). The tangent is symmetric.

Both add a rank-one term per element, carried by the vector b = d Jbar / d u (small: of the mean divergence).
"""

from __future__ import annotations

import numpy as np

from idic.fe.solver.compilation import kernel


@kernel
def inverse_transpose(F, out):
    """out = F^-T; returns det F."""
    if F.shape[0] == 2:
        det = F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]
        out[0, 0], out[0, 1] = F[1, 1] / det, -F[1, 0] / det
        out[1, 0], out[1, 1] = -F[0, 1] / det, F[0, 0] / det
        return det
    det = 0.0
    for j in range(3):
        j1, j2 = (j + 1) % 3, (j + 2) % 3
        det += F[0, j] * (F[1, j1] * F[2, j2] - F[1, j2] * F[2, j1])
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            j1, j2 = (j + 1) % 3, (j + 2) % 3
            out[i, j] = (F[i1, j1] * F[i2, j2] - F[i1, j2] * F[i2, j1]) / det
    return det


@kernel
def modify_finite(F, grads, weights, Fbar, scale, b, Jbar):
    """Fbar = c F; scale (n_points,) = c, b (n_el, nn d) = d Jbar/du, Jbar (n_el,)."""
    n_points, nn, d = grads.shape
    n_el = b.shape[0]
    nq = n_points // n_el
    inverse = np.empty((d, d))
    for e in range(n_el):
        volume, reference = 0.0, 0.0
        b[e] = 0.0
        for p in range(e * nq, (e + 1) * nq):
            J = inverse_transpose(F[p], inverse)
            scale[p] = J
            volume += weights[p] * J
            reference += weights[p]
            for a in range(nn):
                for i in range(d):
                    value = 0.0
                    for j in range(d):
                        value += inverse[i, j] * grads[p, a, j]
                    b[e, a * d + i] += weights[p] * J * value
        Jbar[e] = volume / reference
        for c in range(nn * d):
            b[e, c] /= reference
        for p in range(e * nq, (e + 1) * nq):
            scale[p] = (Jbar[e] / scale[p]) ** (1.0 / d)
            for i in range(d):
                for j in range(d):
                    Fbar[p, i, j] = scale[p] * F[p, i, j]


@kernel
def stress_finite(scale, d, P):
    """P -> P_eff in place; P (n_points, ...)."""
    for p in range(scale.shape[0]):
        P[p] *= scale[p] ** (1 - d)


@kernel
def tangent_finite(F, scale, Jbar, grads, weights, P_eff, A, g):
    """A -> A_eff in place, g (n_el, nn d) = nodal forces per Jbar: K_e gets + g (x) b."""
    n_points, nn, d = grads.shape
    n_el = g.shape[0]
    nq = n_points // n_el
    inverse = np.empty((d, d))
    Q = np.empty(d * d)
    g[:] = 0.0
    for p in range(n_points):
        e = p // nq
        c = scale[p]
        inverse_transpose(F[p], inverse)
        for ij in range(d * d):  # Q = c^(1-m) A : F - (m - 1) P_eff / c
            value = 0.0
            for kl in range(d * d):
                value += A[p, ij, kl] * F[p, kl // d, kl % d]
            Q[ij] = c ** (1 - d) * value - (d - 1) / c * P_eff[p, ij // d, ij % d]
        for ij in range(d * d):
            for kl in range(d * d):
                A[p, ij, kl] = c ** (2 - d) * A[p, ij, kl] - c / d * Q[ij] * inverse[kl // d, kl % d]
        for a in range(nn):
            for i in range(d):
                value = 0.0
                for j in range(d):
                    value += Q[i * d + j] * grads[p, a, j]
                g[e, a * d + i] += weights[p] * c / (d * Jbar[e]) * value


@kernel
def changes_finite(F, scale, Jbar, weights, dF):
    """dF -> dFbar in place; dF (n_points, nd, d, d)."""
    n_points, nd, d, _ = dF.shape
    n_el = Jbar.shape[0]
    nq = n_points // n_el
    inverse = np.empty((d, d))
    rate = np.empty((nq, nd))  # F^-T : dF
    for e in range(n_el):
        reference = 0.0
        mean = np.zeros(nd)
        for q in range(nq):
            p = e * nq + q
            J = inverse_transpose(F[p], inverse)
            reference += weights[p]
            for k in range(nd):
                value = 0.0
                for i in range(d):
                    for j in range(d):
                        value += inverse[i, j] * dF[p, k, i, j]
                rate[q, k] = value
                mean[k] += weights[p] * J * rate[q, k]
        for q in range(nq):
            p = e * nq + q
            for k in range(nd):
                dc = scale[p] / d * (mean[k] / (reference * Jbar[e]) - rate[q, k])
                for i in range(d):
                    for j in range(d):
                        dF[p, k, i, j] = scale[p] * dF[p, k, i, j] + dc * F[p, i, j]


@kernel
def mean_divergence(grads, weights, b):
    """b (n_el, nn d) = d(mean divergence)/du: the element mean of dN/dX."""
    n_points, nn, d = grads.shape
    n_el = b.shape[0]
    nq = n_points // n_el
    b[:] = 0.0
    for e in range(n_el):
        reference = 0.0
        for p in range(e * nq, (e + 1) * nq):
            reference += weights[p]
        for p in range(e * nq, (e + 1) * nq):
            for a in range(nn):
                for i in range(d):
                    b[e, a * d + i] += weights[p] / reference * grads[p, a, i]


@kernel
def average_trace(M, weights, n_el):
    """Replace trace/d of M (n_points, nd, d, d) by its element mean, in place (its own transpose under weights)."""
    n_points, nd, d, _ = M.shape
    nq = n_points // n_el
    for e in range(n_el):
        for k in range(nd):
            mean, reference = 0.0, 0.0
            for p in range(e * nq, (e + 1) * nq):
                for i in range(d):
                    mean += weights[p] * M[p, k, i, i]
                reference += weights[p]
            mean /= reference
            for p in range(e * nq, (e + 1) * nq):
                trace = 0.0
                for i in range(d):
                    trace += M[p, k, i, i]
                for i in range(d):
                    M[p, k, i, i] += (mean - trace) / d


@kernel
def tangent_small(grads, weights, A, g1, g2, s):
    """A -> D A D in place (D: deviator), and K_e gets + g1 (x) b + b (x) g2 + s b (x) b; g (n_el, nn d), s (n_el,)."""
    n_points, nn, d = grads.shape
    n_el = g1.shape[0]
    nq = n_points // n_el
    left_trace, right_trace = np.empty(d * d), np.empty(d * d)
    g1[:] = 0.0
    g2[:] = 0.0
    s[:] = 0.0
    for p in range(n_points):
        e = p // nq
        double_trace = 0.0
        for ij in range(d * d):
            left_trace[ij], right_trace[ij] = 0.0, 0.0
            for k in range(d):
                left_trace[ij] += A[p, ij, k * d + k] / d  # A : I / m
                right_trace[ij] += A[p, k * d + k, ij] / d  # I : A / m
        for k in range(d):
            double_trace += left_trace[k * d + k] / d
        for ij in range(d * d):
            for kl in range(d * d):
                if ij % (d + 1) == 0:
                    A[p, ij, kl] -= right_trace[kl]
                if kl % (d + 1) == 0:
                    A[p, ij, kl] -= left_trace[ij]
                if ij % (d + 1) == 0 and kl % (d + 1) == 0:
                    A[p, ij, kl] += double_trace
        s[e] += weights[p] * double_trace
        for k in range(d):
            left_trace[k * d + k] -= double_trace
            right_trace[k * d + k] -= double_trace
        for a in range(nn):
            for i in range(d):
                first, second = 0.0, 0.0
                for j in range(d):
                    first += left_trace[i * d + j] * grads[p, a, j]
                    second += right_trace[i * d + j] * grads[p, a, j]
                g1[e, a * d + i] += weights[p] * first
                g2[e, a * d + i] += weights[p] * second


@kernel
def add_rank_one(column, row, Ke):
    """Ke[e] += column[e] (x) row[e]."""
    for e in range(Ke.shape[0]):
        for i in range(Ke.shape[1]):
            for j in range(Ke.shape[2]):
                Ke[e, i, j] += column[e, i] * row[e, j]
