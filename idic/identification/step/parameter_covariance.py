"""Standard deviations: the sandwich covariance with the noise of the shared reference image.

    Cov(lam) = P [ spread + sigma^2 S^T H S ] P

with P the inverse of M over the directions that the data determine (docs/method.md, equations 7.4 and 11.4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.correlation import CorrelationSystem
from idic.parameters import ParameterSet, SmoothnessPrior

MAX_DETERMINED_STD = 1.0  # scaled, ln(parameter): a factor e; no step goes along a direction of a larger one
MIN_STATED_SHARE = 0.9  # of the eigenvalue of a direction that the smoothness of free curves alone determines
# of the M of a direction that noise of measured ends makes: from the first on it counts less than it holds, from the
# second on as nothing (N is known within a quarter)
MAX_TRUSTED_END_NOISE, MAX_END_NOISE = 1.0 / 2.0, 2.0 / 3.0
MAX_UNDETERMINED_SHARE = 0.05  # of a parameter in undetermined directions; above, it has no value, std and bias


@dataclass(frozen=True)
class Scaled:
    """The normal equations in scaled unknowns (ln for positive parameters), priors included."""

    names: tuple[str, ...]
    M: np.ndarray  # (n, n)
    b: np.ndarray  # (n,)
    noise: np.ndarray  # (n, n) covariance of b
    slopes: np.ndarray  # (n,) d natural / d scaled
    smooth: np.ndarray | None = None  # (n, n) the part of M that the smoothness of free curves makes
    pull: np.ndarray | None = None  # (n,) the part of b that the priors make
    weight: np.ndarray | None = None  # (n, n) T, where noise of measured ends is in M: b is T b of the data then

    def spectrum(self) -> Spectrum:
        """Eigen-directions of M, strongest first, with the standard deviation that the noise gives each."""
        values, vectors = np.linalg.eigh(0.5 * (self.M + self.M.T))
        order = np.argsort(values)[::-1]
        values, vectors = values[order], vectors[:, order]
        signs = np.sign(vectors[np.argmax(np.abs(vectors), axis=0), np.arange(len(values))])
        vectors = vectors * np.where(signs == 0, 1.0, signs)
        floor = 1e-15 * max(values.max(initial=0.0), 1e-300)
        safe = np.maximum(values, floor)
        quadratic = np.einsum("ij,ik,kj->j", vectors, self.noise, vectors)
        # a direction whose noise is itself lost in rounding is judged by M alone
        stds = np.sqrt(np.maximum(quadratic, values.clip(min=0.0))) / safe
        stds = np.where(values <= floor, np.inf, stds)
        determined = stds < MAX_DETERMINED_STD
        if self.smooth is not None:  # what no data reach follows its neighbours
            prior_part = np.einsum("ij,ik,kj->j", vectors, self.smooth, vectors)
            determined |= (prior_part > MIN_STATED_SHARE * values) & (values > floor)
        return Spectrum(values, vectors, stds, determined)

    def covariance(self, directions: Spectrum) -> np.ndarray:
        """Covariance of the scaled parameters over the determined directions  # (n, n)"""
        return directions.inverse @ self.noise @ directions.inverse


@dataclass(frozen=True)
class Spectrum:
    """Eigenvalues and directions of M, and which of them the data determine."""

    values: np.ndarray  # (n,) descending
    vectors: np.ndarray  # (n, n) columns
    stds: np.ndarray  # (n,) standard deviation along each direction, scaled units
    determined: np.ndarray  # (n,) bool

    @property
    def inverse(self) -> np.ndarray:
        """Inverse of M over the determined directions  # (n, n)"""
        keep = self.vectors[:, self.determined]
        return (keep / self.values[self.determined]) @ keep.T


def scaled_system(system: CorrelationSystem, parameters: ParameterSet, reference_gram: np.ndarray,
                  image_noise: float) -> Scaled:
    """Scale the system and add the priors of its parameters.

    reference_gram : (n, n) S^T H S of the summed columns (``system.shared``) in the reference frame.
    """
    slopes = np.array([parameters[name].slope() for name in system.names])
    M = slopes[:, None] * system.M * slopes[None, :]
    b = slopes * system.b
    noise = slopes[:, None] * (system.spread + image_noise**2 * reference_gram) * slopes[None, :]
    weight = None
    if system.end_noise is not None:
        M, weight = without_end_noise(M, slopes[:, None] * system.end_noise * slopes[None, :])
        b, noise = weight @ b, weight @ noise @ weight.T
    precision, pull = parameters.prior_equations(system.names, slopes)
    smooth = None
    for prior in parameters.joint:
        if isinstance(prior, SmoothnessPrior):
            at, block, _ = prior.normal_equations(parameters, system.names, slopes)
            smooth = np.zeros_like(M) if smooth is None else smooth
            smooth[np.ix_(at, at)] += block
    return Scaled(system.names, M + precision, b + pull, noise + precision, slopes, smooth, pull, weight)


def without_end_noise(M: np.ndarray, end_noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """T (M - N) and T, the best weight of b (docs/method.md, equations 8.6 and 8.7)  # (n, n), (n, n)

    In the directions v with N v = mu M v, T is 1 - mu, less where mu is large, and nothing where it rules.
    """
    size = np.sqrt(np.maximum(np.diagonal(M), 1e-300))
    values, vectors = np.linalg.eigh(M / size[:, None] / size)
    nonzero = values > 1e-12 * max(values.max(initial=0.0), 1e-300)
    white = vectors[:, nonzero] / np.sqrt(values[nonzero]) / size[:, None]  # white^T M white = 1
    mu, turned = np.linalg.eigh(white.T @ end_noise @ white)
    mu = np.clip(mu, 0.0, 1.0)
    counts = (1.0 - mu) * np.clip((MAX_END_NOISE - mu) / (MAX_END_NOISE - MAX_TRUSTED_END_NOISE), 0.0, 1.0)
    across = white @ turned
    along = M @ across
    return (along * (counts * (1.0 - mu))) @ along.T, (along * counts) @ across.T


def undetermined_share(directions: Spectrum) -> np.ndarray:
    """How much of each parameter lies in directions that the data leave open, 0 … 1  # (n,)"""
    return np.sqrt((directions.vectors[:, ~directions.determined] ** 2).sum(axis=1))
