"""Free motion of every frame with its noise: the estimate of the recording and draws of noise alone.

In a white frame the freed fields P see rhs = P^T b with covariance M = P^T A P; the identified parameters take their
share b_J of the same noise, so that P^T b and b_J are drawn together. Nothing but small matrices is needed: no image,
no simulation. From white frames back to the frames of the recording, with white = D raw, D = diag(kappa)^-1/2 (1 - c
1 kappa^-T):

    a_t = sqrt(kappa_t) w_t + c sqrt(1 + k/N) sum_s w_s / sqrt(kappa_s)

so that what begins late does not show early; the shared noise of the reference image is in every a_t.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from idic.diagnose.locate.nested_tests import Normal, normal
from idic.diagnose.residual.evidence import Evidence, inverse_at_nodes
from idic.diagnose.residual.score import NullModel
from idic.diagnose.residual.subspace import Basis

RIDGE_SHARE = 1e-3  # of the mean information of a field: keeps hardly visible fields from growing


@dataclass(frozen=True, eq=False)
class FreeMotion:
    """Amplitudes of freed fields in the recording's frames.

    a : (T, p); draws : (D, T, p) of noise alone; resolution : (T, p) share of each amplitude that the test can see
    of it that is not collinear with the identified parameters, 0 = blind; white : the normal equations.
    """

    a: np.ndarray
    draws: np.ndarray
    resolution: np.ndarray
    white: tuple[Normal, ...]

    @property
    def std(self) -> np.ndarray:
        """Standard deviation of the amplitudes  # (T, p)"""
        return np.sqrt(np.mean(self.draws**2, axis=0))

    @property
    def z(self) -> np.ndarray:
        return standardised(self.a, self.std)


def standardised(values: np.ndarray, std: np.ndarray) -> np.ndarray:
    """Values over standard deviations, zero where nothing is seen."""
    return np.divide(values, std, out=np.zeros(np.broadcast_shapes(values.shape, std.shape)), where=std > 0.0)


def free_motion(evidence: Evidence, null: NullModel, basis: Basis, rng: np.random.Generator,
                draws: int = 300) -> FreeMotion:
    """Estimate the amplitudes of a basis in every frame, identified parameters projected out, and draw their noise."""
    normals = tuple(normal(evidence, part, convected(evidence, basis.fields, t), null, t)
                    for t, part in enumerate(evidence.parts))
    shares = [null.white.fields[t].T @ null.weighed.fields[t] + null.white.channels[t].T @ null.weighed.channels[t]
              for t in range(len(normals))]
    rhs, absorbed = [], np.zeros((draws, null.white.n))
    for equations, share in zip(normals, shares, strict=True):
        y, j = _joint_draws(equations, share, rng, draws)
        rhs.append(y)
        absorbed += j
    step, noise_step = null.covariance @ null.b, absorbed @ null.covariance
    w = np.empty((len(normals), basis.n))
    noise = np.empty((draws, len(normals), basis.n), dtype=np.float32)
    resolution = np.empty_like(w)
    for t, equations in enumerate(normals):
        inverse = damped_inverse(equations.matrix)
        w[t] = inverse @ (equations.rhs - equations.cross @ step)
        noise[:, t] = (rhs[t] - noise_step @ equations.cross.T) @ inverse
        information = equations.matrix - equations.cross @ null.covariance @ equations.cross.T
        resolution[t] = np.clip(np.einsum("ij,ji->i", inverse, information), 0.0, 1.0)
    return FreeMotion(recorded_frames(evidence, w[None])[0], recorded_frames(evidence, noise), resolution, normals)


def _joint_draws(equations: Normal, share: np.ndarray, rng: np.random.Generator, draws: int):
    """Noise of the freed fields and of the identified columns in one frame  # (D, p), (D, n)"""
    gram = np.block([[equations.matrix, equations.cross], [equations.cross.T, share]])
    scale = np.sqrt(np.maximum(np.diagonal(gram), 1e-300))
    values, vectors = np.linalg.eigh(gram / np.outer(scale, scale))
    root = scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    drawn = rng.standard_normal((draws, len(values))) @ root.T
    return drawn[:, :len(equations.rhs)], drawn[:, len(equations.rhs):]


def damped_inverse(matrix: np.ndarray) -> np.ndarray:
    diagonal = np.diagonal(matrix)
    return np.linalg.inv(matrix + RIDGE_SHARE * max(diagonal.mean(), 1e-300) * np.eye(len(matrix)))


def recorded_frames(evidence: Evidence, white: np.ndarray) -> np.ndarray:
    """From amplitudes of white frames to those of recorded ones  # (D, T, p)"""
    root = np.sqrt(evidence.kappa).astype(white.dtype)
    shared = np.einsum("dtp,t->dp", white, (1.0 / root).astype(white.dtype))
    return white * root[None, :, None] + white.dtype.type(evidence.share_back) * shared[:, None]


def convected(evidence: Evidence, fields: sparse.csr_array, t: int) -> sparse.csr_array:
    """Fields of the reference image as motions of frame t: back^-1 at every node."""
    c, dofs = evidence.n_components, evidence.seen
    forth = inverse_at_nodes(evidence.back[t])
    n = len(forth)
    rows = np.repeat(np.arange(c * n).reshape(n, c, 1), c, axis=2)
    columns = np.repeat(np.arange(c * n).reshape(n, 1, c), c, axis=1)
    transform = sparse.csr_array((forth.ravel(), (rows.ravel(), columns.ravel())), shape=(c * n, c * n))
    return sparse.csr_array(transform[dofs][:, dofs] @ fields)

