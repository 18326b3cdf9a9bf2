"""Which elements push: derivative of the misfit by the stiffness of every element, by adjoints.

With p_t the weighted residual of frame t brought back from the white frames (identified parameters and the frame's own
unknowns projected out), and f_e the internal forces of element e,

    lambda_t = K_t^-T (C^T p_t + K_t^T R p_F),    score_e,w = sum_(t in w) (R p_F - lambda_t) . f_e(u_t)

over windows w of frames, so that what begins late or turns its sign is not averaged away. It is the normalised
topological derivative: it points at sources in the bulk, where a map of displacements shows their far field. Divided by
its standard deviation from draws of noise that went the same way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.linalg import cholesky_banded
from scipy.linalg.lapack import dtbtrs
from scipy.sparse import csr_array, dia_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from idic.diagnose.locate.tangents import ModelTangent, tangents
from idic.diagnose.residual.evidence import Evidence, FrameEvidence, inverse_at_nodes
from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.diagnose.residual.score import NullModel, symmetric_inverse
from idic.identification import Identification

N_WINDOWS = 6
MAX_ELEMENT_P = 0.01  # family-wise, for an element to be named
DIAGONAL_SHIFT = 1e-5  # of the largest diagonal: pixel sums are single precision, and some nodes see a pixel or two
MAX_COVARIANCE_DIFFERENCE = 0.05  # of the largest entry: draws of noise need their covariance to a few per cent
MIN_WINDOW_Z2 = 16.0  # z² of an element that shows in one window: four standard deviations
MIN_SOURCE_SHARE = 0.35  # of the largest statistic, 0.6 of the largest derivative: elements of the source


@dataclass(frozen=True, eq=False)
class SourceMap:
    """Element scores in standard deviations.

    z : (n_elements, n_windows); windows : frames of each; p : (n_elements,) family-wise; draws : (D, n_elements,
    n_windows) of noise alone, in standard deviations.
    """

    z: np.ndarray
    windows: tuple[np.ndarray, ...]
    p: np.ndarray
    draws: np.ndarray

    @property
    def statistic(self) -> np.ndarray:
        """Sum of z² over the windows: chi-square under noise  # (n_elements,)"""
        return (self.z**2).sum(axis=1)

    @property
    def same_sign(self) -> np.ndarray:
        """Elements that push as the strongest one does; the others give way to it  # (n_elements,) bool"""
        return self.z @ self.z[int(np.argmax(self.statistic))] > 0.0


    def first_frames(self, frames: np.ndarray, onset_frame: int | None) -> np.ndarray:
        """First frame of the first window, not before the onset, in which an element shows  # (n_elements,), NaN: never

        frames : (T,) frame numbers of the evidence
        """
        onset = frames[0] if onset_frame is None else onset_frame
        late = np.array([frames[window[-1]] >= onset for window in self.windows])
        first = np.array([max(frames[window[0]], onset) for window in self.windows], dtype=float)
        shows = (self.z**2 > MIN_WINDOW_Z2) & late
        return np.where(shows.any(axis=1) & (self.p < MAX_ELEMENT_P), first[np.argmax(shows, axis=1)], np.nan)


def adjoint_source_map(identification: Identification, residual: ResidualEvidence, null: NullModel,
                       rng: np.random.Generator,
                       draws: int = 40, sound_frames: tuple[int, np.ndarray] | None = None) -> SourceMap:
    """Score every element.

    Parameters
    ----------
    sound_frames : frames (n of the first) on which the model still holds and the step of the parameters that these ask
        for; None: all frames. What comes later then bends no parameter, and no element has to make up for it.

    Raises
    ------
    NotConverged
        If a law finds no answer along the path of the identified model.
    """
    evidence = residual.evidence
    q, channel_q = residuals_with_draws(evidence, null, rng, draws, sound_frames)
    p = recorded_residual(evidence, q)
    windows = tuple(np.array_split(np.arange(len(p)), min(N_WINDOWS, len(p))))
    score = np.zeros((identification.experiment.model.mesh.n_elements, len(windows), draws + 1))
    window_of = np.repeat(np.arange(len(windows)), [len(w) for w in windows])
    for tangent in tangents(identification, residual):
        t = tangent.index
        score[:, window_of[t]] += element_scores(residual, tangent, p[t], channel_q[t])
    std = np.sqrt(np.mean(score[:, :, 1:] ** 2, axis=2))
    is_seen = std > 1e-9 * max(std.max(initial=0.0), 1e-300)
    scale = np.where(is_seen, 1.0 / np.where(is_seen, std, 1.0), 0.0)
    z, noise = score[:, :, 0] * scale, np.moveaxis(score[:, :, 1:] * scale[:, :, None], 2, 0)
    return SourceMap(z, windows, familywise(z, noise), noise)


