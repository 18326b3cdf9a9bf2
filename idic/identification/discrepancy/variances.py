"""Variances of a discrepancy by restricted maximum likelihood, and what it adds to the covariance of the parameters.

With P the inverse of M over the determined directions, the part of y that no parameter explains is

    z = y - A P b,      z ~ N(0, (1 + v_0) C + sum_c v_c (G - A P A^T) K_c (G - A P A^T)^T)  (docs/method.md, 14.5)

with C its noise. v_0 is the rough part: what is finer than the fields reaches the sums as noise does. The parameters
have taken their share of the discrepancy into their values; z holds the rest alone, so the variances are those of the
whole. They add

    Cov_model(b) = A^T (sum_c v_c K_c) A + v_0 Cov(b)                                       (14.6)

to the covariance of b. All v >= 0; none is left where noise alone has the likelihood of the smooth fields (Self and
Liang 1987, doi:10.1080/01621459.1987.10478472; Patterson and Thompson 1971, doi:10.1093/biomet/58.3.545), and no rough
part where the smooth fields alone have its likelihood. The error m of b by a coarse mesh adds m m^T (14.7); what it
leaves in z is known, and no discrepancy (14.8), unless the recording contradicts it. Where its size alone is known, z
stays as it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
from scipy.linalg import cho_factor, cho_solve

from idic.identification.discrepancy.normal_equations import DiscrepancySystem

ROUGH = "rough"  # name of the part finer than the fields; its unit is the standard deviation of the noise
MIN_LIKELIHOOD_RATIO = 6.0  # twice the gain: of smooth fields by noise alone in about one recording of a hundred
# of the largest eigenvalue of the noise of z: less is a direction that parameters take but for rounding
MIN_NOISE_SHARE = 1e-5
STARTS = (0.01, 1.0)  # of the mean variance of noise
MAX_CONTRADICTION = 25.0  # twice the log-likelihood that a recording may lose by the error of the mesh: five std


@dataclass(frozen=True, eq=False)
class Variances:
    """The estimate.

    std : per component, in its unit, and of the rough part; likelihood_ratio : twice the gain in log-likelihood of the
    smooth fields over noise alone; covariance : (n, n) Cov_model(b), scaled; mesh : the error of the mesh is known and
    counted
    """

    std: dict[str, float]
    likelihood_ratio: float
    covariance: np.ndarray
    mesh: bool = False

    @property
    def significant(self) -> bool:
        return self.likelihood_ratio > MIN_LIKELIHOOD_RATIO


def estimate(system: DiscrepancySystem, inverse: np.ndarray, slopes: np.ndarray, b: np.ndarray,
             weight: np.ndarray | None = None) -> Variances:
    """Estimate the variances.

    Parameters
    ----------
    inverse : (n, n) P, in scaled unknowns, priors included
    slopes : (n,) d natural / d scaled
    b : (n,) right-hand side of the parameters, scaled, priors included
    weight : (n, n) of the data in b (`Scaled.weight`), None: as they are
    """
    n = system.n
    A = system.M[n:, :n] * slopes
    regression = A @ inverse
    z = system.b[n:] - regression @ b
    if weight is not None:
        regression = regression @ weight
    project = np.hstack([-regression * slopes, np.eye(len(A))])  # of noise in internal units
    noise = project @ system.noise @ project.T
    G = system.M[n:, n:] - regression @ A.T
    white = _whitening(noise)
    fields = _split(white @ G, system)
    parts = tuple(part @ part.T for part in fields)
    fit, mesh = _fit(_Likelihood(white @ z, parts), system.may_be_rough), system.mesh_error is not None
    if mesh and not system.mesh_size_only:
        remainder = z - (system.mesh_error[n:] - regression @ (slopes * system.mesh_error[:n]))
        of_finer = _fit(_Likelihood(white @ remainder, parts), system.may_be_rough)
        mesh = 2.0 * (of_finer.negative_log - fit.negative_log) <= MAX_CONTRADICTION
        fit = of_finer if mesh else fit
    covariance = fit.rough * slopes[:, None] * system.noise[:n, :n] * slopes
    if fit.is_significant:
        for v, part in zip(fit.smooth, _split(A.T, system), strict=True):
            covariance += v * part @ part.T
    if mesh:
        covariance += np.outer(slopes * system.mesh_error[:n], slopes * system.mesh_error[:n])
    std = {c.name: float(np.sqrt(v)) for c, v in zip(system.components, fit.smooth, strict=True)}
    return Variances(std | {ROUGH: float(np.sqrt(fit.rough))}, fit.ratio, covariance, mesh)


def _split(columns: np.ndarray, system: DiscrepancySystem) -> list[np.ndarray]:
    """Columns of the amplitudes of every component times the root of their correlation  # (rows, q) -> (rows, q_c)
    each"""
    ends = np.cumsum([len(c.root) for c in system.components])
    return [columns[:, end - len(c.root):end] @ c.root for c, end in zip(system.components, ends, strict=True)]


def _whitening(noise: np.ndarray) -> np.ndarray:
    """W with W noise W^T = 1 over the directions that hold noise  # (q, q) -> (m, q)"""
    diagonal = np.diagonal(noise)
    scale = np.where(diagonal > 0.0, 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)), 0.0)
    values, vectors = np.linalg.eigh(noise * np.outer(scale, scale))
    keep = values > MIN_NOISE_SHARE * values.max(initial=0.0)
    return (vectors[:, keep] / np.sqrt(values[keep])).T * scale


