"""The noise of the reference image, which all frames share: M, b and their covariance (docs/method.md, section 7).

Ordinary least squares weight each residual by 1 / [sigma^2 (1 + 1/N)] (N reference images averaged) and leave the
shared noise to the covariance:

    Cov(b) = spread + w^2 sigma^2 / N  S^T S,      S = sum_t L_t pixel by pixel                  (equation 7.3)

Generalised least squares weight by the inverse of sigma^2 (1/N + delta_ts) over the frames s, t:

    M = w [sum_t L_t^T L_t - S^T c S],   b = w [sum_t L_t^T r_t - S^T c sum_t r_t],   c = 1 / (T + N k)     (7.5, 7.6)

with w = 1/sigma^2, T the number of frames that show a pixel, k the mean of their kappa_t (Sherman and Morrison). This
equals an estimate of a reference without noise together with the parameters. Frame-local unknowns are columns of L that
are zero in all other frames: the reference couples the frames, so all of these unknowns are eliminated at once, after
the sums. S is kept in the nodal basis of the reference, T and k at its nodes; no sum has the size of the image. Sums
over the pixels that a frame shows are exact, so M is the derivative of b whatever pixels are lost.

For any c and any kappa_t the covariance of this b is

    Cov(b) = w [sum_t kappa_t (L_t - c S)^T (L_t - c S) + 1/N (S - T c S)^T (S - T c S)] + channels, priors      (7.7)

At k = 1 it equals M, where all priors are the scatter of a record.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import scipy

from idic.correlation.image_equations.context import CorrelationContext
from idic.correlation.image_equations.equations import Weights, dense
from idic.correlation.pinhole.texture import texture_equations
from idic.correlation.image_equations.system import (
    CorrelationSystem, FrameRecord, LocalEquations, OpenSums, solve_positive,
)

# frame-local ones, in one matrix (0.3 GB): beyond, frame by frame, with the same values within rounding
MAX_DENSE_UNKNOWNS = 6000


def ordinary_variance(references: int) -> float:
    """Variance of a residual over that of one image: its own frame's noise and that of the mean of the references."""
    return 1.0 + 1.0 / references


def closed_system(context: CorrelationContext, system: CorrelationSystem) -> tuple[CorrelationSystem, np.ndarray]:
    """The system of all frames, ready to solve.

    Parameters
    ----------
    system : summed over all frames, of ordinary or generalised weights as ``context.weights`` says

    Returns
    -------
    system : M, b and spread of its kind
    reference_gram : (n, n), what ``image_noise**2`` multiplies in the covariance of b
    """
    def gram(columns: np.ndarray) -> np.ndarray:
        return reference_gram(context, columns)

    texture = texture_equations(context, system.names)
    if texture is None:
        return close(system, context.weights, context.reference.n_images, gram)
    closed, pattern_gram = close(system, context.weights, context.reference.n_images, gram, texture.shared)
    return texture.added_to(closed), pattern_gram


def close(system: CorrelationSystem, weights: Weights, n_images: int, gram: Callable[[np.ndarray], np.ndarray],
          texture: np.ndarray | float = 0.0) -> tuple[CorrelationSystem, np.ndarray]:
    """The same, given the Gram matrix of columns in the basis of the reference, `reference_gram`.

    texture : (n_shared, n) what the reference images' noise multiplies in comparisons of cameras with each other
    """
    sums, variance, shared = system.sums, weights.image_noise**2, dense(system.shared)
    bare = replace(system, shared=shared[:0], sums=None)
    if sums is None or not sums.visible.any():
        return bare, gram(shared + texture) / n_images
    kappa = sums.kappa / np.maximum(sums.visible, 1e-12)  # mean over the frames that show the node
    c = 1.0 / (sums.visible + n_images * np.maximum(kappa, 1e-3))
    if not weights.generalised:
        pattern = c[:, None] * shared  # w c S, in the basis
        cross = variance * pattern.T @ sums.product
        ratio = ordinary_variance(n_images)  # of the two weights of an image
        predicted = system.M + (ratio - 1.0) * sums.image - 0.5 * ratio**2 * (cross + cross.T)
        return replace(bare, predicted=predicted), gram(shared + texture) / n_images
    return _without_pattern(system, sums, c, weights, n_images, gram, texture)