def element_scores(residual: ResidualEvidence, tangent: ModelTangent, p: np.ndarray,
                   channel_p: np.ndarray) -> np.ndarray:
    """Derivative of the misfit by a relative change of the stress of every element  # (n_elements, m)

    p, channel_p : as of `adjoint_motion`
    """
    return tangent.element_work(-adjoint_motion(residual, tangent, p, channel_p))


def adjoint_motion(residual: ResidualEvidence, tangent: ModelTangent, p: np.ndarray,
                   channel_p: np.ndarray) -> np.ndarray:
    """Motion whose work on a change of the internal forces is the derivative of the misfit by it  # (n_dof, m)

    p : (n_seen, m) weighted residual of one frame; channel_p : (n_channels, m)
    """
    load = image_adjoint(residual, tangent.index, p)
    readings = np.zeros_like(load)
    for channel, row in zip(tangent.system.body.channels, channel_p, strict=True):
        readings[np.asarray(channel.dofs, dtype=np.int64)] += channel.factor * row
    load = load + tangent.times(readings, transposed=True)
    if tangent.readings is not None:  # an extensometer moves with its nodes
        load = load + tangent.readings.motion.T @ channel_p
    return tangent.adjoint(load) - readings


def image_adjoint(residual: ResidualEvidence, index: int, p: np.ndarray) -> np.ndarray:
    """From the dofs of the image to those of the body: transpose of `View.columns`  # (n_seen, m) -> (n_dof, m)"""
    evidence, frame = residual.evidence, int(residual.evidence.frames[index])
    n_nodes, dim = residual.context.experiment.model.mesh.nodes.shape
    units = np.tile(np.eye(dim), (n_nodes, 1, 1))  # a unit of each component at every node
    c, total = evidence.n_components, np.zeros((n_nodes, dim, p.shape[1]))
    image_loads = np.zeros((len(residual.cameras) * n_nodes * c, p.shape[1]))
    image_loads[evidence.seen] = p
    for camera, camera_loads in zip(residual.cameras, np.split(image_loads, len(residual.cameras)), strict=True):
        nodes, u = camera.context.experiment.model.mesh.nodes, camera.turned(residual.u[index])
        local = camera.view.at(frame).columns(nodes, u, camera.turned(units)).reshape(n_nodes, c, dim)
        total = total + np.einsum("ncd,ncm->ndm", local, camera_loads.reshape(n_nodes, c, -1))
    return total.reshape(-1, p.shape[1])


def recorded_residual(evidence: Evidence, q: np.ndarray) -> np.ndarray:
    """Transpose of whitening: the weights of a change of one recorded frame  # (T, n_seen, m) -> the same"""
    n, c = evidence.back.shape[1], evidence.n_components
    kappa, dofs = evidence.kappa, evidence.seen
    shared = np.zeros((n, c, q.shape[2]))
    nodal = np.zeros((n * c, q.shape[2]))
    for t, back in enumerate(evidence.back):
        nodal[dofs] = q[t]
        shared += np.einsum("nji,njm->nim", inverse_at_nodes(back), nodal.reshape(n, c, -1)) / np.sqrt(kappa[t])
    out = np.empty_like(q)
    for t, back in enumerate(evidence.back):
        carried = np.einsum("nji,njm->nim", back, shared).reshape(n * c, -1)[dofs]
        out[t] = q[t] / np.sqrt(kappa[t]) - evidence.share / kappa[t] * carried
    return out


def residuals_with_draws(evidence: Evidence, null: NullModel, rng: np.random.Generator, draws: int,
                         sound_frames: tuple[int, np.ndarray] | None = None) -> tuple[np.ndarray, np.ndarray]:
    """The recording's residual first, then draws, all projected  # (T, n_seen, 1 + D), (T, n_channels, 1 + D)"""
    q, channel_q, factor = [], [], None
    total = np.zeros((null.white.n, draws + 1))
    for t, part in enumerate(evidence.parts):
        images, channels = evidence.residual(part)
        if factor is None or not factor.serves(part.A):
            factor = BandFactor(part.A)
        noise = draw_residual(evidence, part, rng, draws, factor)
        n = len(images)
        q.append(np.column_stack([images, noise[:n]]))
        channel_q.append(np.column_stack([channels, noise[n:]]))
        if sound_frames is None or t < sound_frames[0]:
            total += null.white.fields[t].T @ q[t] + null.white.channels[t].T @ channel_q[t]
    step = (null.covariance if sound_frames is None else _covariance(null, sound_frames[0])) @ total
    step[:, 0] = null.remaining if sound_frames is None else sound_frames[1]  # priors included
    for t in range(len(q)):
        q[t] -= null.weighed.fields[t] @ step
        channel_q[t] -= null.weighed.channels[t] @ step
    return np.array(q), np.array(channel_q)


