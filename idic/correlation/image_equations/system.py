"""M, b and the functional as records that add up over the frames.

    M = sum_t [w L^T L + sum_c w_c rho_c rho_c^T],      b = sum_t [w L^T r + sum_c w_c rho_c r_c]

(docs/method.md, equation 2.5). Gain and offset, the noise of a logged boundary motion and the nodes of a measured
boundary are unknowns of one frame only. They are eliminated there (docs/method.md, equations 8.2 to 8.5) and solved for
afterwards. Source: Neggers et al. 2015, equations 6, 7, 16 and 17.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from idic.correlation.image_equations.equations import ColumnSum, FrameEquations, SeenColumns, Weights, added, dense

MAX_ROUNDING = 1e-6  # of an eigenvalue that is zero, in sums of single precision over their diagonal


@dataclass(frozen=True)
class SharedSums:
    """Sums over frames for generalised least squares, in the reference frame's nodal basis; weighted.

    residual : (n_shared,) residuals less their part in frame-local unknowns; product : (n_shared, n) their negative
    derivative; noisy : (n_shared, n) the same, each frame times its kappa; visible, kappa : (n_shared,) number of
    frames that show the surroundings of a node, and the sum of their kappa; image : (n, n) the images' part of M.
    """

    residual: np.ndarray
    product: np.ndarray
    noisy: np.ndarray
    visible: np.ndarray
    kappa: np.ndarray
    image: np.ndarray

    def __add__(self, summand: SharedSums) -> SharedSums:
        return SharedSums(*(getattr(self, f.name) + getattr(summand, f.name) for f in fields(self)))


@dataclass(frozen=True)
class OpenSums:
    """Sums over frames for generalised least squares, which couple the frames: nothing is eliminated yet.

    Weighted, in the reference frame's nodal basis: residual : (n_shared,); columns : (n_shared, n) of the shared
    degrees of freedom; product, noisy : (n_shared, n) the same against the basis, and each frame times its kappa;
    visible, kappa : (n_shared,) as in `SharedSums`. matrix : (n, n), rhs : (n,), noise : (n, n) of the shared degrees
    of freedom alone, channels included; frames : the frame-local unknowns of each.
    """

    residual: np.ndarray
    columns: np.ndarray
    product: np.ndarray
    noisy: np.ndarray
    visible: np.ndarray
    kappa: np.ndarray
    matrix: np.ndarray
    rhs: np.ndarray
    noise: np.ndarray
    frames: tuple[LocalEquations, ...]

    def __add__(self, summand: OpenSums) -> OpenSums:
        return OpenSums(*(getattr(self, f.name) + getattr(summand, f.name) for f in fields(self)))


@dataclass(frozen=True)
class LocalEquations:
    """The k frame-local unknowns of one frame (motion, then brightness) before they are eliminated; weighted.

    matrix : (k, k), cross : (k, n) with the shared degrees of freedom, rhs : (k,), channels and priors included;
    readings : (n_channels, k), shared_readings : (n_channels, n) derivatives of the simulated channels;
    noise, noise_cross : (k, k), (k, n) covariance of right-hand sides by the noise of the frame itself;
    columns, product : (n_shared, k) as in `OpenSums`; kappa : (n_shared,) of the frame.
    """

    matrix: np.ndarray
    cross: np.ndarray
    rhs: np.ndarray
    noise: np.ndarray
    noise_cross: np.ndarray
    columns: np.ndarray
    product: np.ndarray
    kappa: np.ndarray
    readings: np.ndarray
    shared_readings: np.ndarray


@dataclass(frozen=True)
class FrameRecord:
    """What is kept of one frame; with several cameras the sum over them, in the noise of the main camera."""

    frame: int
    n_pixels: int
    n_lost: int
    rr: float  # sum of squared residuals after brightness and local unknowns, GV²
    channel_residual: np.ndarray  # (n_channels,)
    local_step: np.ndarray  # (m,) change of the local unknowns where the global ones stay
    local_slope: np.ndarray  # (m, n) d local / d global along the minimum
    brightness: np.ndarray  # (nb,) gain and offset per patch, camera after camera
    cameras: np.ndarray  # (n_cameras, 4) of each: pixels, lost ones, squared residuals in its own GV², len(brightness)
    channel_columns: np.ndarray  # (n_channels, n) derivative of the simulated values, local unknowns eliminated
    n_fitted: float = 0.0  # rows that the unknowns of the frame fit, of measured fields: they leave no residual
    # (n_channels,) share of an error of a reading that its residual keeps, the local unknowns of the frame alone take
    # the rest; (0,): all
    channel_kept: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def brightness_of(self, number: int) -> np.ndarray:
        """Gain and offset per patch of one camera  # (nb,)"""
        ends = np.cumsum(self.cameras[:, 3]).astype(int)
        return self.brightness[ends[number] - int(self.cameras[number, 3]):ends[number]]