def _without_pattern(system: CorrelationSystem, sums: OpenSums, c: np.ndarray, weights: Weights, n_images: int,
                     gram: Callable[[np.ndarray], np.ndarray],
                     texture: np.ndarray | float) -> tuple[CorrelationSystem, np.ndarray]:
    """Generalised least squares closed: pattern and frame-local unknowns of all frames eliminated.

    c : (n_shared,)
    """
    n, frames, variance = len(system.names), sums.frames, weights.image_noise**2
    if sum(len(f.rhs) for f in frames) > MAX_DENSE_UNKNOWNS:
        return _frame_by_frame(system, sums, c, weights, n_images, gram, texture)
    columns = np.hstack([sums.columns, *(f.columns for f in frames)])  # w S, frame-local unknowns after the shared ones
    product = np.hstack([sums.product, *(f.product for f in frames)])
    noisy = np.hstack([sums.noisy, *(f.kappa[:, None] * f.product for f in frames)])
    pattern = c[:, None] * columns
    cross = variance * pattern.T @ product
    A = _arrow(sums.matrix, [f.cross for f in frames], [f.matrix for f in frames]) - 0.5 * (cross + cross.T)
    b = np.concatenate([sums.rhs, *(f.rhs for f in frames)]) - variance * pattern.T @ sums.residual
    solved = solve_positive(A[n:, n:], np.column_stack([A[n:, :n], b[n:]])) if len(b) > n else np.zeros((0, n + 1))
    slope, step = solved[:, :n], solved[:, n]
    count, readings = len(weights.channels), scipy.linalg.block_diag(*(f.readings for f in frames))  # frame by frame
    answers = solve_positive(A[n:, n:], readings.T) if readings.any() else None
    project = np.vstack([np.eye(n), -slope])  # column i of the projected problem

    noise = _arrow(sums.noise, [f.noise_cross for f in frames], [f.noise for f in frames])
    pattern, columns = pattern @ project, columns @ project
    crossed = variance * pattern.T @ (noisy @ project)
    spread = project.T @ noise @ project - crossed - crossed.T + variance * gram(np.sqrt(sums.kappa)[:, None] * pattern)
    plain = system.phi_image / ordinary_variance(n_images)  # phi stays the sum that ordinary least squares make small
    closed = replace(system, phi=system.phi - system.phi_image + plain, phi_image=plain, generalised=True, sums=None,
                     shared=dense(system.shared)[:0], M=A[:n, :n] - A[:n, n:] @ slope, b=b[:n] - slope.T @ b[n:],
                     spread=spread, frames=_with_steps(system.frames, frames, step, slope),
                     retention=None if answers is None else np.array([
                         np.eye(len(frames)) - weight * readings[k::count] @ answers[:, k::count]
                         for k, weight in enumerate(weights.channels)]))
    return closed, gram(columns - sums.visible[:, None] * pattern + texture) / n_images


