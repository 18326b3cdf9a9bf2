"""Material-point driver: one point along a prescribed path, with exact sensitivities to the parameters.

Some components of F are driven, the others follow from zero stress (mixed control, Newton with the consistent
tangent); a step that does not converge is halved. Sensitivities by direct differentiation of the discrete steps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.errors import NotConverged
from idic.laws.core.points import directional_stresses, point_tangents
from idic.laws.core.compilation import CompiledLaw

STRESS_TOLERANCE = 1e-10   # residual stress over the largest stress; Newton is quadratic, so this costs one iteration
STIFFNESS_ROUNDING = 1e-14    # of the stiffness: no smaller residual can be asked of a nearly incompressible law
MAX_ITERATIONS = 25
MAX_HALVINGS = 12


@dataclass(frozen=True)
class Curve:
    """The response of a point along its path.

    Attributes
    ----------
    times : (m,) s
    F, P : (m, d, d)
        Deformation gradient; first Piola-Kirchhoff stress in MPa (small kinematics: the stress).
    state : (m, n_state)
    dF, dP : (m, n_params, d, d)
        Derivatives with respect to every parameter of the law.
    """

    times: np.ndarray
    F: np.ndarray
    P: np.ndarray
    state: np.ndarray
    dF: np.ndarray
    dP: np.ndarray

    @property
    def cauchy(self) -> np.ndarray:
        """Cauchy stress P F^T / det F of a three-dimensional, finite-strain curve, MPa  # (m, d, d)"""
        return self.P @ self.F.transpose(0, 2, 1) / np.linalg.det(self.F)[:, None, None]


def drive(law: CompiledLaw, params, F, *, mode: int = 0, driven=None, times=None) -> Curve:
    """Follow a path of F, one increment per row.

    Parameters
    ----------
    params : (n_params,)
    F : (m, d, d)
        Driven components are taken from here; the first row is the rest state, identity.
    driven : (d, d) bool, optional
        False: that component is free and its stress P zero. Default: all driven.
    times : (m,), optional
        s; default 0, 1, 2, ...

    Raises
    ------
    NotConverged
        The law or the mixed control found no solution, even in small steps.
    """
    F = np.array(F, dtype=float)
    params = np.asarray(params, dtype=float)
    m, d = F.shape[:2]
    times = np.arange(m, dtype=float) if times is None else np.asarray(times, dtype=float)
    is_free = np.zeros(d * d, bool) if driven is None else ~np.asarray(driven, bool).ravel()
    n_params, n_state = len(params), law.n_state(mode)
    curve = Curve(times, np.empty((m, d, d)), np.zeros((m, d, d)), np.empty((m, n_state)),
                  np.zeros((m, n_params, d, d)), np.zeros((m, n_params, d, d)))
    point = (np.eye(d), law.initial_state(mode), np.zeros((n_params, n_state)))
    curve.F[0], curve.state[0] = point[:2]
    for k in range(1, m):
        point, stress, dF, dP = _advance(law, mode, params, is_free, point, F[k], times[k] - times[k - 1], MAX_HALVINGS)
        curve.F[k], curve.state[k], curve.P[k], curve.dF[k], curve.dP[k] = point[0], point[1], stress, dF, dP
    return curve


def _advance(law, mode, params, is_free, point, target, dt, halvings):
    """One increment from ``point`` = (F, state, dstate) to the driven components of ``target``."""
    F, state, dstate = point
    solution = _solve(law, mode, params, is_free, F, state, target, dt)
    if solution is None:
        if halvings == 0:
            raise NotConverged(f"law {law.spec.name}: no equilibrium of the point at driven F = {target.tolist()}")
        middle = 0.5 * (F + target)
        halfway, *_ = _advance(law, mode, params, is_free, point, middle, 0.5 * dt, halvings - 1)
        return _advance(law, mode, params, is_free, halfway, target, 0.5 * dt, halvings - 1)
    F_new, stress, state_new, A = solution
    d, n_params = len(F), len(params)
    dF = np.zeros((n_params, d * d))
    for _ in range(2 if is_free.any() else 1):  # first at fixed F, then with the free components following
        dP, dstate_new, ok = directional_stresses(law, mode, F_new[None], state[None], params, dt,
                                                dF.reshape(1, n_params, d, d), dstate[None], np.eye(n_params),
                                                guess=state_new[-1:] if mode == 2 else None)
        if not ok:
            raise NotConverged(f"law {law.spec.name}: no derivative at F = {F_new.tolist()}")
        if not dF.any() and is_free.any():
            dF[:, is_free] = -np.linalg.solve(A[np.ix_(is_free, is_free)], dP.reshape(n_params, -1)[:, is_free].T).T
    return (F_new, state_new, dstate_new[0]), stress, dF.reshape(n_params, d, d), dP[0]


def _solve(law, mode, params, is_free, F, state, target, dt):
    """F with the driven components of ``target`` and zero stress in the free ones: (F, P, state, A), or None."""
    d = len(F)
    F = np.where(is_free.reshape(d, d), F, target)
    for _ in range(MAX_ITERATIONS):
        P, state_new, A, ok = point_tangents(law, mode, F[None], state[None], params, dt)
        if not ok:
            return None
        residual, A = P[0].ravel()[is_free], A[0]
        tolerance = STRESS_TOLERANCE * np.abs(P).max() + STIFFNESS_ROUNDING * np.abs(A).max()
        if np.abs(residual).max(initial=0.0) <= tolerance:
            return F, P[0], state_new[0], A
        step = np.linalg.solve(A[np.ix_(is_free, is_free)], -residual)
        if not np.isfinite(step).all():
            return None
        F = F.copy()
        F.ravel()[is_free] += step
    return None


def uniaxial(law: CompiledLaw, params, strain, *, mode: int = 0, times=None, axis: int = 0) -> Curve:
    """Uniaxial stress: F11 = 1 + ``strain`` (m,), F21 (and F31, F32) zero, all other stresses zero.

    ``mode`` 1 is tension across a plane-strain section: F22 is free, F33 = 1. ``axis`` 1 or 2 pulls along y or z.
    """
    F = _path(strain, mode, lambda e, d: e * np.diag(np.eye(d)[axis]))
    driven = np.tril(np.ones(F.shape[1:], bool))
    np.fill_diagonal(driven[1:, 1:], False)
    order = [axis, *(i for i in range(len(driven)) if i != axis)]  # the pulled axis first
    place = np.argsort(order)
    driven = driven[np.ix_(place, place)]
    return drive(law, params, F, mode=mode, driven=driven, times=times)


def _path(values, mode: int, gradient) -> np.ndarray:
    d = 3 if mode == 0 else 2
    return np.array([np.eye(d) + gradient(value, d) for value in np.asarray(values, dtype=float)])