@dataclass(frozen=True)
class CorrelationSystem:
    """Normal equations of any number of frames; `reduce_systems` adds them in the order given.

    M : (n, n); b : (n,); phi : weighted functional at the minimum over the local unknowns; spread : (n, n) the part
    of Cov(b) that is independent from frame to frame; shared : (n_shared, n) summed columns that multiply the
    reference image's noise, of one frame perhaps a `ColumnSum`; frames : one record per frame, in frame order; sums :
    what generalised least squares need of all frames before the system is closed
    (`idic.correlation.shared_noise.closed_system`); generalised : whether this is their system; predicted : (n, n)
    otherwise the M that they would have, None where it is not known; end_noise : (n, n) the part of M that noise of
    measured ends makes (`idic.identification.noise.end_noise`), None where it is not known;
    retention : (n_channels, T, T) what the residuals of a channel keep of errors of its readings, where the reference
    couples the frames (docs/method.md, equation 11.8), None: every frame the share of its record.
    """

    names: tuple[str, ...]
    M: np.ndarray
    b: np.ndarray
    phi: float
    phi_image: float
    spread: np.ndarray
    shared: np.ndarray | ColumnSum
    frames: tuple[FrameRecord, ...]
    sums: SharedSums | OpenSums | None = None
    generalised: bool = False
    predicted: np.ndarray | None = None
    end_noise: np.ndarray | None = None
    retention: np.ndarray | None = None

    def restrict(self, names: Sequence[str]) -> CorrelationSystem:
        """The same system with only these degrees of freedom (the others locked)."""
        pick = [self.names.index(name) for name in names]
        grid = np.ix_(pick, pick)
        return replace(self, names=tuple(names), M=self.M[grid], b=self.b[pick], spread=self.spread[grid],
                       shared=dense(self.shared)[:, pick], sums=None,
                       predicted=None if self.predicted is None else self.predicted[grid],
                       end_noise=None if self.end_noise is None else self.end_noise[grid])

    def retention_of(self, channel: int) -> np.ndarray:
        """What the residuals of a channel keep of errors of its readings, frame by frame  # (T, T)"""
        if self.retention is not None:
            return self.retention[channel]
        return np.diag([frame.channel_kept[channel] if len(frame.channel_kept) else 1.0 for frame in self.frames])

    @property
    def n_pixels(self) -> int:
        return sum(record.n_pixels for record in self.frames)

    @property
    def n_lost(self) -> int:
        return sum(record.n_lost for record in self.frames)


def solve_positive(matrix: np.ndarray, rhs: np.ndarray) -> np.ndarray:
    """Solve with a symmetric positive (semi-)definite matrix after scaling its diagonal to one.

    Of unknowns that the data do not tell apart (gain and offset of a patch that a frame shows by a few pixels) the
    shortest solution.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the matrix is not semi-definite, or not finite.
    """
    diagonal = np.diagonal(matrix)
    top = diagonal.max(initial=0.0)
    scale = 1.0 / np.sqrt(np.where(diagonal > 1e-14 * top, diagonal, np.inf))
    scaled = matrix * scale[:, None] * scale[None, :]
    scaled[np.diag_indices_from(scaled)] = 1.0 + 1e-11  # unseen unknowns keep a unit pivot and do not move
    scale = scale.reshape((-1,) + (1,) * (rhs.ndim - 1))
    try:
        factor = cho_factor(scaled, check_finite=False)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(scaled)
        if not values[0] > -MAX_ROUNDING:
            raise
        determined = values > MAX_ROUNDING
        return vectors[:, determined] @ ((vectors[:, determined].T @ (rhs * scale)).T / values[determined]).T * scale
    return cho_solve(factor, rhs * scale, check_finite=False) * scale


