"""Gauss and Newton's step for unknowns by the hundred, from products with the derivatives alone.

    (I + S^T J^T W J S) x = S^T J^T W r - x_0,      unknowns S x, prior covariance S S^T

Lanczos's vectors span the same space as conjugate gradients from the right-hand side (Golub and Van Loan, Matrix
Computations, 4th ed., section 11.3), so the steps are the same. They also hold the covariance: along what they do not
reach the test tells nothing, and the prior stays.

W is that of docs/method.md, section 3: the images of a frame enter by nodal sums, its brightness eliminated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eigh_tridiagonal
from scipy.sparse import block_array, coo_array, csr_array

from idic.correlation import CorrelationContext, FrameResponse, channel_equations, view_of

TOLERANCE = 1e-3  # residual of a step over its right-hand side; the next step corrects it
MAX_INFORMATION_LEFT = 0.5  # of the prior: what the test tells along the last vectors of a covariance
MAX_ITERATIONS = 150  # of a product each: a few per cent of a simulation
MIN_GROWTH = 1e-12  # of a new Lanczos vector over its image: the space is exhausted


@dataclass(frozen=True, eq=False)
class LanczosStep:
    """A solution of (I + H) x = rhs, H symmetric and positive.

    x (n,); vectors (n, k) orthonormal; tridiagonal : diagonal (k,) and the one beside it (k - 1,) of H among them;
    error : residual over right-hand side
    """

    x: np.ndarray
    vectors: np.ndarray
    tridiagonal: tuple[np.ndarray, np.ndarray]
    error: float


def lanczos_step(product: Callable[[np.ndarray], np.ndarray], rhs: np.ndarray, complete: bool = False) -> LanczosStep:
    """The step, to within `TOLERANCE`.

    product : H times a vector (n,); complete : go on until the vectors hold what H tells beyond the prior
    """
    size = float(np.linalg.norm(rhs))
    if size == 0.0:
        return LanczosStep(np.zeros_like(rhs), np.zeros((len(rhs), 0)), (np.zeros(0), np.zeros(0)), 0.0)
    vectors, diagonal, off_diagonal = [rhs / size], [], []
    while True:
        image = product(vectors[-1])
        diagonal.append(float(image @ vectors[-1]))
        basis, scale = np.array(vectors).T, np.linalg.norm(image)
        for _ in range(2):  # rounding spoils the first pass
            image = image - basis @ (basis.T @ image)
        growth = float(np.linalg.norm(image))
        values, turns = eigh_tridiagonal(np.array(diagonal), np.array(off_diagonal))
        coefficients = turns @ (size * turns[0] / (1.0 + values))
        error = growth * abs(float(coefficients[-1])) / size
        is_little = diagonal[-1] + growth + (off_diagonal[-1] if off_diagonal else 0.0) <= MAX_INFORMATION_LEFT
        if ((error <= TOLERANCE and (is_little or not complete)) or growth <= MIN_GROWTH * scale
                or len(diagonal) == min(MAX_ITERATIONS, len(rhs))):
            return LanczosStep(basis @ coefficients, basis, (np.array(diagonal), np.array(off_diagonal)), error)
        off_diagonal.append(growth)
        vectors.append(image / growth)


@dataclass(frozen=True, eq=False)
class MotionEquations:
    """What a frame says of a motion of the nodes and of its channels.

    matrix : csr (n_dof, n_dof) weighted sums of the images; coupling (n_dof, q), elimination (q, q) : what the
    brightness takes from them; pull (n_dof,) the right-hand side
    channel_slopes, channel_weights, channel_residual : (n_channels,)
    phi : weighted sum of squares
    """

    matrix: csr_array
    coupling: csr_array
    elimination: np.ndarray
    pull: np.ndarray
    channel_slopes: np.ndarray
    channel_weights: np.ndarray
    channel_residual: np.ndarray
    phi: float

    def of_images(self, u: np.ndarray) -> np.ndarray:
        """The weighted sums of a motion  # (n_dof, ...) -> (n_dof, ...)"""
        return self.matrix @ u - self.coupling @ (self.elimination @ (self.coupling.T @ u))

    def of_channels(self, changes: np.ndarray) -> np.ndarray:
        """The same of changes of the channels  # (n_channels,) -> (n_channels,)"""
        return self.channel_slopes**2 * self.channel_weights * changes

    @property
    def channel_pull(self) -> np.ndarray:
        return self.channel_slopes * self.channel_weights * self.channel_residual


def motion_equations(context: CorrelationContext, frame: int, u: np.ndarray, u_earlier: np.ndarray,
                     channels: np.ndarray) -> MotionEquations:
    """The equations of a frame under a simulated motion.

    Parameters
    ----------
    context : of all cameras, grey images
    u, u_earlier : (n_nodes, d) mm, of the frame and the one before; channels : (n_channels,) as simulated
    """
    n, d = u.shape
    matrix, coupling, elimination = csr_array((n * d, n * d)), [], []
    pull, phi = np.zeros(n * d), 0.0
    for camera in context.cameras:
        experiment, reference, weight = camera.experiment, camera.reference, camera.weights.image
        at_time = experiment.model.turned(experiment.at_camera_time(camera.parameters, frame, u, u_earlier))
        view = view_of(experiment, camera.camera).at(frame)
        nodes = experiment.model.mesh.nodes
        nodal = reference.compare(experiment, frame, view.motion(nodes, at_time))
        if reference.shows_nothing(nodal):
            continue
        unit = experiment.model.turned(np.tile(np.eye(d), (n, 1, 1)))
        seen_motion = _block_diagonal(view.projected(view.jacobian(nodes, at_time), unit).reshape(n, -1, d))
        brightness = np.linalg.pinv(nodal.bb, hermitian=True) if nodal.n_brightness else np.zeros((0, 0))
        matrix = matrix + weight * (seen_motion.T @ nodal.H @ seen_motion)
        coupling.append(seen_motion.T @ nodal.hb)
        elimination.append(weight * brightness)
        pull += weight * (seen_motion.T @ (nodal.q - nodal.hb @ (brightness @ nodal.rb)))
        phi += weight * float(nodal.rr - nodal.rb @ brightness @ nodal.rb)
    nothing = np.zeros((len(channels), 0))
    response = FrameResponse(frame, u, channels, np.zeros((n, d, 0)), nothing, np.zeros((n, d, 0)),
                             np.eye(len(channels)))
    equations = channel_equations(replace(context, names=(), moving=()), response)
    weights = context.weights.channels[:len(channels)]
    return MotionEquations(
        csr_array(matrix), csr_array(block_array([coupling])) if coupling else csr_array((n * d, 0)),
        _dense_blocks(elimination), pull, np.diag(equations.d_local), weights, equations.residual,
        phi + float((weights * equations.residual**2).sum()))


def _block_diagonal(blocks: np.ndarray) -> csr_array:
    """(n, c, d) -> (n c, n d)"""
    n, c, d = blocks.shape
    row, column = np.arange(n * c).reshape(n, c, 1), np.arange(n * d).reshape(n, 1, d)
    row, column = np.broadcast_arrays(row, column)
    return csr_array(coo_array((blocks.ravel(), (row.ravel(), column.ravel())), shape=(n * c, n * d)))


def _dense_blocks(blocks: Sequence[np.ndarray]) -> np.ndarray:
    total, at = np.zeros((sum(map(len, blocks)),) * 2), 0
    for block in blocks:
        total[at:at + len(block), at:at + len(block)] = block
        at += len(block)
    return total
