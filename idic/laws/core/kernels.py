"""Compiled loops over points: the three modes, exact plane stress, and the complex-step derivative.

Everything here is generic: a law comes in as a function pointer, so these loops are compiled once for all laws.
Modes: 0 three-dimensional, 1 plane strain (F33 = 1), 2 plane stress (F33 such that P33 = 0; it is kept, as the start
of the next solve, in the last column of the state).

Plane stress is exact: with e = the F33 direction, P33(F33) = 0 is solved by safeguarded Newton, and every derivative
is condensed, dF33 = -dP33/(dP33/dF33), dP += dP_e dF33, dstate += dstate_e dF33.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numba import types

from idic.laws.core.compilation import LINEARISE, TANGENT, UPDATE, UPDATE_COMPLEX, c_array
from idic.laws.core.inner import array_maker, inner

COMPLEX_STEP = 1e-30               # complex step: its square is lost in rounding whatever the parameter's size
F33_TOLERANCE = 1e-11      # last correction of F33, applied to first order: its square is below rounding
F33_LAST_STEP_TOLERANCE = 1e-7          # below this the next evaluation is expected to be the last one
F33_ITERATIONS = 80        # Newton takes 2 to 4; bisection, where a law is not smooth, up to 50


loop_part = partial(inner, forceinline=False)


@loop_part
def complex_step(update, F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new, work):
    """`linearise` for a law that has only `update`: derivative = Im(update(x + i h dx)) / h."""
    n_state, n_params = state.shape[0], params.shape[0]
    wF, wP = work[:9].reshape((3, 3)), work[9:18].reshape((3, 3))
    wstate, wstate_new = work[18:18 + n_state], work[18 + n_state:18 + 2 * n_state]
    wparams = work[18 + 2 * n_state:18 + 2 * n_state + n_params]
    for k in range(dF.shape[0]):
        for i in range(3):
            for j in range(3):
                wF[i, j] = F[i, j] + 1j * COMPLEX_STEP * dF[k, i, j]
        for m in range(state.shape[0]):
            wstate[m] = state[m] + 1j * COMPLEX_STEP * (dstate[k, m] if dstate.shape[0] > 0 else 0.0)
        for m in range(params.shape[0]):
            wparams[m] = params[m] + 1j * COMPLEX_STEP * (dparams[k, m] if dparams.shape[0] > 0 else 0.0)
        if update(wF, wstate, wparams, dt, wP, wstate_new) != 0:
            return 1
        for i in range(3):
            for j in range(3):
                P[i, j] = wP[i, j].real
                dP[k, i, j] = wP[i, j].imag / COMPLEX_STEP
        for m in range(state.shape[0]):
            state_new[m] = wstate_new[m].real
            if k < dstate_new.shape[0]:
                dstate_new[k, m] = wstate_new[m].imag / COMPLEX_STEP
    return 0


@inner
def is_number(P):
    """Whether a law returned a stress."""
    return math.isfinite(P[0, 0] + P[0, 1] + P[1, 0] + P[1, 1] + P[2, 2])


@loop_part
def linearised(by_hand, linearise, update_complex, F, state, params, dt, dF, dstate, dparams,
               P, state_new, dP, dstate_new, work):
    """One point by the hand-written derivative or by the complex step; 1 also where the law returned NaN."""
    status = 0
    if by_hand:
        status = linearise(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new)
    else:
        status = complex_step(update_complex, F, state, params, dt, dF, dstate, dparams,
                              P, state_new, dP, dstate_new, work)
    return status if is_number(P) else 1


@inner
def next_stretch(f33, p33, slope, failed, low, high, good):
    """The next F33 to try: Newton's, at most a factor of two away and inside the bracket [low, high] (0: open).

    Returns (F33, low, high, good, status): ``good`` is the last F33 that had a stress; status 0 the correction was
    small, 1 give up, 2 go on.
    """
    if failed != 0:  # no stress there: go half way back to where there was one
        hopeless = good == 0.0 or abs(f33 - good) <= F33_TOLERANCE * good
        return 0.5 * (f33 + good), low, high, good, 1 if hopeless else 2
    step = -p33 / slope
    if slope > 0.0 and abs(step) <= F33_LAST_STEP_TOLERANCE * f33:
        return f33 + step, low, high, f33, 0
    low, high = (low, f33) if p33 > 0.0 else (f33, high)
    if not (slope > 0.0 and math.isfinite(step)):
        step = -math.copysign(0.1 * f33, p33)
    f33_new = min(max(f33 + step, 0.5 * f33), 2.0 * f33)
    if high > 0.0 and low > 0.0 and not (low < f33_new < high):
        f33_new = 0.5 * (low + high)
    return f33_new, low, high, f33, 2


@loop_part
def search(by_hand, linearise, update_complex, F, state, params, dt, first, none, P, state_new, dP, work):
    """Safeguarded Newton for P33(F33) = 0 from F[2, 2] on, until the correction is small: (status, F33)."""
    low, high, good = 0.0, 0.0, 0.0
    f33, status = F[2, 2], 1
    for _ in range(F33_ITERATIONS):
        F[2, 2] = f33
        failed = linearised(by_hand, linearise, update_complex, F, state, params, dt, first, none, none,
                            P, state_new, dP, none, work)
        p33, slope = P[2, 2], dP[0, 2, 2]
        f33, low, high, good, status = next_stretch(f33, p33, slope, failed, low, high, good)
        if status < 2:
            break
    return min(status, 1), f33


@loop_part
def plane_stress(by_hand, linearise, update_complex, F, state, params, dt, dF, dstate, dparams, first, none, close,
                 P, state_new, dP, dstate_new, one_dP, work):
    """Solve P33 = 0 for F[2, 2] (its value on entry is the start) and condense all derivatives: (status, F33).

    Row 0 of ``dF`` is the direction of F33, ``first`` a copy of that row alone with its scratch ``one_dP``.
    ``close``: the start is believed to be the solution, so the search may be skipped.
    """
    start = F[2, 2]
    for attempt in range(3):
        if not (close and attempt == 0):
            F[2, 2] = start
            status, start = search(by_hand, linearise, update_complex, F, state, params, dt, first, none,
                                   P, state_new, one_dP, work)
            if status != 0:
                return 1, start
        F[2, 2] = start
        status = linearised(by_hand, linearise, update_complex, F, state, params, dt, dF, dstate, dparams,
                            P, state_new, dP, dstate_new, work)
        slope = dP[0, 2, 2]
        step = -P[2, 2] / slope
        if status == 0 and slope > 0.0 and abs(step) <= F33_TOLERANCE * start:
            condense(P, state_new, dP, dstate_new, step, slope)
            return 0, start + step
    return 1, start


@loop_part
def condense(P, state_new, dP, dstate_new, step, slope):
    """Apply the last correction ``step`` of F33 and eliminate F33 from every derivative (rows 1, 2, ... of dP)."""
    n_state = state_new.shape[0]
    for i in range(3):
        for j in range(3):
            P[i, j] += dP[0, i, j] * step
    for m in range(n_state):
        state_new[m] += dstate_new[0, m] * step
    for k in range(1, dP.shape[0]):
        dF33 = -dP[k, 2, 2] / slope
        for i in range(3):
            for j in range(3):
                dP[k, i, j] += dP[0, i, j] * dF33
        if k < dstate_new.shape[0]:
            for m in range(n_state):
                dstate_new[k, m] += dstate_new[0, m] * dF33
        dP[k, 2, 2] = dF33  # of no further use as a stress (it is zero): carries the change of F33 to the caller


@inner
def embed(F, F33, out):
    """A point's F (2, 2) or (3, 3) as (3, 3)."""
    d = F.shape[0]
    for i in range(3):
        for j in range(3):
            out[i, j] = F[i, j] if i < d and j < d else 0.0
    if d == 2:
        out[2, 2] = F33