def eliminate(frame: int, names: Sequence[str], equations: FrameEquations, weights: Weights, n_pixels: int,
              n_lost: int) -> CorrelationSystem:
    """One frame's system in the global unknowns, its local and brightness unknowns eliminated.

    docs/method.md, equations 8.1 to 8.5.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the local block is not positive definite (no pixel of the frame is valid).
    """
    n, m = len(names), len(equations.local_gap)
    size = len(equations.rhs)
    image = weights.image * equations.gram
    matrix, columns = _whole(equations, weights, n)
    rhs = weights.image * equations.rhs + columns.T @ (weights.channels * equations.channels.residual)
    rhs[n:n + m] += equations.local_precision @ equations.local_gap

    slope = np.zeros((size - n, n))
    step, redundancy = np.zeros(size - n), np.ones(len(columns))
    if size > n:
        solved = solve_positive(matrix[n:, n:], np.column_stack([matrix[n:, :n], rhs[n:], columns[:, n:].T]))
        slope, step = solved[:, :n], solved[:, n]
        redundancy -= weights.channels * (columns[:, n:] * solved[:, n + 1:].T).sum(axis=1)
    project = np.vstack([np.eye(n), -slope])  # column i of the projected problem

    phi = (weights.image * equations.rr + weights.channels @ equations.channels.residual**2
           + equations.local_gap @ equations.local_precision @ equations.local_gap - rhs[n:] @ step)
    noise_gram = equations.kappa * equations.gram if equations.noise_gram is None else equations.noise_gram
    noise = weights.image_noise**2 * weights.image**2 * noise_gram
    noise = noise + columns.T @ ((weights.channels * weights.channel_noise)[:, None] ** 2 * columns)
    noise[n:n + m, n:n + m] += equations.local_precision if equations.scatter is None else equations.scatter
    full_step = np.concatenate([np.zeros(n), step])
    rr = equations.rr - 2.0 * full_step @ equations.rhs + full_step @ equations.gram @ full_step
    rr = float(max(rr, 0.0))
    record = FrameRecord(frame, n_pixels, n_lost, rr, equations.channels.residual - columns @ full_step,
                         step[:m].copy(), -slope[:m].copy(), step[m:].copy(),
                         np.array([[n_pixels, n_lost, rr, size - n - m]]), columns @ project,
                         float(np.trace(solve_positive(matrix[n:, n:], image[n:, n:]))) if equations.few and size > n
                         else 0.0, redundancy)
    sums = None
    if equations.basis is not None and weights.generalised:
        sums = _open_sums(equations, weights.image, matrix, rhs, noise, columns, full_step)
    elif equations.basis is not None:
        sums = _shared_sums(equations, weights, image, project, full_step)
    return CorrelationSystem(
        names=tuple(names), M=project.T @ matrix @ project, b=rhs[:n] - slope.T @ rhs[n:], phi=float(phi),
        phi_image=weights.image * rr, spread=project.T @ noise @ project,
        shared=_shared_columns(equations, weights.image, slope), frames=(record,), sums=sums)


def _whole(equations: FrameEquations, weights: Weights, n: int) -> tuple[np.ndarray, np.ndarray]:
    """The matrix of all unknowns of a frame, n shared ones first, and the derivatives of its channels by them"""
    m, size = len(equations.local_gap), len(equations.rhs)
    columns = np.zeros((len(equations.channels.residual), size))
    columns[:, :n] = equations.channels.d_global
    columns[:, n:n + m] = equations.channels.d_local
    prior = np.zeros((size, size))
    prior[n:n + m, n:n + m] = equations.local_precision
    return weights.image * equations.gram + columns.T @ (weights.channels[:, None] * columns) + prior, columns


