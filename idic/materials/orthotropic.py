"""Orthotropic linear elasticity in one plane, the material axes turned by an angle about z.

Five parameters fix the in-plane response, which is all that plane stress sees. In three dimensions and plane strain
the law is closed as transversely isotropic about axis 1: ``E3 = E2``, ``nu13 = nu12``, ``nu23 = nu12``,
``G13 = G12``, ``G23 = E2 / (2 (1 + nu23))``; with ``E1 = E2`` and ``G12 = E / (2 (1 + nu))`` it is exactly `elastic`.
"""

from __future__ import annotations

import math

import numpy as np

from idic.materials.core.inner import inner
from idic.materials.core.law import LawParameter, LawSpec, register
from idic.materials.elastic import multiply


@inner
def stiffness(params):
    """C11, C12 (= C13), C22 (= C33), C23, G12 (= G13), G23, cos(angle), sin(angle); real or complex."""
    E1, E2, nu12, G12 = params[0], params[1], params[2], params[3]
    angle = params[4] * (math.pi / 180.0)
    nu23 = nu12
    # compliance [[1/E1, -a, -a], [-a, 1/E2, -nu23/E2], [-a, -nu23/E2, 1/E2]], a = nu12/E1, inverted in closed form
    below = 1.0 - nu23 - 2.0 * nu12 * nu12 * E2 / E1
    C11 = E1 * (1.0 - nu23) / below
    C12 = E2 * nu12 / below
    shear = 0.5 * E2 / (1.0 + nu23)
    mean = 0.5 * E2 / below  # (C22 + C23) / 2
    return C11, C12, mean + shear, mean - shear, G12, shear, np.cos(angle), np.sin(angle)


@inner
def stress_of_strain(C, e, out):
    """Stress of a symmetric strain ``e`` (3, 3): into material axes, times the stiffness, and back."""
    C11, C12, C22, C23, G12, G23, c, s = C
    cc, ss, cs = c * c, s * s, c * s
    e11 = cc * e[0, 0] + ss * e[1, 1] + 2.0 * cs * e[0, 1]
    e22 = ss * e[0, 0] + cc * e[1, 1] - 2.0 * cs * e[0, 1]
    e12 = cs * (e[1, 1] - e[0, 0]) + (cc - ss) * e[0, 1]
    e33 = e[2, 2]
    s11 = C11 * e11 + C12 * (e22 + e33)
    s22 = C12 * e11 + C22 * e22 + C23 * e33
    s12 = 2.0 * G12 * e12
    s13 = 2.0 * G12 * (c * e[0, 2] + s * e[1, 2])
    s23 = 2.0 * G23 * (c * e[1, 2] - s * e[0, 2])
    out[0, 0] = cc * s11 + ss * s22 - 2.0 * cs * s12
    out[1, 1] = ss * s11 + cc * s22 + 2.0 * cs * s12
    out[2, 2] = C12 * e11 + C23 * e22 + C22 * e33
    out[0, 1] = cs * (s11 - s22) + (cc - ss) * s12
    out[0, 2] = c * s13 - s * s23
    out[1, 2] = s * s13 + c * s23
    out[1, 0], out[2, 0], out[2, 1] = out[0, 1], out[0, 2], out[1, 2]


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


@inner
def stiffness_change(params, dparams):
    """Complex stiffness whose imaginary part is 1e-30 times its change along ``dparams``."""
    p = np.empty(5, np.complex128)
    for m in range(5):
        p[m] = params[m] + 1e-30j * dparams[m]
    return stiffness(p)


def update_small(F, state, params, dt, P, state_new):
    """sigma = R C(R^T eps R) R^T."""
    e = F.copy()
    small_strain(F, e)
    stress_of_strain(stiffness(params), e, P)
    return 0


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


def update_finite(F, state, params, dt, P, state_new):
    """P = F S, S = R C(R^T E R) R^T with Green's strain E."""
    e, S = F.copy(), F.copy()
    green_strain(F, e)
    stress_of_strain(stiffness(params), e, S)
    multiply(F, S, P)
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

LAW = register(LawSpec(
    name="orthotropic",
    parameters=PARAMETERS,
    updates={"small": update_small, "finite": update_finite},
    linearise={"small": linearise_small},
    linear=True,
    isotropic=False,
    reference="Jones, Mechanics of Composite Materials, 2nd ed. (1999), eq. 2.67; 3D: transversely isotropic about 1",
))
