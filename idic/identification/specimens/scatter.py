"""Standard deviation between specimens, from a value and a standard deviation of each.

    y_i = mu + eta_i + e_i,     eta_i ~ N(0, tau²),   e_i ~ N(0, s_i²)   (docs/method.md, equation 16.2)
    Q(tau²) = sum_i (y_i - mu)² / (s_i² + tau²),     mu = sum_i w_i y_i / sum_i w_i,   w_i = 1 / (s_i² + tau²)   (16.3)

Q has the chi-square distribution of k - 1 degrees of freedom at the true tau. The estimate is where Q is its mean
(Paule and Mandel 1982, doi:10.6028/jres.087.022), the interval where it is the quantiles (Viechtbauer 2007,
doi:10.1002/sim.2514).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

MIN_SPECIMENS = 2  # that determine a parameter


@dataclass(frozen=True)
class Scatter:
    """Of one parameter.

    std : tau; ci95 : its interval; mean, mean_std : of the material that the specimens are drawn from;
    p_value : of no scatter (chi-square test of homogeneity)
    """

    std: float
    ci95: tuple[float, float]
    mean: float
    mean_std: float
    p_value: float


def scatter(values: Sequence[float], stds: Sequence[float]) -> Scatter:
    """The scatter between k >= 2 specimens.

    Raises
    ------
    ValueError
        Fewer than two specimens.
    """
    y, s = np.asarray(values, float), np.asarray(stds, float)
    dof = len(y) - 1
    if dof < MIN_SPECIMENS - 1:
        raise ValueError("one specimen shows no scatter")
    variance = _solved(y, s, float(dof))
    low, high = (_solved(y, s, 2.0 * float(scipy.special.gammaincinv(0.5 * dof, p))) for p in (0.975, 0.025))
    mean, weights = _mean(y, s, variance)
    return Scatter(float(np.sqrt(variance)), (float(np.sqrt(low)), float(np.sqrt(high))), mean,
                   float(1.0 / np.sqrt(weights.sum())), float(scipy.special.chdtrc(dof, _q(y, s, 0.0))))


def _mean(y: np.ndarray, s: np.ndarray, variance: float) -> tuple[float, np.ndarray]:
    weights = 1.0 / (s**2 + variance)
    return float(weights @ y / weights.sum()), weights


def _q(y: np.ndarray, s: np.ndarray, variance: float) -> float:
    mean, weights = _mean(y, s, variance)
    return float(weights @ (y - mean) ** 2)


def _solved(y: np.ndarray, s: np.ndarray, target: float) -> float:
    """tau² at which Q has this value; 0 where Q is smaller already."""
    if _q(y, s, 0.0) <= target:
        return 0.0
    top = float(np.sum((y - y.mean()) ** 2)) / target
    return float(scipy.optimize.brentq(lambda variance: _q(y, s, variance) - target, 0.0, top, xtol=1e-14 * top,
                                       rtol=1e-12))
