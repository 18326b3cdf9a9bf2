"""The motion in space of a surface that cameras with a lens see, frame by frame, and what noise alone makes of it.

Free stereo FE-DIC (`idic.measure.dic.stereo`), started from the simulated motion. Its noise are draws of what the noise
of the images leaves: with the information A of the images and the regularisation P, (A + P)^-1 q with Cov q = A.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from idic.correlation import CorrelationContext
from idic.images import PlacedCamera
from idic.measure.dic.stereo import Eye, eye_of, information_of, measured_frame, smoother_of_eyes
from idic.measure.dic.surface_smoothing import SurfaceSmoother
from idic.measure.fields.free import N_NOISE_SAMPLES

MAX_SURFACE_NODES = 20_000  # three unknowns each: 60 000, half of those of the largest free FE-DIC of one camera
_LEAST_SHARE = 1e-10  # of the largest diagonal entry, added to all: a node that no image shows has none
_SEED = 31


@dataclass(frozen=True)
class SeenInSpace:
    """Two or more cameras of a surface, and the smoothness that is assumed of its motion."""

    eyes: tuple[Eye, ...]
    smoother: SurfaceSmoother

    @classmethod
    def of(cls, cameras: Sequence[CorrelationContext]) -> SeenInSpace | None:
        """The cameras with a lens of a point that see one side of the surface at the times of the main camera; None
        where there are fewer than two of them, or the surface is too large for a report."""
        eyes = tuple(eye_of(context.experiment, context.camera, context.reference) for context in cameras
                     if isinstance(context.camera, PlacedCamera) and _sees_as_main(context))
        if len(eyes) < 2:
            return None
        smoother = smoother_of_eyes(eyes)
        return cls(eyes, smoother) if len(smoother.nodes) <= MAX_SURFACE_NODES else None

    @property
    def n_nodes(self) -> int:
        """Nodes of the mesh."""
        return int(self.eyes[0].experiment.model.mesh.n_nodes)

    def motion(self, frames: Sequence[int], simulated: Callable[[int], np.ndarray]) -> np.ndarray:
        """The free motion in some frames, NaN where it is lost or a node is not seen  # (n_frames, n_nodes, 3) mm

        simulated : frame -> (n_nodes, 3) mm, to start from
        """
        motion, nodes = np.full((len(frames), self.n_nodes, 3), np.nan), self.smoother.nodes
        for k, frame in enumerate(frames):
            if frame == self.eyes[0].experiment.model.reference:
                motion[k, nodes] = 0.0
                continue
            u, _, _, has_converged = measured_frame(self.eyes, frame, simulated(frame), self.smoother)
            if has_converged:
                motion[k, nodes] = u[nodes]
        return motion

    def noise_samples(self, n: int = N_NOISE_SAMPLES) -> np.ndarray:
        """Motion that noise alone causes, as often; NaN at nodes that are not seen  # (n, n_nodes, 3) mm"""
        still = np.zeros((self.n_nodes, 3))
        information, _, _ = information_of(self.eyes, self.eyes[0].experiment.model.reference, still, self.smoother)
        solver = splu(sparse.csc_matrix(information + self.smoother.penalty(information)))
        scores = _draws(information, n, np.random.default_rng(_SEED))
        samples = np.full((n, self.n_nodes, 3), np.nan)
        samples[:, self.smoother.nodes] = solver.solve(scores).T.reshape(n, -1, 3)
        return samples


def _sees_as_main(context: CorrelationContext) -> bool:
    """Whether a camera shows the same surface in the same axes at the same times as the main one."""
    model = context.experiment.model
    return not (model.axis_order or model.sees_back or context.experiment.time_offset in context.parameters)


def _draws(information: sparse.csc_array, n: int, rng: np.random.Generator) -> np.ndarray:
    """Vectors whose covariance is the information  # (size, n)

    The factors of a symmetric matrix without pivoting are L and D L^T; L sqrt(D) z has its covariance.
    """
    diagonal = information.diagonal()
    floor = _LEAST_SHARE * float(diagonal.max()) * sparse.eye_array(len(diagonal))
    factor = splu(sparse.csc_matrix(information + floor), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
                  options={"SymmetricMode": True})
    root = np.sqrt(np.maximum(factor.U.diagonal(), 0.0))[:, None]
    return (factor.L @ (root * rng.standard_normal((len(diagonal), n))))[factor.perm_r]
