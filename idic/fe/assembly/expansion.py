"""Thermal expansion of any law: the mechanical part of the deformation of a point, and its stress.

With the free expansion e = alpha (T - T_reference) and, for finite strain, the stretch s = 1 + e:

* finite: F = s F_m. The law's energy is one per volume of the stress-free, expanded body, psi(F) = s^3 psi_law(F/s) per
  reference volume, so ``P(F) = s^2 P_law(F/s)``: the Cauchy stress is the law's own at F_m. Tangent
  dP/dF = s A_law(F/s).
* small: the law sees F - e I, i.e. the strain less e I; its stress and tangent are the body's.

All three directions expand. Plane strain: F33 = 1, so the law sees F_m33 = 1/s (small: 1 - e) and is asked in three
dimensions. Plane stress: the law finds its own F_m33; the state keeps the body's F33 = s F_m33 (small: F_m33 + e).
Source of the split: Lubarda, Appl. Mech. Rev. 57 (2004) 95, doi:10.1115/1.1591000.

Every function takes ``e`` (n,), or None for a body without temperature: then it is the function of
`idic.laws.core.points` and nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from idic.fe.assembly import in_parts
from idic.fe.mesh.element import cell_type
from idic.fe.body.body import Direction, Body
from idic.laws import CompiledLaw, directional_stresses, point_stresses, point_tangents


def stress(law: CompiledLaw, mode: int, F, e, state, params, dt: float, *, guess=None):
    """As `points.stress`; F (n, d, d), e (n,), guess (n,) the body's F33  # P, state_new, ok"""
    if e is None:
        return point_stresses(law, mode, F, state, params, dt, guess=guess)
    law_mode, Fm, guess = _mechanical_input(law, mode, F, e, state, guess)
    P, state_new, ok = point_stresses(law, law_mode, Fm, state, params, dt, guess=guess)
    return *_total_output(law, mode, P, state_new, e, F.shape[1]), ok


def tangent(law: CompiledLaw, mode: int, F, e, state, params, dt: float, *, guess=None):
    """As `points.tangent`  # P, state_new, A (n, d*d, d*d), ok"""
    if e is None:
        return in_parts.tangent(law, mode, F, state, params, dt, guess)
    law_mode, Fm, guess = _mechanical_input(law, mode, F, e, state, guess)
    P, state_new, A, ok = point_tangents(law, law_mode, Fm, state, params, dt, guess=guess)
    n, d = F.shape[:2]
    if mode == 1:
        A = A.reshape(n, 3, 3, 3, 3)[:, :2, :2, :2, :2].reshape(n, 4, 4)
    if not law.small:
        A = A * (1.0 + e)[:, None, None]
    return *_total_output(law, mode, P, state_new, e, d), np.ascontiguousarray(A), ok


def directional(law: CompiledLaw, mode: int, F, e, P, state, params, dt: float, dF, dstate, dparams, de, *, guess=None):
    """As `points.directional`, with the change ``de`` (n, nd) of the expansion (None: zero).

    Parameters
    ----------
    P : (n, d, d)
        The body's stress at F, of `stress` or `tangent`.

    guess : (n,)
        Plane stress: the body's F33 at the converged point, ``state_new[:, -1]``.

    Returns
    -------
    dP (n, nd, d, d), dstate_new (n, nd, n_state), ok
    """
    if e is None:
        return in_parts.directional(law, mode, F, state, params, dt, dF, dstate, dparams, guess)
    n, nd, d = dF.shape[:3]
    s = np.ones(n) if law.small else 1.0 + e
    law_mode, Fm, law_guess = _mechanical_input(law, mode, F, e, state, guess)
    dFm = np.zeros((n, nd, *Fm.shape[1:]))
    dFm[:, :, :d, :d] = dF / s[:, None, None, None]
    if de is not None:
        dFm -= de[:, :, None, None] * (np.eye(Fm.shape[1]) if law.small else (Fm / s[:, None, None])[:, None])
    dP, dstate_new, ok = directional_stresses(law, law_mode, Fm, state, params, dt, dFm, dstate, dparams,
                                            guess=law_guess)
    dP = np.ascontiguousarray(dP[:, :, :d, :d])
    if not law.small:
        dP *= (s * s)[:, None, None, None]
    if not law.small and de is not None:
        dP += (2.0 * de / s[:, None])[:, :, None, None] * P[:, None]
    if mode == 2:  # of F33 = s F_m33 (small: F_m33 + e)
        dstate_new[:, :, -1] *= s[:, None]
        if de is not None:
            dstate_new[:, :, -1] += de * (1.0 if law.small else law_guess[:, None])
    return dP, dstate_new, ok


def _mechanical_input(law: CompiledLaw, mode: int, F, e, state, guess):
    """The mode in which the law is asked, its F_m, and (plane stress) the start of its own F33."""
    if mode == 2:
        guess = state[:, -1] if guess is None else guess
        guess = guess - e if law.small else guess / (1.0 + e)
    if mode == 1:
        F, plane = np.zeros((len(F), 3, 3)), F
        F[:, :2, :2], F[:, 2, 2] = plane, 1.0
    Fm = F - e[:, None, None] * np.eye(F.shape[1]) if law.small else F / (1.0 + e)[:, None, None]
    return 0 if mode == 1 else mode, Fm, guess


def _total_output(law: CompiledLaw, mode: int, P, state, e, d: int):
    """The body's stress and state out of the law's."""
    P = np.ascontiguousarray(P[:, :d, :d])
    if not law.small:
        P *= ((1.0 + e) ** 2)[:, None, None]
    if mode == 2:
        state[:, -1] = state[:, -1] + e if law.small else state[:, -1] * (1.0 + e)
    return P, state


# fields ---------------------------------------------------------------------------------------------
def at_points(body: Body, cell: str, connectivity, weights, mean: bool, nodal: np.ndarray) -> np.ndarray:
    """Nodal values (n_nodes, ...) at the points of a group of elements; `mean`: their mean over each element.

    Elements with mean dilatation have one volume change each, so they get one expansion each: a thermal strain that
    they cannot follow would be stress.

    Returns
    -------
    (n_points, ...)
    """
    xi, _ = cell_type(cell).quadrature_rule(body.quadrature.get(cell))
    values = np.einsum("qa,ea...->eq...", cell_type(cell).shape_functions(xi), nodal[connectivity])
    if mean:
        w = weights.reshape(values.shape[:2])
        average = np.einsum("eq,eq...->e...", w / w.sum(axis=1, keepdims=True), values)
        values = np.broadcast_to(average[:, None], values.shape)
    return np.ascontiguousarray(values).reshape(-1, *nodal.shape[1:])


def nodal_changes(body: Body, section: int, directions: Sequence[Direction], temperature: np.ndarray,
                  changes: Sequence[np.ndarray | None]) -> np.ndarray | None:
    """Change of the free expansion of a section's nodes along each direction; None: no direction concerns it.

    temperature : (n_nodes,) K; changes : per direction its change of temperature (n_nodes,), or None.

    Returns
    -------
    (n_nodes, nd)
    """
    alpha = body.sections[section].expansion
    out = np.zeros((len(temperature), len(directions)))
    for k, (direction, change) in enumerate(zip(directions, changes, strict=True)):
        if direction.expansion is not None and body.sections[direction.expansion].name == body.sections[section].name:
            out[:, k] += temperature
        if change is not None:
            out[:, k] += alpha * change
    return out if out.any() else None