def local_covariance(equations: FrameEquations, weights: Weights, n: int) -> np.ndarray:
    """Covariance of the frame-local unknowns of a frame by its noise and that of the reference, weighted by both.

    n : number of shared unknowns; the smoothness of measured edges is no noise

    Returns
    -------
    (m + nb, m + nb)
    """
    m = len(equations.local_gap)
    A = _whole(equations, weights, n)[0][n:, n:]
    noise = A.copy()
    if equations.scatter is not None:
        noise[:m, :m] -= equations.local_precision - equations.scatter
    half = solve_positive(A, noise)
    return solve_positive(A, half.T)


def _shared_columns(equations: FrameEquations, weight: float, slope: np.ndarray) -> np.ndarray | ColumnSum:
    """Weighted sum of the columns, the local unknowns eliminated  # slope (m + nb, n) -> (n_shared, n)"""
    columns, n = equations.shared, slope.shape[1]
    if isinstance(columns, SeenColumns):
        projected = columns.projected(slope)
        return projected.mapped(lambda part: weight * part) if isinstance(projected, ColumnSum) else weight * projected
    return weight * (columns @ np.vstack([np.eye(n), -slope]))


def _shared_sums(equations: FrameEquations, weights: Weights, image: np.ndarray, project: np.ndarray,
                 step: np.ndarray) -> SharedSums:
    """image : (k, k) weighted Gram matrix of the pixels; step : (k,) of the frame-local unknowns."""
    basis, w = equations.basis, weights.image
    product = w * (basis.product @ project)
    return SharedSums(w * (basis.rhs - basis.product @ step), product, basis.kappa[:, None] * product, basis.visible,
                      basis.kappa * basis.visible, project.T @ image @ project)


def _open_sums(equations: FrameEquations, weight: float, matrix: np.ndarray, rhs: np.ndarray, noise: np.ndarray,
               readings: np.ndarray, step: np.ndarray) -> OpenSums:
    """matrix, rhs, noise : of all unknowns of the frame, the n shared ones first; weighted. readings : derivatives of
    its channels. step : the unknowns' step in this frame alone, which is taken first: an offset of many standard
    deviations then leaves noise only, and the basis, an approximation where the strain is large, does not carry it."""
    basis, rhs, n = equations.basis, rhs - matrix @ step, equations.channels.d_global.shape[1]
    assert isinstance(equations.shared, np.ndarray)  # as wherever there is a basis
    columns, product = weight * equations.shared, weight * basis.product
    of_frame = (matrix[n:, n:], matrix[n:, :n], rhs[n:], noise[n:, n:], noise[n:, :n], columns[:, n:], product[:, n:],
                basis.kappa, readings[:, n:], readings[:, :n])
    local = LocalEquations(*(part.copy() for part in of_frame))  # a view would keep all columns of every frame
    return OpenSums(weight * basis.rhs - product @ step, columns[:, :n], product[:, :n],
                    basis.kappa[:, None] * product[:, :n], basis.visible, basis.kappa * basis.visible, matrix[:n, :n],
                    rhs[:n], noise[:n, :n], (local,))


def reduce_systems(systems: Iterable[CorrelationSystem]) -> CorrelationSystem:
    """Sum in the order given: the same bits however the parts were computed. Of an iterator no two are held at once."""
    stream = iter(systems)
    first = next(stream)
    M, b, spread = first.M.copy(), first.b.copy(), first.spread.copy()
    shared = first.shared.copy() if isinstance(first.shared, np.ndarray) else first.shared
    phi, phi_image, frames, sums = first.phi, first.phi_image, list(first.frames), first.sums
    for system in stream:
        M += system.M
        b += system.b
        spread += system.spread
        shared = added(shared, system.shared)
        phi += system.phi
        phi_image += system.phi_image
        frames.extend(system.frames)
        sums = None if sums is None or system.sums is None else sums + system.sums
    return CorrelationSystem(first.names, M, b, phi, phi_image, spread, dense(shared), tuple(frames), sums)
