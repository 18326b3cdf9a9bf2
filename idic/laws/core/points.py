"""A law at many points: stress, consistent tangent, directional derivative.

``mode``: 0 three-dimensional, 1 plane strain, 2 plane stress. ``F`` (n, d, d) with d = 3, 2, 2; stresses in MPa.
A point that does not converge gets zero stress and its old state, and ``ok`` is False: there is never a NaN. At finite
strain that holds for det F <= 0 too, whatever the law.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from idic.laws.core import kernels
from idic.laws.core.compilation import CompiledLaw, compile, compile_cached, pointer

__all__ = ["CompiledLaw", "compile", "directional_stresses", "point_stresses", "point_tangents"]

_EMPTY_GUESS = np.empty(0)


@cache
def compiled_loop(name: str):
    """The compiled loop, to be called with arguments of exactly its types: `_inputs` sees to that.

    Numba's dispatcher would look at each of them again, which costs as much as a hundred points.
    """
    compiled = compile_cached(getattr(kernels, f"{name}_loop"), getattr(kernels, f"{name.upper()}_LOOP"))
    return next(iter(compiled.overloads.values())).entry_point


def _functions(law: CompiledLaw) -> tuple:
    """What the loops take of a law: by_hand, linearise, update_complex, whether its strain is finite."""
    return law.by_hand, pointer(law.linearise), pointer(law.update_complex), not law.small


def _array(values) -> np.ndarray:
    """float64, C-contiguous and writable: as the compiled signatures require (a copy only where it is not)."""
    return np.require(values, np.float64, ["C", "W"])


def _inputs(law: CompiledLaw, mode: int, F, state, params, guess):
    F, state, params = _array(F), _array(state), _array(params)
    if params.ndim == 1:
        params = params[None, :]
    n, d = len(F), 3 if mode == 0 else 2
    n_params = len(law.spec.parameters)
    for name, shape, expected in (("F", F.shape, (n, d, d)), ("state", state.shape, (n, law.n_state(mode))),
                                  ("params", params.shape, (params.shape[0] if params.shape[0] in (1, n) else n,
                                                            n_params))):
        if shape != expected:
            raise ValueError(f"law {law.spec.name}, mode {mode}: expected {name} of shape {expected}, got {shape}")
    if mode == 2:
        guess = np.ascontiguousarray(state[:, -1]) if guess is None else _array(guess)
    else:
        guess = _EMPTY_GUESS
    return F, guess, state, params


def point_stresses(law: CompiledLaw, mode: int, F, state, params, dt: float, *, full: bool = False, guess=None,
    out=None):
    """Stress and new state.

    Parameters
    ----------
    F : (n, d, d) deformation gradient (small kinematics: I + grad u)
    state : (n, law.n_state(mode))
    params : (n_params,) or (n, n_params)
    dt : float
        Time since ``state``, s.
    full : bool
        Also return P33 (n,), which plane strain has.
    guess : (n,), optional
        Plane stress: a better start for F33 than the one in ``state``.
    out : (P, state_new), optional

    Returns
    -------
    P (n, d, d) first Piola-Kirchhoff stress in MPa, state_new, [P33,] ok
    """
    F, guess, state, params = _inputs(law, mode, F, state, params, guess)
    P, state_new = out if out is not None else (np.empty_like(F), np.empty_like(state))
    P33 = np.empty(len(F))
    ok = compiled_loop("stress")(pointer(law.update), law.closed, pointer(law.tangent), *_functions(law), mode, F,
                                 guess, state, params, float(dt), P, P33, state_new)
    return (P, state_new, P33, ok) if full else (P, state_new, ok)


def point_tangents(law: CompiledLaw, mode: int, F, state, params, dt: float, *, guess=None, out=None):
    """Stress, new state and consistent tangent; arguments as `stress`, ``out`` = (P, state_new, A).

    Returns
    -------
    P (n, d, d), state_new, A (n, d*d, d*d) with ``A[i, d*a + b, d*c + e] = dP_ab / dF_ce`` in MPa, ok
    """
    F, guess, state, params = _inputs(law, mode, F, state, params, guess)
    n, d = F.shape[:2]
    P, state_new, A = out if out is not None else (np.empty_like(F), np.empty_like(state),
                                                   np.empty((n, d * d, d * d)))
    ok = compiled_loop("tangent")(law.closed, pointer(law.tangent), *_functions(law), mode, F, guess, state, params,
                                  float(dt), P, state_new, A)
    return P, state_new, A, ok


def directional_stresses(law: CompiledLaw, mode: int, F, state, params, dt: float, dF, dstate=None, dparams=None, *,
                guess=None, out=None):
    """Derivative of stress and new state along ``nd`` directions of (F, state, params) together.

    Parameters
    ----------
    dF : (n, nd, d, d)
    dstate : (n, nd, law.n_state(mode)), optional
        None: zero. Plane stress: the last column does not matter (F33 in the state is a start value only).
    dparams : (nd, n_params) or, of each point, (n, nd, n_params), optional
        None: zero.
    guess : (n,), optional
        Plane stress: F33 of the converged point, ``state_new[:, -1]``; spares the search for it.
    out : (dP, dstate_new), optional

    Returns
    -------
    dP (n, nd, d, d), dstate_new (n, nd, law.n_state(mode)), ok
        Plane stress: the last column of ``dstate_new`` is the derivative of F33.
    """
    close = guess is not None
    F, guess, state, params = _inputs(law, mode, F, state, params, guess)
    dF = _array(dF)
    n, nd = dF.shape[:2]
    dstate = np.empty((n, 0, state.shape[1])) if dstate is None else _array(dstate)
    dparams = np.empty((1, 0, params.shape[1])) if dparams is None else _array(dparams)
    dparams = dparams[None] if dparams.ndim == 2 else dparams
    if dF.shape != (len(F), nd, *F.shape[1:]) or dstate.shape not in ((n, nd, state.shape[1]),
                                                                      (n, 0, state.shape[1])) \
            or dparams.shape not in ((1, nd, params.shape[1]), (n, nd, params.shape[1]),
                                                             (1, 0, params.shape[1])):
        raise ValueError(f"expected dF (n, nd, d, d), dstate (n, nd, {state.shape[1]}), dparams ([n,] nd, "
                         f"{params.shape[1]}) for F {F.shape}; got {dF.shape}, {dstate.shape}, {dparams.shape}")
    dP, dstate_new = out if out is not None else (np.empty_like(dF), np.empty((n, nd, state.shape[1])))
    if nd == 0:
        return dP, dstate_new, True
    ok = compiled_loop("directional")(*_functions(law), mode, F, guess, close, state, params, float(dt), dF, dstate,
                              dparams, dP, dstate_new)
    return dP, dstate_new, ok
