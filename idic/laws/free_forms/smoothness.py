"""The stated smoothness of free curves: a normal prior of the second differences of their values at the knots.

Over the plastic strain a curve changes its slope from interval to interval by 0 ± strength · its mean slope at the
start; over the root of it, by the number of the knot: second differences 0 ± strength · size / (knots - 1). Over the
root, a steep beginning (pⁿ, n < 1) is smooth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

STRAIN, ROOT = "strain", "root"
OVER = (STRAIN, ROOT)
FLAT_SHARE = 1e-3  # of the first value: a starting curve that rises by less counts as rising by that


@dataclass(frozen=True, order=True)
class Smoothness:
    """Prior of the smoothness of a free curve.

    strength : std of the second differences, in units of the starting curve; over : "strain" | "root"
    """

    strength: float = 1.0
    over: str = STRAIN


def bends(knots: np.ndarray, size: float, smoothness: Smoothness) -> np.ndarray:
    """Combinations of the values at the knots that have unit variance in the prior  # (n - 2, n)

    Parameters
    ----------
    knots : (n,) from 0 on
    size : rise of the starting curve over all knots, in the unit of the values
    """
    n, size = len(knots), smoothness.strength * size
    if smoothness.over == ROOT:
        return np.diff(np.eye(n), 2, axis=0) / (size / (n - 1.0))
    slopes = np.diff(np.eye(n), axis=0) / np.diff(knots)[:, None]
    return np.diff(slopes, axis=0) / (size / knots[-1])


def rise(levels: np.ndarray) -> float:
    """The size of a starting hardening curve, MPa; levels : (n,) its values at the knots."""
    return max(float(levels[-1] - levels[0]), FLAT_SHARE * float(levels[0]))
