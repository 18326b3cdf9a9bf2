"""Solutions with the factors of fronts: substitution from the leaves of the tree to its root and back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg.blas import dgemm, dtrsm
from scipy.linalg.lapack import dlaswp

from idic.fe.solver.compilation import kernel
from idic.fe.solver.lapack import product
from idic.fe.solver.multifrontal import Front, FrontFactor, independent_parts
from idic.fe.solver.threads import pool_of_threads

MIN_FRONTS_FOR_THREADS = 200  # a solution reads each front once: smaller trees are not worth it


def solve(fronts: Sequence[Front], factors: Sequence[FrontFactor], rhs: np.ndarray) -> np.ndarray:
    """Solutions for right-hand sides (n, m); with threads side by side as in `factor`, with the same bits."""
    x, pool = np.array(rhs, dtype=float, order="F"), pool_of_threads()
    if pool is None or len(fronts) < MIN_FRONTS_FOR_THREADS:
        _forward(fronts, factors, x)
        _backward(fronts, factors, x)
        return x
    parts = independent_parts(fronts, pool._max_workers)
    beneath = {k for first, end in parts for k in range(first, end)}
    above = [(k, k + 1) for k in range(len(fronts)) if k not in beneath]
    contributions = dict(zip(parts, pool.map(lambda span: _forward_beneath(fronts, factors, x, span), parts),
                             strict=True))
    for span in sorted([*parts, *above]):  # what reaches the fronts above is subtracted in the order of the fronts
        if span in contributions:
            for equations, share in contributions[span]:
                x[equations] -= share
        else:
            _forward(fronts[slice(*span)], factors[slice(*span)], x)
    for span in reversed(above):
        _backward(fronts[slice(*span)], factors[slice(*span)], x)
    list(pool.map(lambda span: _backward(fronts[slice(*span)], factors[slice(*span)], x), parts))
    return x


def _forward(fronts: Sequence[Front], factors: Sequence[FrontFactor], x: np.ndarray) -> None:
    """Forward substitution."""
    if x.shape[1] == 1:
        column, share = x[:, 0], np.empty(max((f.b for f in factors), default=0))
        at, share_address = x.ctypes.data, share.ctypes.data
        for front, f in zip(fronts, factors, strict=True):
            f.forward(at + 8 * front.first, share_address)
            column[front.boundary] -= share[:f.b]
        return
    for front, f in zip(fronts, factors, strict=True):
        f.eliminate_from(x[front.first:front.end])
        if len(front.boundary):
            x[front.boundary] -= product(f.block("lower"), x[front.first:front.end])


def _forward_beneath(fronts: Sequence[Front], factors: Sequence[FrontFactor], x: np.ndarray,
                     span: tuple[int, int]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Forward substitution in a span; returns the changes of the right-hand sides of later equations, in order."""
    beyond, end = [], fronts[span[1] - 1].end
    for k in range(*span):
        front, f = fronts[k], factors[k]
        f.eliminate_from(x[front.first:front.end])
        if len(front.boundary):
            share = product(f.block("lower"), x[front.first:front.end])
            inside = int(np.searchsorted(front.boundary, end))
            x[front.boundary[:inside]] -= share[:inside]
            beyond.append((front.boundary[inside:], share[inside:]))
    return beyond


def _backward(fronts: Sequence[Front], factors: Sequence[FrontFactor], x: np.ndarray) -> None:
    """Backward substitution."""
    if x.shape[1] == 1:
        column, share = x[:, 0], np.empty(max((f.s for f in factors), default=0))
        at, share_address = x.ctypes.data, share.ctypes.data
        for front, f in zip(reversed(fronts), reversed(factors), strict=True):
            if f.b:
                beyond = column[front.boundary]
                f.carried(beyond.ctypes.data, share_address)
                column[front.first:front.end] -= share[:f.s]
            f.backward(at + 8 * front.first)
        return
    for front, f in zip(reversed(fronts), reversed(factors), strict=True):
        f.substitute_in(x[front.first:front.end], np.asfortranarray(x[front.boundary]))


def solve_transposed(fronts: Sequence[Front], factors: Sequence[FrontFactor], rhs: np.ndarray) -> np.ndarray:
    """Solutions with the transposed matrix for right-hand sides (n, m)."""
    x = np.array(rhs, dtype=float, order="F")
    for front, f in zip(fronts, factors, strict=True):
        y = dtrsm(1.0, f.block("lu"), x[front.first:front.end], trans_a=1)
        x[front.first:front.end] = y
        if len(front.boundary):
            x[front.boundary] -= dgemm(1.0, f.block("upper"), y, trans_a=1)
    for front, f in zip(reversed(fronts), reversed(factors), strict=True):
        y = x[front.first:front.end]
        if len(front.boundary):
            y = y - dgemm(1.0, f.block("lower"), x[front.boundary], trans_a=1)
        y = dtrsm(1.0, f.block("lu"), y, lower=1, diag=1, trans_a=1)
        x[front.first:front.end] = dlaswp(y, f.exchanges, inc=-1)
    return x


@kernel
def backward_error(indptr, indices, values, solution, rhs):
    """Residual of a system in compressed columns relative to the size of its terms, largest values: about 1e-16 if the
    solution (n,) is exact."""
    n = rhs.shape[0]
    residual, size = -rhs, np.zeros(n)
    for column in range(n):
        for k in range(indptr[column], indptr[column + 1]):
            residual[indices[k]] += values[k] * solution[column]
            size[indices[k]] += abs(values[k])
    scale = size.max() * np.abs(solution).max() + np.abs(rhs).max() if n else 0.0
    return np.abs(residual).max() / scale if scale > 0.0 else 0.0
