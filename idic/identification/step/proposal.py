"""One damped Gauss–Newton step on scaled unknowns: Levenberg–Marquardt, of limited size, within bounds.

A step longer than the limit is damped in every direction alike (a multiple of the identity in the scaled unknowns, ln
of a positive parameter) until no component is longer. Strong directions then move first and at full length; weak ones
wait, since far from the solution their Gauss-Newton step is an answer to the errors of the strong ones (docs/method.md,
equation 10.1; Moré 1978, doi:10.1007/BFb0067700). Clipping every component instead sends 5 of 20 random starts of the
bulge test along a narrow curved valley until their iterations are used up. A parameter with its own largest step (a
viscosity, of which only the logarithm matters) is measured by that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from idic.identification.step.parameter_covariance import Scaled, Spectrum
from idic.identification.step.rising import in_order
from idic.parameters import USUAL_MAX_STEP, ParameterSet

STEP_CLIP = USUAL_MAX_STEP  # per component in ln(parameter)
STEP_LIMIT_TOLERANCE = 1e-2  # how closely a step of limited size keeps to its limit
MIN_RIDGE_SHARE, MAX_RIDGE_SHARE = 1e-16, 1e8  # of the largest diagonal entry of M
RELEASE_TOLERANCE = 1e-9  # of the largest component of b, each over the root of its diagonal entry of M


@dataclass(frozen=True)
class Step:
    """A proposed change of the free parameters.

    delta : (n,) scaled, of limited size; relative : the largest unlimited Gauss–Newton component over its standard
    deviation, by which convergence is judged; largest : that component itself; significance : `relative` of `delta`;
    predicted : decrease of phi by the quadratic model; gain : the same of the undamped, unlimited step; clipped :
    whether the limit has shortened the step; pinned : the parameters that the undamped step carries over a bound.
    """

    delta: np.ndarray
    relative: float
    largest: float
    significance: float
    predicted: float
    gain: float
    clipped: bool
    pinned: tuple[str, ...]


def propose(scaled: Scaled, directions: Spectrum, stds: np.ndarray, parameters: ParameterSet, damping: float,
            clip: float | None = None, allowed: np.ndarray | None = None) -> Step:
    """The step from the present point; `damping` multiplies the diagonal of M (0 = Gauss–Newton).

    Components that would leave their bounds, or exceed their own largest step, are pinned there and the others solved
    again.
    allowed : (n,) bool, the eigen-directions to step along (None: all that the data determine); all of them judge
    convergence.
    """
    unknowns = parameters.with_free(scaled.names)
    low, high = (limits[[unknowns.free.index(name) for name in scaled.names]] for limits in unknowns.scaled_bounds())
    values = np.array([parameters[name].to_scaled() for name in scaled.names])
    judged, at_bounds = _bounded(scaled, directions, 0.0, values, low, high)  # undamped: whether this is a minimum
    judged = in_order(scaled, parameters, values, judged)
    along = directions if allowed is None else replace(directions, determined=directions.determined & allowed)
    is_judged = damping == 0.0 and (along is directions or bool(np.all(along.determined == directions.determined)))
    limit = STEP_CLIP if clip is None else clip
    sizes = np.array([parameters[name].max_step for name in scaled.names]) / USUAL_MAX_STEP  # of their steps
    short = np.where(sizes < 1.0, limit * sizes, np.inf)
    low, high = np.maximum(low, values - short), np.minimum(high, values + short)  # the others are solved again
    is_judged = is_judged and bool(np.all(np.abs(judged) <= short))
    delta = judged if is_judged else _bounded(scaled, along, damping, values, low, high)[0]
    clipped = _limited(scaled, along, damping, values, low, high, delta, limit, np.maximum(sizes, 1.0))
    clipped = in_order(scaled, parameters, values, clipped)
    predicted, gain = (float(2.0 * scaled.b @ way - way @ scaled.M @ way) for way in (clipped, judged))
    certain = np.where(stds > 0, stds, np.inf)
    pinned = tuple(name for name, at_bound in zip(scaled.names, at_bounds, strict=True) if at_bound)
    relative, significance = (float((np.abs(way) / certain).max(initial=0.0)) for way in (judged, clipped))
    return Step(clipped, relative, float(np.abs(judged).max(initial=0.0)), significance, predicted, gain,
                bool(np.any(clipped != delta)), pinned)


def _limited(scaled: Scaled, directions: Spectrum, damping: float, values: np.ndarray, low: np.ndarray,
             high: np.ndarray, delta: np.ndarray, limit: float, sizes: np.ndarray) -> np.ndarray:
    """`delta`, or where a component over its size exceeds the limit the least ridged step that keeps to it  # (n,)"""
    if np.abs(delta / sizes).max(initial=0.0) <= limit:
        return delta
    largest = np.diagonal(scaled.M).max(initial=0.0)
    least, most = np.log(MIN_RIDGE_SHARE * largest), np.log(MAX_RIDGE_SHARE * largest)
    # the ridge by bisection of its logarithm: components shrink as it grows
    while most - least > 0.1 * STEP_LIMIT_TOLERANCE:
        middle = 0.5 * (least + most)
        delta = _bounded(scaled, directions, damping, values, low, high, np.exp(middle) / sizes**2)[0]
        longest = np.abs(delta / sizes).max()
        if longest > limit:
            least = middle
        elif longest > (1.0 - STEP_LIMIT_TOLERANCE) * limit:
            break
        else:
            most = middle
    return np.clip(delta, -limit * sizes, limit * sizes)