def _covariance(null: NullModel, n: int) -> np.ndarray:
    """Of the identified parameters from the first n frames."""
    gram = sum(null.white.fields[t].T @ null.weighed.fields[t] + null.white.channels[t].T @ null.weighed.channels[t]
               for t in range(n))
    return symmetric_inverse(gram + null.precision)


def draw_residual(evidence: Evidence, part: FrameEvidence, rng: np.random.Generator, draws: int,
                  factor: BandFactor | None = None) -> np.ndarray:
    """Noise of one frame's projected residual, N(0, A - B P B^T), channels last  # (n_seen + n_channels, D)

    With A = L L^T and the thin decomposition L^-1 B P^1/2 = Q s R^T it is L (I - Q (1 - (1 - s^2)^1/2) Q^T) of unit
    noise. factor : of A, or of the A of a frame that hardly differs.
    """
    n, weight = len(part.q), evidence.channel_weight
    factor = BandFactor(part.A) if factor is None else factor
    values, vectors = np.linalg.eigh(part.inner)
    lowered = part.border @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    root = np.sqrt(weight)[:, None]
    unit = np.vstack([factor.solve(lowered[:n]), np.divide(lowered[n:], root, out=np.zeros_like(lowered[n:]),
                                                           where=root > 0.0)])
    Q, s, _ = np.linalg.svd(unit, full_matrices=False)
    noise = rng.standard_normal((len(unit), draws))
    noise -= Q @ ((1.0 - np.sqrt(np.clip(1.0 - s**2, 0.0, 1.0)))[:, None] * (Q.T @ noise))
    return np.vstack([factor.times(noise[:n]), root * noise[n:]])


class BandFactor:
    """Cholesky factor of a sparse positive (semi-)definite matrix, numbered for a narrow band."""

    def __init__(self, matrix):
        matrix = csr_array(matrix)
        self.matrix = matrix
        self.order = np.asarray(reverse_cuthill_mckee(matrix, symmetric_mode=True), dtype=np.int64)
        entries = matrix[self.order][:, self.order].tocoo()
        lower = entries.row >= entries.col
        rows, columns, values = entries.row[lower], entries.col[lower], entries.data[lower]
        band = np.zeros((int((rows - columns).max(initial=0)) + 1, matrix.shape[0]))
        band[rows - columns, columns] = values
        band[0] += DIAGONAL_SHIFT * band[0].max(initial=0.0)
        self.band = cholesky_banded(band, lower=True, check_finite=False)
        n = matrix.shape[0]
        self.lower = dia_array((self.band, -np.arange(len(self.band))), shape=(n, n)).tocsr()

    def serves(self, matrix) -> bool:
        """Whether noise drawn with this factor has the covariance `matrix` to within `ALIKE`."""
        matrix, factored = csr_array(matrix), self.matrix
        if matrix.nnz != factored.nnz or not np.array_equal(matrix.indices, factored.indices):
            return False
        difference, largest = np.abs(matrix.data - factored.data).max(), np.abs(factored.data).max()
        return bool(difference <= MAX_COVARIANCE_DIFFERENCE * largest)

    def times(self, unit: np.ndarray) -> np.ndarray:
        """L unit, in the matrix's own numbering."""
        out = np.empty_like(unit)
        out[self.order] = self.lower @ unit
        return out

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """L^-1 rhs."""
        if not rhs.shape[1]:  # LAPACK writes where nothing is
            return rhs
        return dtbtrs(self.band, rhs[self.order], uplo="L")[0]


def familywise(z: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Family-wise p of every element's sum of squares; the number of independent elements from the draws' maxima."""
    tail = stats.chi2(z.shape[1])
    highest = (noise**2).sum(axis=2).max(axis=1)
    tests = 1.0 / max(float(np.mean(tail.sf(highest))) , 1e-6) - 1.0  # the least of m uniforms is 1/(m + 1) on average
    return np.minimum(1.0, max(tests, 1.0) * tail.sf((z**2).sum(axis=1)))
