"""Orthotropic linear elasticity in one plane, the material axes turned by an angle about z.

Five parameters fix the in-plane response, which is all that plane stress sees. In three dimensions and plane strain
the law is closed as transversely isotropic about axis 1: ``E3 = E2``, ``nu13 = nu12``, ``nu23 = nu12``,
``G13 = G12``, ``G23 = E2 / (2 (1 + nu23))``; with ``E1 = E2`` and ``G12 = E / (2 (1 + nu))`` it is exactly `elastic`.

Every nu12 with ``nu12^2 E2 < E1`` is possible in the plane, 0.75 of a laminate of +-45 degrees too. Where no body in
space could have this closure, ``nu13 = nu23 = k nu12`` with a k < 1 that keeps its energy positive, and it no harder
through the thickness than ``2 E2`` but near the limit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from idic.laws.core import symmetric, tensors
from idic.laws.core.inner import array_maker, inner, inner_with_arrays
from idic.laws.core.law import LawParameter, LawSpec, register
from idic.laws.elastic import multiply


MAX_THROUGH_THICKNESS = 0.9999  # of the compliance 1 / E3, the part that the plane may take away; elastic: nu = 0.49997
USUAL_THROUGH_THICKNESS = 0.5  # where nu23 = nu12 would take far more: C33 is 2 E2


@inner
def contraction_through_thickness(E1, E2, nu12):
    """nu13 = nu23 of the closure, NaN where no plane body has these parameters; real or complex."""
    ratio = E2 / E1
    in_plane = 1.0 - nu12 * nu12 * ratio
    if not in_plane.real > 0.0:
        return nu12 * math.nan
    square_ratio = nu12 * nu12 * (1.0 + ratio * (1.0 + 2.0 * nu12)) / in_plane
    if not square_ratio.real > MAX_THROUGH_THICKNESS:
        return nu12 + 0.0 * ratio
    reduced = 2.0 * MAX_THROUGH_THICKNESS - square_ratio  # continuous, and soon no longer nearly incompressible
    return nu12 * np.sqrt((reduced
                           if reduced.real > USUAL_THROUGH_THICKNESS else USUAL_THROUGH_THICKNESS) / square_ratio)


@inner
def stiffness(params):
    """C11, C12, C13, C22, C23, C33, G12 (= G13), G23, cos(angle), sin(angle); real or complex."""
    E1, E2, nu12, G12 = params[0], params[1], params[2], params[3]
    angle = params[4] * (math.pi / 180.0)
    c, s = np.cos(angle), np.sin(angle)
    nu23 = contraction_through_thickness(E1, E2, nu12)
    shear = 0.5 * E2 / (1.0 + nu23)
    # compliance [[1/E1, -nu12/E1, -nu23/E1], [., 1/E2, -nu23/E2], [., ., 1/E2]], inverted in closed form
    if nu23.real == nu12.real:
        below = 1.0 - nu12 - 2.0 * nu12 * nu12 * E2 / E1
        C12 = E2 * nu12 / below
        mean = 0.5 * E2 / below  # (C22 + C23) / 2
        return E1 * (1.0 - nu12) / below, C12, C12, mean + shear, mean - shear, mean + shear, G12, shear, c, s
    in_plane = 1.0 - nu12 * nu12 * E2 / E1
    v1, v2 = nu23 * (1.0 + nu12) / in_plane, nu23 * (1.0 + nu12 * E2 / E1) / in_plane
    C33 = E2 / (1.0 - nu23 * (v1 * E2 / E1 + v2))
    return (E1 / in_plane + C33 * v1 * v1, nu12 * E2 / in_plane + C33 * v1 * v2, C33 * v1,
            E2 / in_plane + C33 * v2 * v2, C33 * v2, C33, G12, shear, c, s)


@inner
def stress_of_strain(C, e, out):
    """Stress of a symmetric strain ``e`` (3, 3): into material axes, times the stiffness, and back."""
    C11, C12, C13, C22, C23, C33, G12, G23, c, s = C
    cc, ss, cs = c * c, s * s, c * s
    e11 = cc * e[0, 0] + ss * e[1, 1] + 2.0 * cs * e[0, 1]
    e22 = ss * e[0, 0] + cc * e[1, 1] - 2.0 * cs * e[0, 1]
    e12 = cs * (e[1, 1] - e[0, 0]) + (cc - ss) * e[0, 1]
    e33 = e[2, 2]
    s11 = C11 * e11 + C12 * e22 + C13 * e33
    s22 = C12 * e11 + C22 * e22 + C23 * e33
    s12 = 2.0 * G12 * e12
    s13 = 2.0 * G12 * (c * e[0, 2] + s * e[1, 2])
    s23 = 2.0 * G23 * (c * e[1, 2] - s * e[0, 2])
    out[0, 0] = cc * s11 + ss * s22 - 2.0 * cs * s12
    out[1, 1] = ss * s11 + cc * s22 + 2.0 * cs * s12
    out[2, 2] = C13 * e11 + C23 * e22 + C33 * e33
    out[0, 1] = cs * (s11 - s22) + (cc - ss) * s12
    out[0, 2] = c * s13 - s * s23
    out[1, 2] = s * s13 + c * s23
    out[1, 0], out[2, 0], out[2, 1] = out[0, 1], out[0, 2], out[1, 2]


@inner
def stress_of(C, e):
    """As `stress_of_strain`, of 6-tuples."""
    C11, C12, C13, C22, C23, C33, G12, G23, c, s = C
    cc, ss, cs = c * c, s * s, c * s
    e11, e22, e33 = cc * e[0] + ss * e[1] + 2.0 * cs * e[3], ss * e[0] + cc * e[1] - 2.0 * cs * e[3], e[2]
    s11, s22 = C11 * e11 + C12 * e22 + C13 * e33, C12 * e11 + C22 * e22 + C23 * e33
    s12 = 2.0 * G12 * (cs * (e[1] - e[0]) + (cc - ss) * e[3])
    s13, s23 = 2.0 * G12 * (c * e[4] + s * e[5]), 2.0 * G23 * (c * e[5] - s * e[4])
    return (cc * s11 + ss * s22 - 2.0 * cs * s12, ss * s11 + cc * s22 + 2.0 * cs * s12,
            C13 * e11 + C23 * e22 + C33 * e33, cs * (s11 - s22) + (cc - ss) * s12, c * s13 - s * s23, s * s13 + c * s23)


@inner
def small_strain(F, e):
    """e = sym(F) - I."""
    for i in range(3):
        for j in range(3):
            e[i, j] = 0.5 * (F[i, j] + F[j, i])
        e[i, i] -= 1.0


@inner
def green_strain(F, e):
    """e = (F^T F - I)/2."""
    for i in range(3):
        for j in range(3):
            e[i, j] = 0.5 * (F[0, i] * F[0, j] + F[1, i] * F[1, j] + F[2, i] * F[2, j])
        e[i, i] -= 0.5


@inner_with_arrays
def stiffness_change(params, dparams):
    """Complex stiffness whose imaginary part is 1e-30 times its change along ``dparams``."""
    p = np.empty(5, np.complex128)
    for m in range(5):
        p[m] = params[m] + 1e-30j * dparams[m]
    return stiffness(p)


@array_maker
def update_small(F, state, params, dt, P, state_new):
    """sigma = R C(R^T eps R) R^T."""
    e = F.copy()
    small_strain(F, e)
    stress_of_strain(stiffness(params), e, P)
    return 0


@array_maker
def linearise_small(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
    """`update_small` and its derivative; linear in the strain, the parameters by the complex step."""
    C = stiffness(params)
    e = np.empty((3, 3))
    small_strain(F, e)
    stress_of_strain(C, e, P)
    for k in range(dF.shape[0]):
        for i in range(3):
            for j in range(3):
                e[i, j] = 0.5 * (dF[k, i, j] + dF[k, j, i])
        stress_of_strain(C, e, dP[k])
    if dparams.shape[0] > 0:
        small_strain(F, e)
        change = np.empty((3, 3), np.complex128)
        for k in range(dparams.shape[0]):
            stress_of_strain(stiffness_change(params, dparams[k]), e, change)
            for i in range(3):
                for j in range(3):
                    dP[k, i, j] += change[i, j].imag / 1e-30
    return 0


@array_maker
def update_finite(F, state, params, dt, P, state_new):
    """P = F S, S = R C(R^T E R) R^T with Green's strain E."""
    e, S = F.copy(), F.copy()
    green_strain(F, e)
    stress_of_strain(stiffness(params), e, S)
    multiply(F, S, P)
    return 0


