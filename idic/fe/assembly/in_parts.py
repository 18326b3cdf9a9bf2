"""Points of large models in parts, one for each thread; the results have the same bits as in one part."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from idic.fe.solver.threads import pool_of_threads
from idic.laws import directional_stresses, point_tangents

MIN_POINTS = 20_000  # of a group that is worth threads


def in_parts(n_elements: int, n_points: int, work: Callable[[slice, slice], object]) -> list:
    """What ``work(elements, points)`` returns for parts of the elements and their points, in order."""
    pool, points_per_element = pool_of_threads(), n_points // max(1, n_elements)
    if pool is None or n_points < MIN_POINTS:
        return [work(slice(0, n_elements), slice(0, n_points))]
    ends = np.linspace(0, n_elements, 2 * pool._max_workers + 1).astype(int).tolist()
    spans = [(slice(a, b), slice(a * points_per_element, b * points_per_element)) for a, b in pairwise(ends)]
    return list(pool.map(lambda span: work(*span), spans))


def tangent(law, mode: int, F, state, params, dt: float, guess=None):
    """As `points.tangent`."""
    n, d = F.shape[:2]
    P, state_new, A = np.empty_like(F), np.empty_like(state), np.empty((n, d * d, d * d))

    def part(_, at):
        return point_tangents(law, mode, F[at], state[at], _of(params, at), dt, guess=_of_guess(guess, at),
                              out=(P[at], state_new[at], A[at]))[-1]

    return P, state_new, A, all(in_parts(n, n, part))


def directional(law, mode: int, F, state, params, dt: float, dF, dstate, dparams, guess=None):
    """As `points.directional`."""
    n, nd = dF.shape[:2]
    dP, dstate_new = np.empty_like(dF), np.empty((n, nd, state.shape[1]))

    def part(_, at):
        changes = dparams[at] if dparams is not None and dparams.ndim == 3 and len(dparams) == n else dparams
        return directional_stresses(law, mode, F[at], state[at], _of(params, at), dt, dF[at],
                                  None if dstate is None else dstate[at], changes, guess=_of_guess(guess, at),
                                  out=(dP[at], dstate_new[at]))[-1]

    return dP, dstate_new, all(in_parts(n, n, part))


def _of(params: np.ndarray, at: slice) -> np.ndarray:
    return params[at] if np.ndim(params) == 2 and len(params) > 1 else params


def _of_guess(guess: np.ndarray | None, at: slice) -> np.ndarray | None:
    return None if guess is None else guess[at]
