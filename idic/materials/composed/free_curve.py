"""The free hardening curve of a composed law outside of the compiled code: its basis, its prior, classical forms of it.

The flow stress is linear in its values at the knots (``flow_stress.py``):  s(p) = B(p) (yield_stress, s2 ... sn).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.special import chdtri

SMOOTHNESS = 1.0  # prior std of the change of slope from interval to interval, over the mean slope of the starting curve
TERM = re.compile(r"[(+]free(\d+)[)+]")
WHITENING_RANK = 1e-10  # variances below this share of the largest are rounding
NOISE_PROBABILITY = 0.95  # of a loss that noise explains
STARTS = 6  # of the exponents of a classical form


def knots_of(law: str) -> int:
    """The number of knots of the free curve in a law's name; 0 without one."""
    found = TERM.search(law)
    return int(found[1]) if found else 0


def level_names(law: str, element_set: str) -> tuple[str, ...]:
    """The parameters of an element set that are the values of its free curve at the knots; none without one."""
    n = knots_of(law)
    return (f"{element_set}.yield_stress", *(f"{element_set}.hardening_1_s{k}" for k in range(2, n + 1))) if n else ()


def knots(last: float, n: int) -> np.ndarray:
    """Plastic strain of the knots, dense at the beginning  # (n,)"""
    return last * (np.arange(n) / (n - 1.0)) ** 2


def basis(p: np.ndarray, last: float, n: int) -> np.ndarray:
    """B: weights at p (m,) of the values at n knots, the last at plastic strain `last`; straight beyond  # (m, n)"""
    at, p = knots(last, n), np.asarray(p, dtype=float)
    k = np.clip(np.searchsorted(at, p, side="right") - 1, 0, n - 2)
    x = (p - at[k]) / (at[k + 1] - at[k])
    B = np.zeros((len(p), n))
    B[np.arange(len(p)), k] = 1.0 - x
    B[np.arange(len(p)), k + 1] = x
    return B


def bends(last: float, levels: np.ndarray) -> np.ndarray:
    """What the smoothness prior has of unit variance: changes of slope over their std, per value  # (n - 2, n)

    levels : (n,) MPa, values of the starting curve
    """
    n = len(levels)
    slopes = np.diff(np.eye(n), axis=0) / np.diff(knots(last, n))[:, None]
    return np.diff(slopes, axis=0) / (SMOOTHNESS * max(levels[-1] - levels[0], 1e-3 * levels[0]) * (1.0 / last))


@dataclass(frozen=True)
class ClassicalFit:
    """A classical form beside a free curve.

    Attributes
    ----------
    form : "linear" | "voce" | "ludwik" | "swift" | "power"
    parameters : {name: value} MPa and -
    chi2 : float
        What the form loses: the weighted square distance from the free curve, in its covariance.
    freedom : int
        Points of the curve minus parameters of the form: the loss that noise alone explains.
    inside : bool
        The loss is at most what noise alone exceeds in 5 % of all tests.
    stress : (m,) MPa, at the points of the curve
    """

    form: str
    parameters: dict[str, float]
    chi2: float
    freedom: int
    inside: bool
    stress: np.ndarray


FORMS: dict[str, tuple[tuple[str, ...], Callable[..., np.ndarray]]] = {
    "linear": (("yield_stress", "H"), lambda p, s, H: s + H * p),
    "voce": (("yield_stress", "Q", "b"), lambda p, s, Q, b: s + Q * (1.0 - np.exp(-b * p))),
    "ludwik": (("yield_stress", "K", "n"), lambda p, s, K, n: s + K * p**n),
    "swift": (("K", "strain_0", "n"), lambda p, K, strain_0, n: K * (strain_0 + p) ** n),
    "power": (("K", "n"), lambda p, K, n: K * np.maximum(p, 1e-12) ** n),
}
STARTING: dict[str, Callable[[float], list[tuple[float, ...]]]] = {
    "linear": lambda r: [(1.0, 0.5)],
    "voce": lambda r: [(1.0, 0.3, b / r) for b in np.geomspace(0.5, 30, STARTS)],
    "ludwik": lambda r: [(0.9, 0.5, n) for n in np.linspace(0.1, 1.2, STARTS)],
    "swift": lambda r: [(1.5, e * r, 0.2) for e in np.geomspace(1e-3, 1.0, STARTS)],
    "power": lambda r: [(1.5, n) for n in np.linspace(0.05, 0.6, STARTS)]}


def classical_fits(p: np.ndarray, stress: np.ndarray, covariance: np.ndarray,
                   at: Sequence[int]) -> tuple[ClassicalFit, ...]:
    """Every classical form fitted to a free curve in its covariance, the best first.

    Parameters
    ----------
    p, stress : (m,) plastic strain, flow stress in MPa
    covariance : (m, m) MPa^2
    at : places of the points that are compared, at most as many as the curve has parameters
    """
    at = np.asarray(at)
    values, vectors = np.linalg.eigh(covariance[np.ix_(at, at)])
    kept = values > WHITENING_RANK * values[-1]
    white = vectors[:, kept].T / np.sqrt(values[kept])[:, None]
    size, reach = float(np.max(np.abs(stress))), float(p[-1])
    fits = []
    for form, (names, curve) in FORMS.items():
        best = None
        for start in STARTING[form](reach):
            scale = np.array([size if name in ("yield_stress", "H", "Q", "K") else 1.0 for name in names])
            found = least_squares(
                lambda z, curve=curve, scale=scale: white @ (curve(p[at], *(z * scale)) - stress[at]),
                start, bounds=(0.0, np.inf), x_scale=np.maximum(np.abs(start), 1e-6), max_nfev=2000)
            if best is None or found.cost < best[0]:
                best = (found.cost, found.x * scale)
        assert best is not None  # every form has a start
        loss, freedom = 2.0 * float(best[0]), int(kept.sum()) - len(names)
        inside = freedom > 0 and loss <= chdtri(freedom, 1.0 - NOISE_PROBABILITY)
        fits.append(ClassicalFit(form, dict(zip(names, map(float, best[1]), strict=True)), loss, freedom, bool(inside),
                                 curve(p, *best[1])))
    return tuple(sorted(fits, key=lambda fit: fit.chi2))
