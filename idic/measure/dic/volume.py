"""Free FE-DVC: the motion of every node of a solid from its volumes, scan by scan.

    (H + P) du = q - P u,      u <- u + du,      P = w D^T D

with H and q of a scan (`VolumeReference`), gain and offset taken out of q. D u is the equilibrium gap of an elastic
body on the same mesh (rows of K u over the square root of the volume of the node), made zero for every affine motion
also at the surface: of waves of length lambda the part 1/(1 + (l/lambda)^4) passes. A scan begins at the motion of the
scan before; an affine motion on blurred volumes comes first, which reaches several voxels. Source: Rethore, Roux &
Hild 2009, doi:10.3166/ejcm.18.239-257 (equilibrium gap).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, cg

from idic.correlation import NodalEquations, VolumeReference, build_experiment_reference
from idic.fe import Block
from idic.model import Experiment

POISSON_RATIO = 0.3  # of the elastic body; the result hardly depends on it
BLUR_PX = 3.0  # of the volumes that the affine motion is found on
MAX_ITERATIONS = 30
TOLERANCE_PX = 1e-3  # rms step
AFFINE_TOLERANCE_PX, START_TOLERANCE_PX = 0.02, 0.2  # of an affine motion: the result, where the nodes begin
MAX_STEP_PX = 30.0  # rms: no convergence from there
MIN_LENGTH_PX = 24.0
SOLVER_TOLERANCE = 1e-4  # of a step, which the next one corrects
MAX_INNER_FORCE = 1e-10  # of an affine motion over the stiffness of its node: rounding


@dataclass(frozen=True, eq=False)
class VolumeMotionMeasured:
    """What the scans show.

    u_mm : (n_frames, n_nodes, 3) NaN in excluded scans and those that did not converge, 0 in the reference; rms_gv :
    (n_frames,) residual, brightness removed; iterations : (n_frames,)
    """

    u_mm: np.ndarray
    rms_gv: np.ndarray
    iterations: np.ndarray


@dataclass(frozen=True, eq=False)
class SolidSmoother:
    """operator : (3 n_nodes, 3 n_nodes) D in voxels; length_px : l"""

    operator: sparse.csr_array
    length_px: float

    def penalty(self, mean_square_gradient: float) -> sparse.csr_array:
        """w D^T D; mean_square_gradient : of one component over the voxels (GV²/px²)"""
        weight = mean_square_gradient * (self.length_px / (2.0 * np.pi)) ** 4
        return sparse.csr_array(weight * (self.operator.T @ self.operator))


def volume_motion(experiment: Experiment, length_px: float | None = None,
                  progress: Callable[[int, int], None] | None = None,
                  frames: Sequence[int] | None = None) -> VolumeMotionMeasured:
    """Measure the motion of all nodes in the scans; no law and no force is used.

    length_px : of the regularisation; None: twice the distance of the nodes, at least `MIN_LENGTH_PX`; infinite: the
    motion is affine
    frames : scans, each of which begins at the motion of the one before; None: all after the reference

    Raises
    ------
    InputError
        No voxel lies in the mesh.
    """
    model, options = experiment.model, experiment.options
    blurred = replace(experiment, options=replace(options, lowpass_px=max(options.lowpass_px, BLUR_PX)))
    is_affine = length_px is not None and np.isinf(length_px)
    reference = cast(VolumeReference, build_experiment_reference(blurred if is_affine else experiment, model.camera))
    references = [(blurred, reference if is_affine else reference.seen_by(blurred)), (experiment, reference)]
    nodes_px = model.camera.project(model.mesh.nodes)
    smoother = None if is_affine else solid_smoother(nodes_px, model.mesh.blocks, length_px)
    n_frames, shape = model.n_frames, nodes_px.shape
    u_mm, rms, count = np.full((n_frames, *shape), np.nan), np.full(n_frames, np.nan), np.zeros(n_frames, dtype=int)
    u_mm[model.reference], start = 0.0, np.zeros(shape)
    if frames is None:
        frames = [k for k in range(model.reference + 1, n_frames) if k not in experiment.recording.excluded]
    back = np.linalg.inv(model.camera.matrix)
    for n_done, frame in enumerate(frames, 1):
        u, count[frame], converged = _affine(*references[0], frame, start, nodes_px,
                                              AFFINE_TOLERANCE_PX if is_affine else START_TOLERANCE_PX)
        if smoother is not None:
            u, rms[frame], count[frame], converged = _nodal(*references[1], frame, u if converged else start, smoother)
        if converged:
            start, u_mm[frame] = u, u @ back.T
        if progress is not None:
            progress(n_done, len(frames))
    return VolumeMotionMeasured(u_mm, rms, count)


def solid_smoother(nodes_px: np.ndarray, blocks: Sequence[Block], length_px: float | None = None) -> SolidSmoother:
    """The regularisation on the elements of a solid; nodes_px : (n_nodes, 3) column, row, slice"""
    stiffness, volume = _stiffness(nodes_px, blocks)
    distance = np.median(np.concatenate([
        np.linalg.norm(nodes_px[block.connectivity[:, a]] - nodes_px[block.connectivity[:, b]], axis=1)
        for block in blocks for a, b in block.kind.edges]))
    length = max(2.0 * float(distance), MIN_LENGTH_PX) if length_px is None else float(length_px)
    return SolidSmoother(_without_affine(stiffness, nodes_px, volume), length)


def _affine(experiment: Experiment, reference: VolumeReference, frame: int, start: np.ndarray,
            nodes_px: np.ndarray, tolerance_px: float) -> tuple[np.ndarray, int, bool]:
    """The motion (n_nodes, 3) px after an affine one is added that makes the residual of blurred volumes small,
    iterations, whether it stayed within reach."""
    centred = (nodes_px - nodes_px.mean(axis=0)) / np.ptp(nodes_px, axis=0).max()
    fields = np.column_stack([np.ones(len(centred)), centred])  # (n_nodes, 4)
    modes = np.einsum("nk,cd->nckd", fields, np.eye(3)).reshape(3 * len(fields), -1)
    u = start.copy()
    for count in range(1, MAX_ITERATIONS + 1):
        nodal = reference.compare(experiment, frame, u)
        gram = nodal.gram(modes)
        step = np.linalg.lstsq(gram.matrix, gram.rhs, rcond=1e-10)[0][:modes.shape[1]]
        change = (modes @ step).reshape(u.shape)
        size = float(np.sqrt(np.mean(change**2)))
        if not size < MAX_STEP_PX:
            return u, count, False
        u += change
        if size < tolerance_px:
            break
    return u, count, True


def _nodal(experiment: Experiment, reference: VolumeReference, frame: int, start: np.ndarray,
           smoother: SolidSmoother) -> tuple[np.ndarray, float, int, bool]:
    """Motion of all nodes (n_nodes, 3) px, rms residual, iterations, whether it converged."""
    u, penalty, rms = start.copy(), None, np.nan
    for count in range(1, MAX_ITERATIONS + 1):
        nodal = reference.compare(experiment, frame, u)
        if not nodal.n_valid:
            return u, np.nan, count, False
        q, rms = _without_light(nodal)
        if penalty is None:
            penalty = smoother.penalty(_mean_square_gradient(nodal))
        change = _solved(sparse.csr_array(nodal.H + penalty), q - penalty @ u.ravel()).reshape(u.shape)
        step = float(np.sqrt(np.mean(change**2)))
        if not step < MAX_STEP_PX:
            return u, rms, count, False
        u += change
        if step < TOLERANCE_PX:
            return u, rms, count, True
    return u, rms, MAX_ITERATIONS, False


def _without_light(nodal: NodalEquations) -> tuple[np.ndarray, float]:
    """q with gain and offset taken out, and the rms residual."""
    light = np.linalg.pinv(nodal.bb, hermitian=True) @ nodal.rb if nodal.n_brightness else np.zeros(0)
    return nodal.q - nodal.hb @ light, float(np.sqrt(max(nodal.rr - light @ nodal.rb, 0.0) / max(nodal.n_valid, 1)))


def _mean_square_gradient(nodal: NodalEquations) -> float:
    """Of one component, over the voxels: shape functions add up to one."""
    shifts = np.tile(np.eye(3), (nodal.H.shape[0] // 3, 1))
    return float(np.trace(shifts.T @ (nodal.H @ shifts)) / 3.0 / nodal.n_valid)


def _solved(matrix: sparse.csr_array, rhs: np.ndarray) -> np.ndarray:
    """Conjugate gradients, preconditioned by the diagonal; nodes that nothing holds stay where they are."""
    diagonal = matrix.diagonal()
    inverse = np.where(diagonal > 1e-12 * diagonal.max(initial=0.0), 1.0 / np.where(diagonal > 0.0, diagonal, 1.0), 0.0)
    scaling = LinearOperator(matrix.shape, matvec=lambda values: inverse * np.ravel(values))
    return cg(matrix, rhs, rtol=SOLVER_TOLERANCE, maxiter=2000, M=scaling)[0]


def _stiffness(nodes_px: np.ndarray, blocks: Sequence[Block]) -> tuple[sparse.csr_array, np.ndarray]:
    """Elastic stiffness, the mean modulus of longitudinal and transverse waves 1, and the volume of every node."""
    lame, shear = POISSON_RATIO / ((1 + POISSON_RATIO) * (1 - 2 * POISSON_RATIO)), 0.5 / (1 + POISSON_RATIO)
    lame, shear = np.array([lame, shear]) / np.sqrt(shear * (lame + 2 * shear))
    n = len(nodes_px)
    triplets, nodal_volume = [], np.zeros(n)
    for block in blocks:
        xi, w = block.kind.quadrature_rule()
        slopes = block.kind.shape_gradients(xi)
        jacobian = np.einsum("eak,qai->eqki", nodes_px[block.connectivity], slopes)
        volume = np.abs(np.linalg.det(jacobian)) * w
        g = np.einsum("qai,eqik->eqak", slopes, np.linalg.inv(jacobian))
        dot = np.einsum("eq,eqak,eqbk->eab", volume, g, g, optimize=True)
        dyad = np.einsum("eq,eqai,eqbj->eaibj", volume, g, g, optimize=True)
        k = lame * dyad + shear * dyad.transpose(0, 1, 4, 3, 2)
        for c in range(3):
            k[:, :, c, :, c] += shear * dot
        dofs = (3 * block.connectivity[:, :, None] + np.arange(3)).reshape(len(k), -1)
        i, j = np.broadcast_arrays(dofs[:, :, None], dofs[:, None, :])
        triplets.append((k.ravel(), i.ravel(), j.ravel()))
        mass = np.einsum("eq,qa->ea", volume, block.kind.shape_functions(xi) ** 2)
        np.add.at(nodal_volume, block.connectivity,
                  mass / mass.sum(axis=1, keepdims=True) * volume.sum(axis=1)[:, None])
    values, rows, columns = (np.concatenate(part) for part in zip(*triplets, strict=True))
    return sparse.coo_array((values, (rows, columns)), shape=(3 * n, 3 * n)).tocsr(), nodal_volume  # zeros are kept


def _without_affine(stiffness: sparse.csr_array, x: np.ndarray, volume: np.ndarray) -> sparse.csr_array:
    """Rows over the square root of the nodal volume, zero for every affine motion by the smallest change of their
    coefficients: inside they are so already."""
    stiffness = sparse.csr_array(stiffness)
    stiffness.sort_indices()
    roots = np.sqrt(np.repeat(volume, 3))
    data = np.divide(stiffness.data, np.repeat(roots, np.diff(stiffness.indptr)), out=np.zeros_like(stiffness.data),
                     where=np.repeat(roots > 0, np.diff(stiffness.indptr)))
    offsets = x - x.mean(axis=0)
    fields = np.column_stack([np.ones(len(x)), offsets / max(np.abs(offsets).max(), 1e-300)])
    modes = np.einsum("nk,cd->nckd", fields, np.eye(3)).reshape(3 * len(x), -1)
    forces = np.abs(stiffness @ modes).max(axis=1).reshape(-1, 3).max(axis=1)  # of affine motions on each node
    on_surface = forces > MAX_INNER_FORCE * np.abs(stiffness.diagonal()).reshape(-1, 3).max(axis=1)
    for i in np.flatnonzero(on_surface & (volume > 0)):
        first, end = stiffness.indptr[3 * i], stiffness.indptr[3 * i + 1]
        columns = stiffness.indices[first:end]  # the same of the three rows of a node
        node, component = np.divmod(columns, 3)
        offset = x[node] - x[i]
        fields = np.column_stack([np.ones(len(node)), offset / max(np.abs(offset).max(initial=0.0), 1e-300)])
        affine = (fields[:, :, None] * np.eye(3)[component][:, None, :]).reshape(len(node), -1)
        rows = stiffness.data[first:stiffness.indptr[3 * i + 3]].reshape(3, -1) / np.sqrt(volume[i])
        rows = rows - (affine @ np.linalg.lstsq(affine, rows.T, rcond=1e-6)[0]).T
        data[first:stiffness.indptr[3 * i + 3]] = rows.ravel()
    return sparse.csr_array((data, stiffness.indices, stiffness.indptr), shape=stiffness.shape)