@inner
def tangent(f, C, S, A, work):
    """dP/dF of P = f S, dS = C : de, from the stress of unit strains."""
    D = work[0]
    for b in range(6):
        column = stress_of(C, tensors.unit_strain(b))
        D[0, b], D[1, b], D[2, b], D[3, b], D[4, b], D[5, b] = column
    tensors.push_tangent(f, S, D, A)


def tangent_small(F, state, params, dt, P, state_new, A, work):
    """`update_small` and its tangent."""
    C, f = stiffness(params), tensors.load(F)
    e = (f[0] - 1.0, f[4] - 1.0, f[8] - 1.0, 0.5 * (f[1] + f[3]), 0.5 * (f[2] + f[6]), 0.5 * (f[5] + f[7]))
    s = stress_of(C, e)
    tensors.store((s[0], s[3], s[4], s[3], s[1], s[5], s[4], s[5], s[2]), P)
    tangent((1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), C, tensors.scaled(0.0, s, 0.0), A, work)
    return 0


def tangent_finite(F, state, params, dt, P, state_new, A, work):
    """`update_finite` and its tangent."""
    C, f = stiffness(params), tensors.load(F)
    e = tensors.scaled(0.5, symmetric.cauchy_green(f, f), -0.5)
    S = stress_of(C, e)
    tensors.store(symmetric.times(f, S), P)
    tangent(f, C, S, A, work)
    return 0