@inner
def is_body(finite, F):
    """Whether a body can have F: det F > 0. Small strain has no such limit."""
    return not finite or (F[0, 0] * (F[1, 1] * F[2, 2] - F[1, 2] * F[2, 1])
                          + F[0, 1] * (F[1, 2] * F[2, 0] - F[1, 0] * F[2, 2])
                          + F[0, 2] * (F[1, 0] * F[2, 1] - F[1, 1] * F[2, 0])) > 0.0


@inner
def put(matrix, out):
    """The leading block of a (3, 3) matrix into ``out`` (2, 2) or (3, 3)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = matrix[i, j]


@inner
def copy(values, out):
    """The leading entries: as many as the shorter of the two has."""
    for m in range(min(values.shape[0], out.shape[0])):
        out[m] = values[m]


@inner
def clear(out):
    """Zero a matrix: outputs of a point that did not converge are zero, never NaN."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = 0.0


@array_maker
def stress_loop(update, closed, tangent, by_hand, linearise, update_complex, finite, mode, F, guess, state, params, dt,
                P, P33, state_new):
    """Stress and new state of every point; returns True where all converged."""
    n_law = state.shape[1] - (1 if mode == 2 else 0)
    work = np.empty(18 + 2 * n_law + params.shape[1], np.complex128)
    dF, dP, dstate, none = np.zeros((1, 3, 3)), np.empty((1, 3, 3)), np.empty((1, n_law)), np.empty((0, n_law))
    dF[0, 2, 2] = 1.0
    if mode == 0:
        return solid_stresses(update, finite, F, state, params, dt, P, P33, state_new)
    if mode == 2 and closed:
        return closed_plane_tangents(tangent, finite, mode, F, guess, state, params, dt, P, P33, state_new,
                                     np.empty((0, 4, 4)), np.empty((3, 3)), np.empty((3, 3)), np.empty(n_law),
                                     np.empty(n_law), np.empty(n_law), np.empty((9, 9)), np.empty((2, 9, 9)))
    return plane_stresses(update, by_hand, linearise, update_complex, finite, mode, F, guess, state, params, dt, P, P33,
                          state_new, np.empty((3, 3)), np.empty((3, 3)), np.empty(n_law), np.empty(n_law), dF, dP,
                          dstate, none, np.empty((0, params.shape[1])), work)


