"""The number of knots and the smoothness of a free curve by their evidence, in the linearised problem.

A curve with many knots has been identified. With its normal equations M, b of the data, every curve of fewer knots is a
linear restriction T, and its evidence follows in closed form (Laplace; exact where the problem is linear):

    ln Z = - min_c [ |data| + |prior| ] / 2 - ln det(T^T M T + P) / 2 + ln det Q,   P = sum over bends q of q q^T

Q are the unknowns of unit density: the other parameters, the first and the last value of the curve, and the bends.
The penalty for knots that the data do not need is in the determinants. MacKay, Neural Comput. 4 (1992) 415,
doi:10.1162/neco.1992.4.3.415. Of the numbers against which the evidence is not strong the smallest is taken whose curve
is that of the largest within a part of its standard deviation: the chords of fewer knots leave an error that no band
shows. Strong: ln Z lower by 3, odds of 20; Kass & Raftery, J. Am. Stat. Assoc. 90 (1995) 773,
doi:10.1080/01621459.1995.10476572.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from idic.materials.composed.free_curve import basis, knots
from idic.materials.composed.smoothness import ROOT, STRAIN, Smoothness, bends

NUMBERS = (4, 6, 8, 10, 12, 16, 20, 24)  # of knots
MOST_KNOTS = NUMBERS[-1]  # of the curve that is identified first
STRENGTHS = (0.03, 0.1, 0.3, 1.0, 3.0)
STRONG = 3.0  # of ln Z
SAME_CURVE = 0.3  # of a standard deviation, at every knot of the finer curve
ROOT_HANDICAP = 8.0  # ln of the prior odds against a curve of infinite slope at its beginning
MAX_STD = 1e3  # scaled: of other parameters that the data leave open


@dataclass(frozen=True)
class FreeCurve:
    """A free curve in the list of parameters.

    at : (n,) places of its values; last : its last knot; size : of its starting curve; over : smoothness to try
    """

    at: tuple[int, ...]
    last: float
    size: float
    over: tuple[str, ...] = (STRAIN, ROOT)


@dataclass(frozen=True)
class ChosenKnots:
    """What the evidence says of a curve.

    levels : (n,) values at the chosen knots where the data and the chosen prior have them; evidence : ln Z of every
    number of knots with its best smoothness, minus that of the best
    """

    n: int
    smoothness: Smoothness
    levels: np.ndarray
    evidence: Mapping[int, float]


def choose_knots(M: np.ndarray, b: np.ndarray, values: np.ndarray, slopes: np.ndarray, curve: FreeCurve,
                 numbers: Sequence[int] = NUMBERS) -> ChosenKnots:
    """Knots and smoothness of one curve.

    Parameters
    ----------
    M, b : (p, p), (p,) normal equations of the scaled parameters, without the prior of this curve
    values, slopes : (p,) parameters where they were linearised, and d value / d scaled
    curve : the free curve, of as many knots as were identified
    """
    found = {}
    for n in numbers:
        T = _restriction(len(values), curve, n, slopes)
        data, pull = T.T @ M @ T, T.T @ (M @ (values / slopes) + b)
        for over in curve.over:
            for strength in STRENGTHS:
                smoothness = Smoothness(strength, over)
                found[n, smoothness] = _judged(data, pull, bends(knots(curve.last, n), curve.size, smoothness))
    handicapped = {key: ln_z - ROOT_HANDICAP * (key[1].over == ROOT) for key, (ln_z, *_) in found.items()}
    over = max(handicapped, key=lambda key: handicapped[key])[1].over
    best = {n: max((found[n, Smoothness(s, over)][0], Smoothness(s, over)) for s in STRENGTHS)[1] for n in numbers}
    top = max(found[n, best[n]][0] for n in numbers)
    evidence = {n: found[n, best[n]][0] - top for n in numbers}
    possible = sorted(n for n in numbers if evidence[n] >= -STRONG)
    finest = possible[-1]
    at, (_, fine, stds) = knots(curve.last, finest), found[finest, best[finest]]
    n = next(n for n in possible if np.all(
        np.abs(basis(at, curve.last, n) @ found[n, best[n]][1] - fine) <= SAME_CURVE * stds))
    return ChosenKnots(n, best[n], found[n, best[n]][1], evidence)


def _restriction(n_all: int, curve: FreeCurve, n: int, slopes: np.ndarray) -> np.ndarray:
    """All scaled parameters by the others (scaled) and n values of the curve  # (p, p - n_fine + n)"""
    others = [i for i in range(n_all) if i not in curve.at]
    T = np.zeros((n_all, len(others) + n))
    T[others, range(len(others))] = 1.0
    at = list(curve.at)
    T[at, len(others):] = basis(knots(curve.last, len(at)), curve.last, n) / slopes[at][:, None]
    return T


def _judged(data: np.ndarray, pull: np.ndarray, rows: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """ln Z up to what all restrictions share, the most probable values of the curve (n,) and their stds (n,)"""
    n = rows.shape[1]
    others = len(pull) - n
    A = data.copy()
    A[:others, :others] += np.eye(others) / MAX_STD**2
    A[others:, others:] += rows.T @ rows
    unit = np.eye(len(pull))
    unit[others + 1:] = 0.0
    unit[others + 1, -1] = 1.0
    unit[others + 2:, others:] = rows
    found = np.linalg.lstsq(A, pull, rcond=None)[0]
    volume = np.linalg.slogdet(unit)[1] - 0.5 * np.linalg.slogdet(A)[1]
    stds = np.sqrt(np.diagonal(np.linalg.pinv(A, hermitian=True))[others:])
    return float(0.5 * found @ pull + volume), found[others:], stds
