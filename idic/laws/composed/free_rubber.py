"""Isotropic rubber whose energy is free: derivatives by the invariants on knots, ``free_rubber(8)``,
``free_rubber(8+4)``.

    W = W1(I1) + W2(I2) + kappa (J - 1)^2 / 2,   I1, I2 of the isochoric b = J^(-2/3) F F^T,   g1 = W1', g2 = W2'

g1, and g2 where there is a second number, are linear between their values I1_g1, I1_g2 ... (MPa) at so many knots
I - 3 = range ((k - 1) / (n - 1))^2, evenly spread over the stretch (``on_knots.py``). g1 > 0: the energy grows with I1.
g1 and g2 constant: ``mooney_rivlin``. A deformation whose larger stretch would have the smaller stress is refused.
Stress as in ``mooney_rivlin.py``. Energies free in the invariants: Sussman & Bathe, Commun. Numer. Methods Eng. 25
(2009) 53, doi:10.1002/cnm.1105.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from idic.errors import InputError
from idic.laws.composed.on_knots import on_knots, on_knots_change
from idic.laws.core import tensors
from idic.laws.core.inner import inner
from idic.laws.core.law import LawParameter, LawSpec, register
from idic.laws.mooney_rivlin import full, kinematics, kirchhoff, motion_change, rubber_tangent, store_change
from idic.parameters import USUAL_MAX_STEP

FREE_RUBBER = "free_rubber"
INVARIANTS = ("I1", "I2")
DEFAULT_KNOTS, KNOTS = 8, (3, 24)  # of a curve; fewest and most
SECOND_MAX_STEP = 0.05  # of g2, in units of 0.3 MPa: a body whose g2 falls far below zero is unstable
FEWEST = ("4",)  # of the law without a number


@inner
def second_invariant(I1, square):
    """I2 = (I1^2 - tr b b) / 2 of b with b b = square."""
    return 0.5 * (I1 * I1 - (square[0] + square[1] + square[2]))


@inner
def slopes(n1, n2, I1, I2, params):
    """(g1, its slope, g2, its slope) at the invariants; n2 = 0: g2 = 0."""
    g1, h1 = on_knots(n1, 1, 2, 3, False, I1 - 3.0, params)
    if n2 == 0:
        return g1, h1, 0.0 * I2, 0.0 * I2
    g2, h2 = on_knots(n2, 2 + n1, 3 + n1, 4 + n1, False, I2 - 3.0, params)
    return g1, h1, g2, h2


@inner
def ordered(g1, g2, b):
    """Whether the larger stretch has the larger stress (Baker & Ericksen): g1 1 + g2 b is positive definite."""
    a, c, d = g1.real + g2.real * b[0].real, g1.real + g2.real * b[1].real, g1.real + g2.real * b[2].real
    u, v, w = g2.real * b[3].real, g2.real * b[4].real, g2.real * b[5].real
    return a > 0.0 and a * c - u * u > 0.0 and d * (a * c - u * u) - a * w * w - c * v * v + 2.0 * u * v * w > 0.0


@inner
def update(n1, n2, F, params, P):
    """One point, real or complex."""
    J, fi, b, I1, square = kinematics(F)
    if not J.real > 0.0:
        return 1
    g1, _, g2, _ = slopes(n1, n2, I1, second_invariant(I1, square), params)
    if not ordered(g1, g2, b):
        return 1
    tau = kirchhoff(J, b, I1, square, g1, g2, params[0])
    tensors.store(tensors.times_transposed(tau, fi), P)
    return 0


@inner
def linearise(n1, n2, F, params, dF, dparams, P, dP):
    """`update` and its derivative, with l = dF F^-1: dP = (dtau - tau l^T) F^-T."""
    kappa = params[0]
    J, fi, b, I1, square = kinematics(F)
    if not J > 0.0:
        return 1
    I2 = second_invariant(I1, square)
    g1, h1, g2, h2 = slopes(n1, n2, I1, I2, params)
    if not ordered(g1, g2, b):
        return 1
    tau = kirchhoff(J, b, I1, square, g1, g2, kappa)
    tensors.store(tensors.times_transposed(tau, fi), P)
    factor = 2.0 * (g1 + g2 * I1)
    for k in range(dF.shape[0]):
        ell, t, db = motion_change(dF[k], fi, b)
        dsquare = tensors.twice_symmetric(full(db), b)
        dI1 = db[0] + db[1] + db[2]
        dg1, dg2 = h1 * dI1, h2 * (I1 * dI1 - 0.5 * (dsquare[0] + dsquare[1] + dsquare[2]))
        sphere = kappa * (2.0 * J - 1.0) * J * t
        if dparams.shape[0] > 0:
            sphere += dparams[k, 0] * (J - 1.0) * J
            dg1 += on_knots_change(n1, 1, 2, 3, False, I1 - 3.0, params, dparams[k])
            if n2 > 0:
                dg2 += on_knots_change(n2, 2 + n1, 3 + n1, 4 + n1, False, I2 - 3.0, params, dparams[k])
        first = tensors.combine(2.0 * (dg1 + dg2 * I1 + g2 * dI1), b, factor, db, 0.0)
        second = tensors.combine(-2.0 * dg2, square, -2.0 * g2, dsquare, 0.0)
        store_change(first, second, sphere, tau, ell, fi, dP[k])
    return 0


@inner
def tangent(n1, n2, F, params, P, A):
    """`update` and dP/dF in closed form."""
    point = kinematics(F)
    J, fi, b, I1, square = point
    if not J > 0.0:
        return 1
    derivatives = slopes(n1, n2, I1, second_invariant(I1, square), params)
    if not ordered(derivatives[0], derivatives[2], b):
        return 1
    rubber_tangent(tensors.load(F), params[0], point, derivatives, P, A)
    return 0


def knots_of_rubber(law: str) -> tuple[int, int]:
    """The numbers of knots of g1 and g2 in a law's name; (0, 0) of another law."""
    if law == FREE_RUBBER:
        return int(FEWEST[0]), 0
    match = re.fullmatch(rf"{FREE_RUBBER}\((\d+)(?:\+(\d+))?\)", law)
    return (int(match[1]), int(match[2] or 0)) if match else (0, 0)


