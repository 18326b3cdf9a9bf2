"""A laminate in its plane: orthotropic, with fibres that stiffen and shear that softens, reversibly or for good.

On top of the stress of `orthotropic`, in the material axes, g = 2 e12, x = t12 / G12 and x_r = shear_reference / G12:

    t11 += stiffening_1 E1 e11^2,  t22 += stiffening_2 E2 e22^2         secant modulus E (1 + stiffening e)
    |g|  = x + shear_softening x_r (x / x_r)^shear_exponent             Ramberg and Osgood's curve, x(g)
    t12  = G12 g ((1 - d) x(|g|) / |g| + d x(g_max) / g_max)         d = shear_damage, g_max the largest |g| so far

d = 0 retraces the curve; with d = 1 the stiffness that the largest shear has cost is lost for good, and the body
unloads towards the origin. Under a shear that only grows, d has no effect. Dissipation is d G12 g^2 / 2 times the
loss of the secant x / g, never negative; a shear that softens always bears more at more strain, so
that nothing localises in a thin row.
"""

from __future__ import annotations

import math

from idic.laws.core import tensors
from idic.laws.core.inner import inner
from idic.laws.core.law import LawParameter, LawSpec, register
from idic.laws.elastic_damage import store, strain
from idic.laws.orthotropic import PARAMETERS, no_plane_body, stiffness, stress_of

STIFFENING_1, STIFFENING_2, SOFTENING, EXPONENT, REFERENCE, DAMAGE = 5, 6, 7, 8, 9, 10
MAX_ITERATIONS = 200
RELATIVE_TOLERANCE = 1e-9  # one more step of Newton follows, which squares it


@inner
def curve(x, reference, softening, exponent):
    """(|g|, its slope) over x > 0."""
    part = softening * (x / reference) ** (exponent - 1.0)
    return x * (1.0 + part), 1.0 + exponent * part


@inner
def inverted(g, reference, softening, exponent):
    """(x, its slope) of `curve` = g > 0: Newton from above, where the curve is convex; exact in complex."""
    x = g.real
    for _ in range(MAX_ITERATIONS):
        value, slope = curve(x, reference.real, softening.real, exponent.real)
        step = (value - g.real) / slope
        x -= step
        if abs(step) <= RELATIVE_TOLERANCE * x:
            break
    value, slope = curve(x + 0.0 * g, reference, softening, exponent)
    y = x - (value - g) / slope
    return y, 1.0 / curve(y, reference, softening, exponent)[1]


@inner
def in_axes(C, e):
    """(e11, e22, 2 e12) of a strain (6-tuple) in the material axes."""
    c, s = C[8], C[9]
    return (c * c * e[0] + s * s * e[1] + 2.0 * c * s * e[3], s * s * e[0] + c * c * e[1] - 2.0 * c * s * e[3],
            2.0 * (c * s * (e[1] - e[0]) + (c * c - s * s) * e[3]))


@inner
def from_axes(C, t11, t22, t12):
    """A stress in the material axes as a 6-tuple in those of the mesh."""
    c, s = C[8], C[9]
    return (c * c * t11 + s * s * t22 - 2.0 * c * s * t12, s * s * t11 + c * c * t22 + 2.0 * c * s * t12, 0.0 * t11,
            c * s * (t11 - t22) + (c * c - s * s) * t12, 0.0 * t11, 0.0 * t11)


@inner
def shear(G, g, largest, params):
    """(t12 - G g, its slope over g, the largest |g|) at the shear g."""
    size = -g if g.real < 0.0 else 1.0 * g
    grows = size.real > largest.real
    most = size if grows else 1.0 * largest + 0.0 * size
    zero = 0.0 * (G + g + most + params[DAMAGE] + params[SOFTENING] + params[EXPONENT] + params[REFERENCE])
    if not (size.real > 0.0 and (params[SOFTENING].real != 0.0 or params[SOFTENING].imag != 0.0)):
        return zero, zero.real, most
    reference, damage = params[REFERENCE] / G, params[DAMAGE]
    x, slope = inverted(size, reference, params[SOFTENING], params[EXPONENT])
    secant, tangent = x / size, slope
    if not grows:
        keep = inverted(most, reference, params[SOFTENING], params[EXPONENT])[0] / most
        secant, tangent = (1.0 - damage) * secant + damage * keep, (1.0 - damage) * tangent + damage * keep
    return G * g * (secant - 1.0) + zero, (G * (tangent - 1.0) + zero).real, most


