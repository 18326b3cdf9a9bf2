"""The reference image's noise is shared by all frames: what that does to M, b and their covariance.

The residuals of frame t carry eta_f + eta_t, with eta_f the same in every frame. Ordinary least squares weight each by
1 / [sigma^2 (1 + 1/N)] (N reference images averaged) and leave the rest to the covariance:

    Cov(b) = spread + w^2 sigma^2 / N  S^T S,      S = sum_t L_t pixel by pixel

Generalised least squares weight by the inverse of sigma^2 (1/N + delta_ts) over frames s, t:

    M = w [sum_t L_t^T L_t - c S^T S],   b = w [sum_t L_t^T r_t - c S^T sum_t r_t],   w = 1/sigma^2, c = 1 / (T + N k)

(k: mean of the kappa_t; Sherman and Morrison). It is as if the pattern without noise were estimated along with the
parameters. Frame-local unknowns are taken out of columns and residuals first, so S and sum_t r_t hold what they leave.
Pixel-sized sums never exist: both live in the nodal basis of the reference frame, whose Gram matrix does the rest.

For any c (and any kappa_t) the covariance of this b is

    Cov(b) = spread + [c^2 T k - 2 c k + (1 - c T)^2 / N] w S^T S

which at k = 1 equals M where nothing but images counts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from idic.correlation.comparison import compare
from idic.correlation.cross_section import SectionReference, section_gram, section_rows
from idic.correlation.rows import CorrelationContext
from idic.correlation.system import CorrelationSystem, Weights
from idic.correlation.view import view_of


def ordinary_share(references: int) -> float:
    """Variance of a residual over that of one image: its own frame's noise and that of the mean of the references."""
    return 1.0 + 1.0 / references


def generalised_weights(weights: Weights) -> Weights:
    """The weights of generalised least squares: every image by its own noise alone."""
    return replace(weights, image=weights.image_noise**-2, cameras=tuple(n**-2 for n in weights.camera_noise),
                   generalised=True)


def closed_system(context: CorrelationContext, system: CorrelationSystem) -> tuple[CorrelationSystem, np.ndarray]:
    """The sum over all frames made ready to solve, without what only sums need.

    Parameters
    ----------
    system : summed over all frames, of ordinary or generalised weights as ``context.weights`` says

    Returns
    -------
    system : M, b and spread of its kind
    reference_gram : (n, n), what ``image_noise**2`` multiplies in the covariance of b
    """
    return close(system, context.weights, context.reference.n_images, reference_gram(context, system.shared),
                 lambda columns: reference_product(context, columns))


def close(system: CorrelationSystem, weights: Weights, n_images: int, gram: np.ndarray,
          times: Callable[[np.ndarray], np.ndarray]) -> tuple[CorrelationSystem, np.ndarray]:
    """The same, given S^T S of ``system.shared`` and the product of the reference's basis with such columns."""
    sums = system.sums
    bare = replace(system, shared=system.shared[:0], sums=None)
    if sums is None or sums.frames == 0.0:
        return bare, gram / n_images
    kappa = sums.kappa / sums.frames
    c = 1.0 / (sums.frames + n_images * kappa)
    own = weights.image_noise**2 * gram  # w S^T S with the weights of generalised least squares
    if not weights.generalised:
        ratio = ordinary_share(n_images)  # of the two weights of an image
        predicted = system.M + (ratio - 1.0) * sums.image - c * ratio**2 * own
        return replace(bare, predicted=predicted), gram / n_images
    left = sums.residual - times(sums.fit)  # (n_shared,) what the local unknowns leave
    closed = replace(bare, M=system.M - c * own, b=system.b - c * weights.image_noise**2 * system.shared.T @ left,
                     spread=system.spread + (c**2 * sums.frames - 2.0 * c) * kappa * own, generalised=True)
    return closed, (1.0 - c * sums.frames) ** 2 / n_images * gram


def reference_gram(context: CorrelationContext, shared: np.ndarray) -> np.ndarray:
    """S^T S of summed columns (``CorrelationSystem.shared``) in the undeformed reference frames  # (n, n)"""
    total, first = 0.0, 0
    for camera in context.cameras:
        if isinstance(camera.reference, SectionReference):
            last = first + section_rows(camera.reference, camera.experiment.options.brightness)
            total = total + section_gram(camera.reference, shared[first:last])
        else:
            product = _times_gram(camera, shared[first:])
            last = first + len(product)
            total = total + shared[first:last].T @ product
        first = last
    return total


def reference_product(context: CorrelationContext, shared: np.ndarray) -> np.ndarray:
    """The Gram matrix of the nodal and brightness bases of the reference frames times `shared`  # (n_shared, ...)"""
    parts, first = [], 0
    for camera in context.cameras:
        parts.append(_times_gram(camera, shared[first:]))
        first += len(parts[-1])
    return np.concatenate(parts)


def _times_gram(camera: CorrelationContext, shared: np.ndarray) -> np.ndarray:
    """The same for one camera, whose rows are the first of `shared`."""
    experiment = camera.experiment
    rest = np.zeros((len(experiment.mesh.nodes), view_of(experiment, camera.camera).n_components))
    still = compare(experiment, camera.reference, experiment.reference, rest)
    n_dof = still.H.shape[0]
    fields, brightness = shared[:n_dof], shared[n_dof:n_dof + still.n_brightness]
    return np.concatenate([still.H @ fields + still.hb @ brightness, still.hb.T @ fields + still.bb @ brightness])
