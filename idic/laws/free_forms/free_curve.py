"""The free hardening curve of a composed law outside of the compiled code: its basis, classical forms of it.

The flow stress is linear in its values at the knots (``flow_stress.py``):  s(p) = B(p) (yield_stress, s2 ... sn).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import scipy

TERM = re.compile(r"[(+]free(\d+)[)+]")
WHITENING_RANK = 1e-10  # variances below this share of the largest are rounding
NOISE_PROBABILITY = 0.95  # of a loss that noise explains
STARTS = 6  # of the exponents of a classical form
SURE_BEND = 3.0  # standard deviations of a change of slope that is none of the noise


def knots_of(law: str) -> int:
    """The number of knots of the free curve in a law's name; 0 without one."""
    match = TERM.search(law)
    return int(match[1]) if match else 0


def level_names(law: str, element_set: str) -> tuple[str, ...]:
    """The parameters of an element set that are the values of its free curve at the knots; none without one."""
    n = knots_of(law)
    return (f"{element_set}.yield_stress", *(f"{element_set}.hardening_1_s{k}" for k in range(2, n + 1))) if n else ()


def knots(end: float, n: int) -> np.ndarray:
    """Plastic strain of the knots, dense at the beginning  # (n,)"""
    return end * (np.arange(n) / (n - 1.0)) ** 2


def basis(p: np.ndarray, end: float, n: int) -> np.ndarray:
    """B: weights at p (m,) of the values at n knots, the last at plastic strain `end`; straight beyond  # (m, n)"""
    at, p = knots(end, n), np.asarray(p, dtype=float)
    k = np.clip(np.searchsorted(at, p, side="right") - 1, 0, n - 2)
    x = (p - at[k]) / (at[k + 1] - at[k])
    B = np.zeros((len(p), n))
    B[np.arange(len(p)), k] = 1.0 - x
    B[np.arange(len(p)), k + 1] = x
    return B


def between_knots(p: np.ndarray, end: float, levels: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Covariance at p (m,) of what a curve does between its knots, MPa^2  # (m, m)

    Of every interval the std is the distance of its chord from the parabola whose change of slope is the mean of those
    at both ends; the intervals are independent. Nothing at the knots, little where the curve is smooth, most beside a
    corner, which may lie anywhere between two knots. Changes of slope that may be noise do not count.

    levels, covariance : (n,), (n, n) values at the knots, the last at plastic strain `end`
    """
    at = knots(end, len(levels))
    slopes = np.diff(np.eye(len(levels)), axis=0) / np.diff(at)[:, None]
    bends = np.pad(np.diff(slopes, axis=0), ((1, 1), (0, 0)))
    means = 0.5 * (bends[:-1] + bends[1:])
    squares = (means @ levels) ** 2 - SURE_BEND**2 * np.einsum("ij,jk,ik->i", means, covariance, means)
    x = np.clip((np.asarray(p, dtype=float) - at[:-1, None]) / np.diff(at)[:, None], 0.0, 1.0)
    rests = (0.5 * np.sqrt(np.maximum(squares, 0.0)) * np.diff(at))[:, None] * x * (1.0 - x)
    return rests.T @ rests


@dataclass(frozen=True)
class ClassicalFit:
    """A classical form beside a free curve.

    Attributes
    ----------
    form : "linear" | "voce" | "ludwik" | "swift" | "power", or one of rubber (``rubber_forms.py``)
    parameters : {name: value} MPa and -
    chi2 : float
        Misfit of the form: the weighted square distance from the free curve, in its covariance.
    freedom : int
        Points of the curve minus parameters of the form: the misfit expected from noise alone.
    inside : bool
        The misfit is at most the value that noise alone exceeds in 5 % of all tests.
    stress : (m,) MPa, at the points of the curve
    """

    form: str
    parameters: dict[str, float]
    chi2: float
    freedom: int
    inside: bool
    stress: np.ndarray


@dataclass(frozen=True)
class Form:
    """A classical form: names of its parameters, ``curve(points, *parameters)``, starts of the search for (reach of the
    points).

    stresses : its parameters in MPa, started in units of the largest stress; lowest : lower bound of all parameters
    """

    names: tuple[str, ...]
    curve: Callable[..., np.ndarray]
    starts: Callable[[float], Sequence[tuple[float, ...]]]
    stresses: tuple[str, ...]
    lowest: float = 0.0


_S, _H, _Q, _K = "yield_stress", "H", "Q", "K"
FORMS = {
    "linear": Form((_S, _H), lambda p, s, H: s + H * p, lambda r: [(1.0, 0.5)], (_S, _H)),
    "voce": Form((_S, _Q, "b"), lambda p, s, Q, b: s + Q * (1.0 - np.exp(-b * p)),
                 lambda r: [(1.0, 0.3, b / r) for b in np.geomspace(0.5, 30, STARTS)], (_S, _Q)),
    "ludwik": Form((_S, _K, "n"), lambda p, s, K, n: s + K * p**n,
                   lambda r: [(0.9, 0.5, n) for n in np.linspace(0.1, 1.2, STARTS)], (_S, _K)),
    "swift": Form((_K, "strain_0", "n"), lambda p, K, strain_0, n: K * (strain_0 + p) ** n,
                  lambda r: [(1.5, e * r, 0.2) for e in np.geomspace(1e-3, 1.0, STARTS)], (_K,)),
    "power": Form((_K, "n"), lambda p, K, n: K * np.maximum(p, 1e-12) ** n,
                  lambda r: [(1.5, n) for n in np.linspace(0.05, 0.6, STARTS)], (_K,)),
}


def classical_fits(p: np.ndarray, stress: np.ndarray, covariance: np.ndarray, at: Sequence[int] | np.ndarray,
                   forms: Mapping[str, Form] = MappingProxyType(FORMS)) -> tuple[ClassicalFit, ...]:
    """Every classical form fitted to a free curve in its covariance, the best first.

    Parameters
    ----------
    p, stress : (m,) points of the curve, stress in MPa
    covariance : (m, m) MPa^2
    at : places of the points that are compared; more of them than the curve has parameters add nothing
    """
    at = np.asarray(at)
    values, vectors = np.linalg.eigh(covariance[np.ix_(at, at)])
    significant = values > WHITENING_RANK * values[-1]
    white = vectors[:, significant].T / np.sqrt(values[significant])[:, None]
    size, reach = float(np.max(np.abs(stress))), float(np.max(p))
    fits = []
    for name, form in forms.items():
        best = None
        for start in form.starts(reach):
            scale = np.array([size if parameter in form.stresses else 1.0 for parameter in form.names])
            fit = scipy.optimize.least_squares(
                lambda z, form=form, scale=scale: white @ (form.curve(p[at], *(z * scale)) - stress[at]),
                start, bounds=(form.lowest, np.inf), x_scale=np.maximum(np.abs(start), 1e-6), max_nfev=2000)
            if best is None or fit.cost < best[0]:
                best = (fit.cost, fit.x * scale)
        assert best is not None  # every form has a start
        loss, freedom = 2.0 * float(best[0]), int(significant.sum()) - len(form.names)
        inside = freedom > 0 and loss <= scipy.special.chdtri(freedom, 1.0 - NOISE_PROBABILITY)
        fits.append(ClassicalFit(name, dict(zip(form.names, map(float, best[1]), strict=True)), loss, freedom,
                                 bool(inside),
                                 form.curve(p, *best[1])))
    return tuple(sorted(fits, key=lambda fit: fit.chi2))