PARAMETERS = (
    LawParameter("E1", "MPa", "Young's modulus along material axis 1", default=140e3),
    LawParameter("E2", "MPa", "Young's modulus along material axis 2", default=10e3),
    LawParameter("nu12", "-", "contraction along 2 by stress along 1", default=0.3, positive=False,
                 bounds=(-0.99, 0.99)),
    LawParameter("G12", "MPa", "in-plane shear modulus", default=5e3),
    LawParameter("angle", "deg", "from the mesh's x axis to material axis 1, about z", default=30.0, positive=False,
                 bounds=(-np.inf, np.inf)),
)


def no_plane_body(values: Mapping[str, float]) -> str:
    """Why no body has these E1, E2 (MPa) and nu12, by the end of their names; or an empty text."""
    E1, E2, nu12 = (next(value for key, value in values.items() if key.endswith(name))
                    for name in ("E1", "E2", "nu12"))
    if nu12 * nu12 * E2 < E1:
        return ""
    return f"nu12 = {nu12:g} of E1 = {E1:g}, E2 = {E2:g} MPa; it must lie within +-sqrt(E1 / E2) = {(E1 / E2)**0.5:.3g}"


LAW = register(LawSpec(
    name="orthotropic",
    parameters=PARAMETERS,
    updates={"small": update_small, "finite": update_finite},
    linearise={"small": linearise_small},
    tangents={"small": tangent_small, "finite": tangent_finite},
    linear=True,
    isotropic=False,
    impossible=no_plane_body,
    reference="Jones, Mechanics of Composite Materials, 2nd ed. (1999), eq. 2.67; 3D: transversely isotropic about 1",
))