@dataclass(frozen=True)
class _Fit:
    """Variances of the smooth fields and of the rough part, twice the gain of the smooth fields in log-likelihood over
    noise alone, and the negative log-likelihood with what is significant."""

    smooth: tuple[float, ...]
    rough: float
    ratio: float
    negative_log: float

    @property
    def is_significant(self) -> bool:
        return self.ratio > MIN_LIKELIHOOD_RATIO


def _fit(likelihood: _Likelihood, may_be_rough: bool) -> _Fit:
    """Smooth fields, and a rough part where they are significant and it is significant beside them."""
    smooth, ratio, lowest = likelihood.maximum()
    smooth_fit = _Fit(tuple(smooth), 0.0, ratio, lowest)
    if not smooth_fit.is_significant:
        return replace(smooth_fit, negative_log=lowest + 0.5 * ratio)
    if may_be_rough:
        (*several, rough), with_rough, lower = likelihood.with_rough().maximum()
        if with_rough - ratio > MIN_LIKELIHOOD_RATIO:
            return _Fit(tuple(several), float(rough), ratio, lower)
    return smooth_fit


@dataclass(frozen=True, eq=False)
class _Likelihood:
    """Of white z (m,) with covariance 1 + sum_c v_c parts_c."""

    z: np.ndarray
    parts: tuple[np.ndarray, ...]

    def with_rough(self) -> _Likelihood:
        """A further part that is as the noise is."""
        return _Likelihood(self.z, (*self.parts, np.eye(len(self.z))))

    def maximum(self) -> tuple[np.ndarray, float, float]:
        """Variances (>= 0) of the largest likelihood, twice its logarithm's gain over none, its negative logarithm."""
        scale = np.array([len(self.z) / max(np.trace(part), 1e-300) for part in self.parts])
        nothing = self._negative_log(np.zeros(len(self.parts)))[0]
        best, lowest = np.zeros(len(self.parts)), nothing

        def function(x: np.ndarray) -> tuple[float, np.ndarray]:
            value, slope = self._negative_log(x * scale)
            return value, slope * scale

        for start in STARTS:
            optimum = scipy.optimize.minimize(function, np.full(len(self.parts), start), jac=True, method="L-BFGS-B",
                             bounds=[(0.0, None)] * len(self.parts))
            if optimum.fun < lowest:
                best, lowest = optimum.x * scale, float(optimum.fun)
        return best, 2.0 * (nothing - lowest), lowest

    def _negative_log(self, variances: np.ndarray) -> tuple[float, np.ndarray]:
        """Negative logarithm of the likelihood and its derivatives."""
        V = np.eye(len(self.z)) + sum(v * part for v, part in zip(variances, self.parts, strict=True))
        factor = cho_factor(V, lower=True)
        weighed, inverse = cho_solve(factor, self.z), cho_solve(factor, np.eye(len(V)))
        value = 0.5 * self.z @ weighed + np.log(np.diagonal(factor[0])).sum()
        return float(value), np.array([0.5 * (np.vdot(inverse, part) - weighed @ part @ weighed)
                                       for part in self.parts])