def rubber_level_names(invariant: str, n: int) -> tuple[str, ...]:
    """The parameters that are the values of a derivative at its n knots."""
    return tuple(f"{invariant}_g{k}" for k in range(1, n + 1))


def compose(kinds: Sequence[str]) -> LawSpec:
    """The law with these numbers of knots.

    Raises
    ------
    InputError
        Not one or two numbers within `KNOTS`.
    """
    if not 1 <= len(kinds) <= 2 or not all(kind.isdecimal() and KNOTS[0] <= int(kind) <= KNOTS[1] for kind in kinds):
        raise InputError(f"{FREE_RUBBER} needs its numbers of knots", key="law",
                         expected=f"{FREE_RUBBER}(8) or {FREE_RUBBER}(8+4), {KNOTS[0]} to {KNOTS[1]} "
                         "each", found=repr("+".join(kinds)), remedy="correct the numbers")
    n1, n2 = int(kinds[0]), int(kinds[1]) if len(kinds) > 1 else 0
    parameters = [LawParameter("kappa", "MPa", "bulk modulus", default=660.0), *_curve("I1", n1),
                  *(_curve("I2", n2) if n2 else ())]

    def update_of(F, state, params, dt, P, state_new):
        return update(n1, n2, F, params, P)

    def linearise_of(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
        return linearise(n1, n2, F, params, dF, dparams, P, dP)

    def tangent_of(F, state, params, dt, P, state_new, A, work):
        return tangent(n1, n2, F, params, P, A)

    return LawSpec(
        name=f"{FREE_RUBBER}({'+'.join(map(str, map(int, kinds)))})", parameters=tuple(parameters),
        updates={"finite": update_of},
        linearise={"finite": linearise_of}, tangents={"finite": tangent_of}, compose=compose,
        reference="W = W1(I1) + W2(I2) + kappa (J - 1)^2 / 2, W1' and W2' linear between their values at knots; "
                  "Sussman & Bathe, Commun. Numer. Methods Eng. 25 (2009) 53, doi:10.1002/cnm.1105")


def _curve(invariant: str, n: int) -> tuple[LawParameter, ...]:
    first = invariant == "I1"
    range_parameter = LawParameter(f"{invariant}_range", "-", f"{invariant} - 3 at the last knot; chosen, locked",
                                   default=2.0)
    return (range_parameter,
            *(LawParameter(name, "MPa", f"dW/d{invariant} at knot {k} of {n}", default=0.3 + 0.02 * k if first else 0.3,
                                 positive=first, bounds=(0.0 if first else -np.inf, np.inf),
                                 max_step=USUAL_MAX_STEP if first else SECOND_MAX_STEP)
                    for k, name in enumerate(rubber_level_names(invariant, n), 1)))


LAW = register(replace(compose(FEWEST), name=FREE_RUBBER))