@loop_part
def solid_stresses(update, finite, F, state, params, dt, P, P33, state_new):
    """The loop of three dimensions: a law reads and writes in the arrays of all points."""
    per_point, ok = 1 if params.shape[0] > 1 else 0, True
    for i in range(F.shape[0]):
        status = 1
        if is_body(finite, F[i]):
            status = update(F[i], state[i], params[i * per_point], dt, P[i], state_new[i])
        if status != 0 or not is_number(P[i]):
            ok = False
            clear(P[i])
            copy(state[i], state_new[i])
        P33[i] = P[i, 2, 2]
    return ok


@loop_part
def plane_stresses(update, by_hand, linearise, update_complex, finite, mode, F, guess, state, params, dt, P, P33,
                   state_new, point, stress, point_state, point_state_new, dF, dP, dstate, none, none_params, work):
    """The loop of plane strain and plane stress."""
    per_point, n_law, ok = 1 if params.shape[0] > 1 else 0, point_state.shape[0], True
    for i in range(F.shape[0]):
        embed(F[i], guess[i] if mode == 2 else 1.0, point)
        copy(state[i], point_state)
        p = params[i * per_point]
        if not is_body(finite, point):
            status = 1
        elif mode == 2:
            status, f33 = plane_stress(by_hand, linearise, update_complex, point, point_state, p, dt, dF, none,
                                       none_params, dF, none, False, stress, point_state_new, dP, dstate, dP, work)
            state_new[i, n_law] = f33
        else:
            status = update(point, point_state, p, dt, stress, point_state_new)
            if not is_number(stress):
                status = 1
        if status != 0:
            ok = False
            clear(P[i])
            copy(state[i], state_new[i])
            P33[i] = 0.0
            continue
        put(stress, P[i])
        P33[i] = stress[2, 2]
        copy(point_state_new, state_new[i])
    return ok