def _frame_by_frame(system: CorrelationSystem, sums: OpenSums, c: np.ndarray, weights: Weights, n_images: int,
                    gram: Callable[[np.ndarray], np.ndarray],
                    texture: np.ndarray | float) -> tuple[CorrelationSystem, np.ndarray]:
    """The same for many frame-local unknowns, without a matrix of all of them.

    With blocks B of the frames and U = [pattern, product]^T of their unknowns, A = B - variance/2 U J U^T, J exchanges
    the two halves: its inverse follows from a matrix of 2 n_shared rows (Sherman, Morrison and Woodbury). Beside
    `sums`, which may lie on disk, memory grows with the frames by the squared number of all readings alone.
    """
    n, r, variance = len(system.names), len(c), weights.image_noise**2
    half, count = 0.5 * variance, len(weights.channels)
    pattern = c[:, None] * sums.columns
    inner, outer, couplings, variances = np.zeros((2 * r, 2 * r)), np.zeros((2 * r, n + 1)), [], []
    inner[:r, r:] = inner[r:, :r] = np.eye(r) / half

    def sides(f: LocalEquations) -> tuple[np.ndarray, np.ndarray]:
        scaled, product = c[:, None] * f.columns, np.asarray(f.product)
        coupled = f.cross - half * (scaled.T @ sums.product + product.T @ pattern)
        return np.hstack([scaled.T, product.T]), np.column_stack([coupled, f.rhs - variance * scaled.T @ sums.residual])

    for f in sums.frames:
        U, Y = sides(f)
        solved = solve_positive(f.matrix, np.hstack([U, Y]))
        inner -= U.T @ solved[:, :2 * r]
        outer += U.T @ solved[:, 2 * r:]
        of_readings = solve_positive(f.matrix, f.readings.T)
        couplings.append(U.T @ of_readings)
        variances.append((f.readings * of_readings.T).sum(axis=1))
    factor, between = scipy.linalg.lu_factor(inner), np.hstack(couplings)
    outer = scipy.linalg.lu_solve(factor, outer)
    turned = scipy.linalg.lu_solve(factor, between)
    retention = None if not between.any() else np.array([
        np.diag(1.0 - weight * np.array(variances)[:, k]) - weight * between[:, k::count].T @ turned[:, k::count]
        for k, weight in enumerate(weights.channels)])
    cross = variance * pattern.T @ sums.product
    M, b = sums.matrix - 0.5 * (cross + cross.T), sums.rhs - variance * pattern.T @ sums.residual
    noise, columns, noisy, steps, slopes = sums.noise.copy(), sums.columns.copy(), sums.noisy.copy(), [], []
    for f in sums.frames:
        U, Y = sides(f)
        solved = solve_positive(f.matrix, Y + U @ outer)
        slope, step = solved[:, :n], solved[:, n]
        M -= Y[:, :n].T @ slope
        b -= slope.T @ Y[:, n]
        crossed = f.noise_cross.T @ slope
        noise += slope.T @ f.noise @ slope - crossed - crossed.T
        columns -= f.columns @ slope
        noisy -= f.kappa[:, None] * (f.product @ slope)
        steps.append(step)
        slopes.append(slope)
    pattern = c[:, None] * columns
    crossed = variance * pattern.T @ noisy
    spread = noise - crossed - crossed.T + variance * gram(np.sqrt(sums.kappa)[:, None] * pattern)
    plain = system.phi_image / ordinary_variance(n_images)
    closed = replace(system, phi=system.phi - system.phi_image + plain, phi_image=plain, generalised=True, sums=None,
                     shared=dense(system.shared)[:0], M=M, b=b, spread=spread,
                     frames=_with_steps(system.frames, sums.frames, np.concatenate(steps), np.vstack(slopes)),
                     retention=retention)
    return closed, gram(columns - sums.visible[:, None] * pattern + texture) / n_images


def _arrow(shared: np.ndarray, crosses: Sequence[np.ndarray], blocks: Sequence[np.ndarray]) -> np.ndarray:
    """A symmetric matrix of shared unknowns, and of frame-local ones that know nothing of other frames."""
    n = len(shared)
    size = n + sum(len(block) for block in blocks)
    matrix, first = np.zeros((size, size)), n
    matrix[:n, :n] = shared
    for cross, block in zip(crosses, blocks, strict=True):
        end = first + len(block)
        matrix[first:end, first:end] = block
        matrix[first:end, :n] = cross
        matrix[:n, first:end] = cross.T
        first = end
    return matrix


def _with_steps(frames: Sequence[FrameRecord], equations: Sequence[LocalEquations], step: np.ndarray,
                slope: np.ndarray) -> tuple[FrameRecord, ...]:
    """The records of the frames, their local unknowns and channels corrected by the common solution."""
    records, first = [], 0
    for record, f in zip(frames, equations, strict=True):
        m, nb = len(record.local_step), len(record.brightness)
        unknowns = slice(first, first + m + nb)
        local = record.local_step + step[first:first + m]
        brightness = record.brightness + step[first + m:first + m + nb]
        records.append(replace(record, local_step=local, local_slope=-slope[first:first + m], brightness=brightness,
                               channel_residual=record.channel_residual - f.readings @ step[unknowns],
                               channel_columns=f.shared_readings - f.readings @ slope[unknowns]))
        first += m + nb
    return tuple(records)


def reference_gram(context: CorrelationContext, shared: np.ndarray) -> np.ndarray:
    """S^T S of summed columns (``CorrelationSystem.shared``) in the undeformed reference frames  # (n, n)"""
    total, first = 0.0, 0
    for camera in context.cameras:
        gram, n_rows = camera.reference.shared_gram(camera.experiment, shared[first:])
        total, first = total + gram, first + n_rows
    return total  # type: ignore[return-value]