def _bounded(scaled: Scaled, directions: Spectrum, damping: float, values: np.ndarray, low: np.ndarray,
             high: np.ndarray, ridge: float | np.ndarray = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """The damped step with components held at their bounds, and which ones are held  # (n,), (n,) bool

    All components that a step would carry over their bounds are held at once; then those that need not be are let go.
    """
    active, bound_steps = np.zeros(len(values), dtype=bool), np.zeros(len(values))
    slack = 1e-12 * np.maximum(1.0, np.abs(values))
    while True:
        delta = _solve(scaled, directions, damping, active, bound_steps, ridge)
        beyond = ~active & ((values + delta < low - slack) | (values + delta > high + slack))
        if not beyond.any():
            break
        bound_steps[beyond] = (np.clip(values + delta, low, high) - values)[beyond]
        active |= beyond
    if not active.any():
        return delta, active
    return _released(scaled, directions, damping, values, (low, high), ridge, delta, active)


def _released(scaled: Scaled, directions: Spectrum, damping: float, values: np.ndarray,
              limits: tuple[np.ndarray, np.ndarray],
              ridge: float | np.ndarray, delta: np.ndarray, active: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The minimum of the damped model within the bounds, from a step within them, and what is held  # (n,), (n,) bool

    Where many components are near their bounds (weights of zero), some of those that were held need not be. The one
    that the model pulls most strongly back inside is let go and the step goes on until the next bound, and so on: the
    primal active-set method (Nocedal & Wright, Numerical Optimization, 2006, algorithm 16.3).
    """
    damped = scaled.M + np.diag(damping * np.diagonal(scaled.M) + ridge)
    root = np.sqrt(np.where(np.diagonal(damped) > 0.0, np.diagonal(damped), 1.0))
    low, high = limits[0] - values, limits[1] - values
    inward = np.where(delta <= low, 1.0, -1.0)
    stuck = low >= high  # never let go
    least = RELEASE_TOLERANCE * np.abs(scaled.b / root).max(initial=0.0)
    while True:
        pull = np.where(active & ~stuck, inward * (scaled.b - damped @ delta) / root, 0.0)
        freed = int(np.argmax(pull))
        if not pull[freed] > least:
            return delta, active
        trial_active, trial = active.copy(), delta
        trial_active[freed] = False
        while True:  # each turn holds one more
            way = _solve(scaled, directions, damping, trial_active, np.where(trial_active, trial, 0.0), ridge) - trial
            with np.errstate(divide="ignore", invalid="ignore"):
                room = np.where(way < 0.0, (low - trial) / way, np.where(way > 0.0, (high - trial) / way, np.inf))
            room[trial_active] = np.inf
            first = int(np.argmin(room))
            trial = np.clip(trial + min(max(room[first], 0.0), 1.0) * way, low, high)
            if room[first] >= 1.0:
                break
            trial_active[first] = True
            trial[first] = low[first] if way[first] < 0.0 else high[first]
        gained = (2.0 * scaled.b - damped @ (trial + delta)) @ (trial - delta)  # of the damped model
        if not gained > 0.0:
            stuck[freed] = True  # its way leads along directions that no step takes
            continue
        delta, active = trial, trial_active
        inward = np.where(delta <= low, 1.0, -1.0)


def _solve(scaled: Scaled, directions: Spectrum, damping: float, active: np.ndarray, bound_steps: np.ndarray,
           ridge: float | np.ndarray) -> np.ndarray:
    """Damped solve over the determined directions with the active components fixed  # (n,)

    (M + damping diag(M) + diag(ridge)) delta = b
    """
    keep = ~active
    delta = bound_steps.copy()
    if not keep.any():
        return delta
    rhs = scaled.b[keep] - scaled.M[np.ix_(keep, active)] @ bound_steps[active]
    inner = scaled.M[np.ix_(keep, keep)]
    diagonal = np.diagonal(inner)
    weight = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    added = damping + np.broadcast_to(ridge, keep.shape)[keep] / weight**2
    normal = inner / weight[:, None] / weight[None, :] + np.diag(added)
    weak = directions.vectors[:, ~directions.determined][keep]  # (n_keep, n_weak) directions not to step along
    if weak.size:
        basis, _ = np.linalg.qr(weight[:, None] * _complement(weak))
        delta[keep] = basis @ np.linalg.solve(basis.T @ normal @ basis, basis.T @ (rhs / weight)) / weight
    else:
        delta[keep] = np.linalg.solve(normal, rhs / weight) / weight
    return delta


def _complement(weak: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the complement of the columns of `weak`  # (n, n - rank)"""
    u, s, _ = np.linalg.svd(weak, full_matrices=True)
    rank = int((s > 1e-8).sum())
    return u[:, rank:]