@inner
def added(C, e, state, params):
    """Stress beyond the orthotropic one, its slopes over e11, e22 and 2 e12, and the largest shear."""
    e11, e22, g = in_axes(C, e)
    first, second = params[STIFFENING_1] * params[0] * e11, params[STIFFENING_2] * params[1] * e22
    t12, slope, most = shear(params[3], g, state[0], params)
    return from_axes(C, first * e11 + 0.0 * t12, second * e22 + 0.0 * t12, t12 + 0.0 * (first + second)), \
        2.0 * first, 2.0 * second, slope, most


@inner
def update(finite, F, state, params, P, state_new):
    """One point, real or complex."""
    C, f = stiffness(params), tensors.load(F)
    e = strain(finite, f)
    more, _, _, _, most = added(C, e, state, params)
    state_new[0] = most
    store(finite, f, tensors.combine(1.0, stress_of(C, e), 1.0, more, 0.0), P)
    return 0


@inner
def tangent(finite, F, state, params, P, state_new, A, work):
    """`update` and its tangent."""
    C, f = stiffness(params), tensors.load(F)
    e = strain(finite, f)
    more, first, second, slope, most = added(C, e, state, params)
    state_new[0] = most
    S, D = tensors.combine(1.0, stress_of(C, e), 1.0, more, 0.0), work[0]
    store(finite, f, S, P)
    for b in range(6):
        de = tensors.unit_strain(b)
        d11, d22, dg = in_axes(C, de)
        column = tensors.combine(1.0, stress_of(C, de), 1.0, from_axes(C, first * d11, second * d22, slope * dg), 0.0)
        D[0, b], D[1, b], D[2, b], D[3, b], D[4, b], D[5, b] = column
    if finite:
        tensors.push_tangent(f, S, D, A)
    else:
        tensors.push_tangent((1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), tensors.scaled(0.0, S, 0.0), D, A)
    return 0


def update_small(F, state, params, dt, P, state_new):
    """Small strain."""
    return update(False, F, state, params, P, state_new)


def update_finite(F, state, params, dt, P, state_new):
    """Green's strain."""
    return update(True, F, state, params, P, state_new)


def tangent_small(F, state, params, dt, P, state_new, A, work):
    """`update_small` and its tangent."""
    return tangent(False, F, state, params, P, state_new, A, work)


def tangent_finite(F, state, params, dt, P, state_new, A, work):
    """`update_finite` and its tangent."""
    return tangent(True, F, state, params, P, state_new, A, work)


LAW = register(LawSpec(
    name="laminate",
    parameters=(
        *PARAMETERS,
        LawParameter("stiffening_1", "-", "growth of the secant modulus along axis 1 with the strain there",
                     default=10.0, null=0.0, positive=False, bounds=(-math.inf, math.inf)),
        LawParameter("stiffening_2", "-", "growth of the secant modulus along axis 2 with the strain there",
                     default=5.0, null=0.0, positive=False, bounds=(-math.inf, math.inf)),
        LawParameter("shear_softening", "-", "shear strain beyond t12 / G12 at the reference stress, over that there",
                     default=0.5, null=0.0),
        LawParameter("shear_exponent", "-", "exponent of the shear stress in the strain beyond t12 / G12", default=3.0,
                     null=3.0, bounds=(1.1, 20.0)),
        LawParameter("shear_reference", "MPa", "shear stress of shear_softening; about half the largest of the test, "
                                               "locked", default=50.0, null=50.0),
        LawParameter("shear_damage", "-", "share of the loss of shear stiffness that unloading does not give back",
                     default=0.6, null=0.0, positive=False, bounds=(0.0, 1.0)),
    ),
    updates={"small": update_small, "finite": update_finite},
    tangents={"small": tangent_small, "finite": tangent_finite},
    state_names=("largest_shear",),
    isotropic=False,
    impossible=no_plane_body,
    reference="shear: Ramberg & Osgood, NACA TN 902 (1943), lost stiffness as Ladeveze & Le Dantec, Compos. Sci. "
              "Technol. 43 (1992) 257, doi:10.1016/0266-3538(92)90097-M; fibres: van Dreumel & Kamp, J. Compos. Mater. "
              "11 (1977) 461, doi:10.1177/002199837701100408",
))
