"""A free yield surface outside of the compiled code: its radius with derivatives, and classical surfaces of a sheet.

Stresses are in the plane and in material axes: 11, 22, 12. The radius along a direction is the factor on it at yield.
"""

from __future__ import annotations

import numpy as np

from idic.laws.free_forms.free_curve import Form
from idic.laws.plasticity.free_locus import POWER, directions

STARTS_OF_EXPONENT = (2.5, 6.0, 12.0)
FAMILY_ERROR = 0.005  # of the radius: weights fitted to surfaces of Hill miss them by it (rms; up to 0.8 % at places)


def coordinates(stress: np.ndarray) -> np.ndarray:
    """x1, x2, x3 of ``free_locus.py`` of plane stresses (m, 3)  # (m, 3)"""
    s11, s22, s12 = np.asarray(stress, dtype=float).T
    mean = (s11 + s22) / 3.0
    return np.column_stack([1.5 * (s11 - mean), 0.5 * np.sqrt(3.0) * s22, np.sqrt(3.0) * s12])


def knot_stresses(n: int) -> np.ndarray:
    """Plane stresses 11, 22, 12 along the directions of n knots on a ring  # (3 n, 3)"""
    x1, x2, x3 = directions(n)[:, :3].T
    return np.column_stack([x1 + x2 / np.sqrt(3.0), 2.0 * x2 / np.sqrt(3.0), x3 / np.sqrt(3.0)])


def powers(n: int, stress: np.ndarray) -> np.ndarray:
    """g_k [(n_k . x)^8 + (n'_k . x)^8] of plane stresses (m, 3), n knots on a ring  # (m, 3 n)"""
    x, knots = coordinates(stress), directions(n)
    mirrored = knots[:, :3] * [1.0, 1.0, -1.0]
    return ((x @ knots[:, :3].T) ** POWER + (x @ mirrored.T) ** POWER) * knots[:, 3]


def equivalent(weights: np.ndarray, stress: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(q, its derivatives by the weights) of plane stresses (m, 3)  # (m,), (m, 3 n)"""
    weights = np.asarray(weights, dtype=float)
    n = len(weights) // 3
    stress_powers, along = powers(n, stress), powers(n, np.array([[1.0, 0.0, 0.0]]))
    sums, unit = stress_powers @ weights, along @ weights
    q = (sums / unit) ** (1.0 / POWER)
    return q, q[:, None] / POWER * (stress_powers / sums[:, None] - along / unit)


def hill48(stress: np.ndarray, r0: float, r45: float, r90: float) -> np.ndarray:
    """Hill's q of plane stresses (m, 3), ``hill48.py``  # (m,)"""
    s11, s22, s12 = np.asarray(stress, dtype=float).T
    g = 1.0 / (1.0 + r0)
    h = r0 * g
    n = 0.5 * (r0 + r90) * (1.0 + 2.0 * r45) * g / r90
    return np.sqrt(h / r90 * s22**2 + g * s11**2 + h * (s11 - s22) ** 2 + 2.0 * n * s12**2)


def hosford(stress: np.ndarray, a: float) -> np.ndarray:
    """Hosford's isotropic q of plane stresses (m, 3): Mises at a = 2, Tresca for a without end  # (m,)"""
    s11, s22, s12 = np.asarray(stress, dtype=float).T
    mean, radius = 0.5 * (s11 + s22), np.hypot(0.5 * (s11 - s22), s12)
    sides = np.abs(np.array([mean + radius, mean - radius, 2.0 * radius]))
    largest = np.maximum(sides.max(axis=0), 1e-300)
    return largest * (0.5 * ((sides / largest) ** a).sum(axis=0)) ** (1.0 / a)


def classical_surfaces(stress: np.ndarray) -> dict[str, Form]:
    """Mises, Hill48, Hosford and Tresca as the radius (MPa) along directions (m, 3), for `classical_fits`."""
    stress = np.asarray(stress, dtype=float)

    def at(points: np.ndarray) -> np.ndarray:
        return stress[np.asarray(points, dtype=int)]

    first = ("yield_stress",)
    return {
        "mises": Form(first, lambda p, s: s / hosford(at(p), 2.0), lambda reach: [(1.0,)], first),
        "hill48": Form((*first, "r0", "r45", "r90"), lambda p, s, *r: s / hill48(at(p), *r),
                       lambda reach: [(1.0, 1.0, 1.0, 1.0)], first, 1e-3),
        "hosford": Form((*first, "a"), lambda p, s, a: s / hosford(at(p), a),
                        lambda reach: [(1.0, a) for a in STARTS_OF_EXPONENT], first, 0.5),
        "tresca": Form(first, lambda p, s: s / hosford(at(p), 400.0), lambda reach: [(1.0,)], first),
    }