@array_maker
def tangent_loop(closed, tangent, by_hand, linearise, update_complex, finite, mode, F, guess, state, params, dt, P,
                 state_new, A):
    """Stress, new state and consistent tangent of every point; returns True where all converged.

    ``closed``: the law has a tangent in closed form.
    """
    d = F.shape[1]
    n_law, extra = state.shape[1] - (1 if mode == 2 else 0), 1 if mode == 2 else 0
    work = np.empty(18 + 2 * n_law + params.shape[1], np.complex128)
    first = np.zeros((1, 3, 3))
    first[0, 2, 2] = 1.0
    none, none_params, one_dP = np.empty((0, n_law)), np.empty((0, params.shape[1])), np.empty((1, 3, 3))
    point, stress, point_state, point_state_new = np.empty((3, 3)), np.empty((3, 3)), np.empty(n_law), np.empty(n_law)
    if closed and mode == 0:
        return solid_tangents(tangent, finite, F, state, params, dt, P, state_new, A, np.empty((2, 9, 9)))
    if closed:
        return closed_plane_tangents(tangent, finite, mode, F, guess, state, params, dt, P, np.empty(0), state_new, A,
                                     point, stress, point_state, point_state_new, np.empty(n_law), np.empty((9, 9)),
                                     np.empty((2, 9, 9)))
    dF = np.zeros((d * d + extra, 3, 3))
    if mode == 2:
        dF[0, 2, 2] = 1.0
    for c in range(d * d):
        dF[extra + c, c // d, c % d] = 1.0
    return directional_tangents(by_hand, linearise, update_complex, finite, mode, F, guess, state, params, dt, P,
                                state_new, A, point, stress, point_state, point_state_new, dF, first, one_dP,
                                np.empty((d * d + extra, 3, 3)), np.empty((extra, n_law)), none, none_params, work)


@loop_part
def solid_tangents(tangent, finite, F, state, params, dt, P, state_new, A, matrices):
    """The loop of three dimensions for tangents in closed form."""
    per_point, ok = 1 if params.shape[0] > 1 else 0, True
    for i in range(F.shape[0]):
        status = 1
        if is_body(finite, F[i]):
            status = tangent(F[i], state[i], params[i * per_point], dt, P[i], state_new[i], A[i], matrices)
        if status != 0 or not is_number(P[i]):
            ok = False
            clear(P[i])
            copy(state[i], state_new[i])
            clear(A[i])
    return ok


@loop_part
def closed_plane_tangents(tangent, finite, mode, F, guess, state, params, dt, P, P33, state_new, A, point, stress,
                          point_state, point_state_new, former, full, matrices):
    """The loop of plane strain and plane stress for laws with a tangent of their own; A and P33 may be empty."""
    per_point, n_law, ok = 1 if params.shape[0] > 1 else 0, point_state.shape[0], True
    for i in range(F.shape[0]):
        embed(F[i], guess[i] if mode == 2 else 1.0, point)
        copy(state[i], point_state)
        p = params[i * per_point]
        if not is_body(finite, point):
            status = 1
        elif mode == 2:
            status, f33 = closed_plane_stress(tangent, point, point_state, p, dt, stress, point_state_new, former, full,
                                              matrices)
            state_new[i, n_law] = f33
        else:
            status = tangent(point, point_state, p, dt, stress, point_state_new, full, matrices)
        if status != 0 or not is_number(stress):
            ok = False
            clear(P[i])
            copy(state[i], state_new[i])
            if A.shape[0] > 0:
                clear(A[i])
            if P33.shape[0] > 0:
                P33[i] = 0.0
            continue
        put(stress, P[i])
        copy(point_state_new, state_new[i])
        if P33.shape[0] > 0:
            P33[i] = stress[2, 2]
        for a in range(4 if A.shape[0] > 0 else 0):
            for c in range(4):
                A[i, a, c] = full[a + a // 2, c + c // 2]  # 11, 12, 21, 22: places 0, 1, 3, 4 of nine
    return ok


@loop_part
def closed_plane_stress(tangent, F, state, params, dt, P, state_new, former, A, matrices):
    """As `plane_stress`, for a tangent of its own: (status, F33); A (9, 9) is condensed in place.

    ``former`` (n_state,) keeps the state of the last iterate but one: its difference over that of F33 is the slope of
    the state in the last correction, which is below F33_TOLERANCE.
    """
    low, high, good, f33, f33_former, status, slope = 0.0, 0.0, 0.0, F[2, 2], 0.0, 1, 0.0
    for _ in range(F33_ITERATIONS):
        F[2, 2] = f33
        failed = tangent(F, state, params, dt, P, state_new, A, matrices)
        if not is_number(P):
            failed = 1
        slope = A[8, 8]
        step = -P[2, 2] / slope
        if failed == 0 and slope > 0.0 and abs(step) <= F33_TOLERANCE * f33:
            condense_closed(P, state_new, former, A, step, slope, f33 - f33_former if f33_former > 0.0 else 0.0)
            return 0, f33 + step
        if failed == 0:
            copy(state_new, former)
            f33_former = f33
        f33, low, high, good, status = next_stretch(f33, P[2, 2], slope, failed, low, high, good)
        if status == 1:
            return 1, f33
    return 1, f33


@loop_part
def condense_closed(P, state_new, former, A, step, slope, change):
    """As `condense`, of A (9, 9) with the state at F33 less ``change`` (0: there is none)."""
    if change != 0.0:
        for m in range(state_new.shape[0]):
            state_new[m] += (state_new[m] - former[m]) / change * step
    for a in range(9):
        P[a // 3, a % 3] += A[a, 8] * step
        share = A[a, 8] / slope
        for c in range(8):
            A[a, c] -= share * A[8, c]


@loop_part
def directional_tangents(by_hand, linearise, update_complex, finite, mode, F, guess, state, params, dt, P, state_new, A,
                         point, stress, point_state, point_state_new, dF, first, one_dP, dP, dstate, none, none_params,
                         work):
    """The loop of all modes for laws whose tangent comes from one derivative for each entry of F."""
    per_point, n_law, d, ok = 1 if params.shape[0] > 1 else 0, point_state.shape[0], F.shape[1], True
    extra = 1 if mode == 2 else 0
    for i in range(F.shape[0]):
        embed(F[i], guess[i] if mode == 2 else 1.0, point)
        copy(state[i], point_state)
        p = params[i * per_point]
        if not is_body(finite, point):
            status = 1
        elif mode == 2:
            status, f33 = plane_stress(by_hand, linearise, update_complex, point, point_state, p, dt, dF, none,
                                       none_params, first, none, False, stress, point_state_new, dP, dstate,
                                       one_dP, work)
            state_new[i, n_law] = f33
        else:
            status = linearised(by_hand, linearise, update_complex, point, point_state, p, dt, dF, none, none_params,
                                stress, point_state_new, dP, dstate, work)
        if status != 0:
            ok = False
            clear(P[i])
            copy(state[i], state_new[i])
            clear(A[i])
            continue
        put(stress, P[i])
        copy(point_state_new, state_new[i])
        for c in range(d * d):
            for a in range(d):
                for b in range(d):
                    A[i, d * a + b, c] = dP[extra + c, a, b]
    return ok


@array_maker
def directional_loop(by_hand, linearise, update_complex, finite, mode, F, guess, close, state, params, dt, dF_in,
                     dstate_in, dparams, dP_out, dstate_out):
    """Derivative of stress and new state along ``nd`` directions for every point; True where all converged."""
    n, nd = dF_in.shape[0], dF_in.shape[1]
    extra = 1 if mode == 2 else 0
    n_law = state.shape[1] - extra
    per_point = 1 if params.shape[0] > 1 else 0
    work = np.empty(18 + 2 * n_law + params.shape[1], np.complex128)
    dF, first = np.zeros((nd + extra, 3, 3)), np.zeros((1, 3, 3))
    first[0, 2, 2] = 1.0
    dold = np.zeros((nd + extra if dstate_in.shape[1] > 0 else 0, n_law))
    dp = np.zeros((nd + extra if dparams.shape[1] > 0 else 0, params.shape[1]))
    own_changes = dparams.shape[0] > 1 and dparams.shape[1] > 0
    if dparams.shape[1] > 0:
        for k in range(nd):
            copy(dparams[0, k], dp[extra + k])
    dP, dnew = np.empty((nd + extra, 3, 3)), np.empty((nd + extra, n_law))
    one_dP, none = np.empty((1, 3, 3)), np.empty((0, n_law))
    point, stress, point_state, point_state_new = np.empty((3, 3)), np.empty((3, 3)), np.empty(n_law), np.empty(n_law)
    if mode == 2:
        dF[0, 2, 2] = 1.0
    ok = True
    for i in range(n):
        embed(F[i], guess[i] if mode == 2 else 1.0, point)
        copy(state[i], point_state)
        for k in range(nd):
            embed(dF_in[i, k], 0.0, dF[extra + k])
            if dold.shape[0] > 0:
                copy(dstate_in[i, k], dold[extra + k])
            if own_changes:
                copy(dparams[i, k], dp[extra + k])
        p = params[i * per_point]
        if not is_body(finite, point):
            status = 1
        elif mode == 2:
            status, f33 = plane_stress(by_hand, linearise, update_complex, point, point_state, p, dt, dF, dold, dp,
                                       first, none, close, stress, point_state_new, dP, dnew,
                                       one_dP, work)
        else:
            status = linearised(by_hand, linearise, update_complex, point, point_state, p, dt, dF, dold, dp,
                                stress, point_state_new, dP, dnew, work)
        if status != 0:
            ok = False
            for k in range(nd):
                clear(dP_out[i, k])
            clear(dstate_out[i])
            continue
        for k in range(nd):
            put(dP[extra + k], dP_out[i, k])
            copy(dnew[extra + k], dstate_out[i, k])
            if mode == 2:
                dstate_out[i, k, n_law] = dP[extra + k, 2, 2]
    return ok


_f8, _i8, _b1 = types.float64, types.int64, types.boolean
_F1, _F2, _F3, _F4 = (c_array(types.float64, ndim) for ndim in (1, 2, 3, 4))
_update, _linearise, _complex, _tangent = (types.FunctionType(s) for s in (UPDATE, LINEARISE, UPDATE_COMPLEX, TANGENT))
STRESS_LOOP = _b1(_update, _b1, _tangent, _b1, _linearise, _complex, _b1, _i8, _F3, _F1, _F2, _F2, _f8, _F3, _F1, _F2)
TANGENT_LOOP = _b1(_b1, _tangent, _b1, _linearise, _complex, _b1, _i8, _F3, _F1, _F2, _F2, _f8, _F3, _F2, _F3)
DIRECTIONAL_LOOP = _b1(_b1, _linearise, _complex, _b1, _i8, _F3, _F1, _b1, _F2, _F2, _f8, _F4, _F3, _F3, _F4,
                       _F3)
