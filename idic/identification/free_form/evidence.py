"""The number of knots and the smoothness of a free function by their evidence, in the linearised problem.

A function with many knots has been identified. With its normal equations M, b of the data, every one of fewer knots is
a linear restriction T, and its evidence follows in closed form (Laplace; exact where the problem is linear):

    ln Z = - min_c [ |data| + |prior| ] / 2 - ln det(T^T M T + P) / 2 + ln det Q,   P = sum over bends q of q q^T

Q are the unknowns of unit density: the other parameters, the first and the last value of a curve, and the bends; of
more bends than unknowns ln det(Q^T Q) / 2 counts. Values that are never negative (spectra, yield surfaces) count as
free in ln Z; the values themselves are the best of zero or more. The penalty for knots that the data do not need is in
the determinants. MacKay, Neural Comput. 4 (1992) 415, doi:10.1162/neco.1992.4.3.415. Of the numbers against which the
evidence is not strong the smallest is taken whose function is that of the largest within a part of its standard
deviation: fewer knots leave an error that no band shows. Strong: ln Z lower by 3, odds of 20; Kass & Raftery, J. Am.
Stat. Assoc. 90 (1995) 773, doi:10.1080/01621459.1995.10476572.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from idic.identification.free_form.forms import NUMBERS, FreeForm
from idic.laws import ROOT, Smoothness

MOST_KNOTS = NUMBERS[-1]  # of the curve that is identified first
STRENGTHS = (0.03, 0.1, 0.3, 1.0, 3.0)
STRONG = 3.0  # of ln Z
SAME_CURVE = 0.3  # of a standard deviation as the band has it, at every place that is compared
ROOT_HANDICAP = 8.0  # ln of the prior odds against a curve of infinite slope at its beginning
MAX_STD = 1e3  # scaled: of other parameters that the data leave open


@dataclass(frozen=True)
class ChosenKnots:
    """What the evidence says of a free function.

    levels : (n,) values at the chosen knots where the data and the chosen prior have them; evidence : ln Z of every
    number of knots with its best smoothness, minus that of the best
    """

    n: int
    smoothness: Smoothness
    levels: np.ndarray
    evidence: Mapping[int, float]

    @classmethod
    def of(cls, M: np.ndarray, b: np.ndarray, values: np.ndarray, slopes: np.ndarray, form: FreeForm,
           numbers: Sequence[int] = ()) -> ChosenKnots:
        """Knots and smoothness of one free function.

        Parameters
        ----------
        M, b : (p, p), (p,) normal equations of the scaled parameters, without the priors of this function
        values, slopes : (p,) parameters where they were linearised, and d value / d scaled
        form : the free function, of as many knots as were identified
        numbers : of knots to try; none: those of the form
        """
        numbers, n_others = numbers or form.numbers, len(values) - len(form.at)
        candidates: dict[tuple[int, Smoothness], _Judged] = {}
        for n in numbers:
            T = _restriction(len(values), form, n, slopes)
            data, pull = T.T @ M @ T, T.T @ (M @ (values / slopes) + b)
            for over in form.over:
                for strength in STRENGTHS:
                    smoothness = Smoothness(strength, over)
                    candidates[n, smoothness] = _judged(data, pull, form.bends(n, smoothness), form.ends(n),
                                                        form.centre)
        handicapped = {key: candidate.ln_z - ROOT_HANDICAP * (key[1].over == ROOT)
                       for key, candidate in candidates.items()}
        over = max(handicapped, key=lambda key: handicapped[key])[1].over
        best = {n: max((candidates[n, Smoothness(s, over)].ln_z, Smoothness(s, over)) for s in STRENGTHS)[1]
                for n in numbers}
        top = max(candidates[n, best[n]].ln_z for n in numbers)
        evidence = {n: candidates[n, best[n]].ln_z - top for n in numbers}
        possible = sorted(n for n in numbers if evidence[n] >= -STRONG)
        finest = possible[-1]
        levels = {n: candidates[n, best[n]].values(n_others, form.lowest) for n in possible}
        basis = form.seen(finest, finest)
        covariance = np.linalg.pinv(candidates[finest, best[finest]].A, hermitian=True)
        stds = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", basis, covariance[n_others:, n_others:], basis), 0.0)
                       + form.family_error**2)
        n = next(n for n in possible if np.all(
            np.abs(form.seen(n, finest) @ levels[n] - basis @ levels[finest]) <= SAME_CURVE * stds))
        return cls(n, best[n], levels[n], evidence)


@dataclass(frozen=True)
class _Judged:
    """A number of knots with one smoothness: ln Z up to what all have in common, normal equations with the prior."""

    ln_z: float
    A: np.ndarray
    pull: np.ndarray

    def values(self, n_others: int, lowest: float) -> np.ndarray:
        """The most probable values of the function  # (m,)"""
        values = np.linalg.lstsq(self.A, self.pull, rcond=None)[0]
        if (values[n_others:] < lowest).any():
            size, axes = np.linalg.eigh(self.A)
            root = np.sqrt(np.maximum(size, size[-1] * 1e-14))
            bound = np.full(len(values), -np.inf)
            bound[n_others:] = lowest
            values = scipy.optimize.lsq_linear(root[:, None] * axes.T, (axes.T @ self.pull) / root, (bound, np.inf),
                                               method="bvls").x
        return values[n_others:]


def _restriction(n_all: int, form: FreeForm, n: int, slopes: np.ndarray) -> np.ndarray:
    """All scaled parameters by the others (scaled) and m values of the function with n knots  # (p, p - p_form + m)"""
    at, finer = list(form.at), form.finer(n)
    other_parameters = [i for i in range(n_all) if i not in form.at]
    T = np.zeros((n_all, len(other_parameters) + finer.shape[1]))
    T[other_parameters, range(len(other_parameters))] = 1.0
    T[at, len(other_parameters):] = finer / slopes[at][:, None]
    return T


def _judged(data: np.ndarray, pull: np.ndarray, rows: np.ndarray, ends: np.ndarray, centre: float) -> _Judged:
    """rows, ends : bends and unknowns of unit density of the function's values, whose bends vanish at `centre`"""
    n_others = len(pull) - rows.shape[1]
    A, pull = data.copy(), pull.copy()
    A[:n_others, :n_others] += np.eye(n_others) / MAX_STD**2
    A[n_others:, n_others:] += rows.T @ rows
    from_zero = rows.sum(axis=1) * centre
    pull[n_others:] += rows.T @ from_zero
    solution = np.linalg.lstsq(A, pull, rcond=None)[0]
    volume = np.log(np.linalg.svd(np.vstack([ends, rows]), compute_uv=False)).sum()
    volume -= 0.5 * np.linalg.slogdet(A)[1] + 0.5 * from_zero @ from_zero
    return _Judged(float(0.5 * solution @ pull + volume), A, pull)
