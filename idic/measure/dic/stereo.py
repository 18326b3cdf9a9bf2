"""Free stereo FE-DIC: the motion in space of every node of a surface that cameras with a lens see, frame by frame.

    (sum_c w_c J_c^T H_c J_c + P) dU = sum_c w_c J_c^T q_c - P U,      U <- U + dU   (docs/method.md, equation 17.8)

with H_c and q_c of camera c in its own image, brightness eliminated, J_c the 2 x 3 Jacobians at the nodes, w_c = 1/(2
sigma_c²) and P = w D^T D a regularisation of the surface: D U is the second difference of every component over the
neighbours of a node, zero for every affine motion. No point is triangulated and no image rectified. Three unknowns per
node are determined where two cameras see it; elsewhere the regularisation carries what its neighbours say.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from idic.correlation import (
    PinholeView, Reference, build_experiment_reference, in_space, view_of,
)
from idic.measure.dic.frame import gradient_share
from idic.measure.dic.surface_smoothing import SurfaceSmoother, surface_smoother
from idic.errors import InputError
from idic.images import PlacedCamera
from idic.model import Experiment

MAX_ITERATIONS = 40
TOLERANCE_PX = 5e-4      # rms step in the images
LARGEST_STEP_PX = 30.0   # rms: no convergence from there
DEFAULT_NOISE_GV = 2.0   # weight of a camera whose noise is not known
COLUMNS_AT_A_TIME = 200


@dataclass(frozen=True, eq=False)
class SurfaceMotion:
    """What the cameras measured.

    Attributes
    ----------
    nodes : (n,) int
        Nodes of the mesh that lie on seen elements.
    u_mm : (n_frames, n, 3)
        NaN in excluded frames and those that did not converge; 0 in the reference.
    rms_gv : (n_frames, n_cameras)
        Residual, brightness removed.
    noise_mm : (n, 3)
        Standard deviation of a displacement by the noise of the images, in mesh axes; NaN where that is not known.
    iterations : (n_frames,)
    length_mm : float
        Waves of this length are damped by half.
    """

    nodes: np.ndarray
    u_mm: np.ndarray
    rms_gv: np.ndarray
    noise_mm: np.ndarray
    iterations: np.ndarray
    length_mm: float


@dataclass(frozen=True, eq=False)
class Eye:
    """A camera of the measurement: its view of the experiment; weight : inverse variance of a grey value."""

    experiment: Experiment
    view: PinholeView
    reference: Reference
    weight: float


def surface_motion(experiment: Experiment, length_mm: float | None = None,
                   progress: Callable[[int, int], None] | None = None) -> SurfaceMotion:
    """Measure the motion of the seen surface from the images of all cameras with a lens.

    Parameters
    ----------
    experiment : Experiment
        Mesh, cameras, images and their options are used; no law, no force.
    length_mm : float, optional
        Of the regularisation; None: twice the distance of the nodes.
    progress : callable, optional
        Called with (frames done, frames in all).

    Raises
    ------
    InputError
        If fewer than two cameras have a lens.
    """
    model = experiment.model
    eyes = [eye_of(view, camera, build_experiment_reference(view, camera))
            for view in experiment.views if isinstance(camera := view.model.camera, PlacedCamera)]
    if len(eyes) < 2:
        raise InputError("motion in space needs two cameras with a lens", key="camera",
                         expected="two [[camera]] tables "
                         'with model = "pinhole"', found=str(len(eyes)),
    remedy="use idic.measure.dic.dic_stack for one camera")
    smoother = smoother_of_eyes(eyes, length_mm)
    n_frames = model.n_frames
    u_mm = np.full((n_frames, len(smoother.nodes), 3), np.nan)
    u_mm[model.reference] = 0.0
    rms, iterations = np.full((n_frames, len(eyes)), np.nan), np.zeros(n_frames, dtype=int)
    start, noise = np.zeros((model.mesh.n_nodes, 3)), None
    frames = [k for k in range(model.reference + 1, n_frames) if k not in experiment.recording.excluded]
    for n_done, frame in enumerate(frames, 1):
        u, frame_rms, count, converged = measured_frame(eyes, frame, start, smoother)
        iterations[frame], rms[frame] = count, frame_rms
        if converged:
            u_mm[frame], start = u[smoother.nodes], u
            noise = _noise(eyes, frame, u, smoother) if noise is None else noise
        if progress is not None:
            progress(n_done, len(frames))
    unknown = np.full((len(smoother.nodes), 3), np.nan)
    return SurfaceMotion(smoother.nodes, u_mm, rms, unknown if noise is None else noise, iterations, smoother.length_mm)


def eye_of(view: Experiment, camera: PlacedCamera, reference: Reference) -> Eye:
    """A camera of the measurement; view : what it sees, reference : its image at the pixels of the mesh"""
    noise = view.recording.noise.in_sums_gv or DEFAULT_NOISE_GV
    variance = (1.0 + 1.0 / reference.n_images) * noise**2 * gradient_share(reference)
    return Eye(view, view_of(view, camera), reference, 1.0 / variance)


def smoother_of_eyes(eyes: Sequence[Eye], length_mm: float | None = None) -> SurfaceSmoother:
    """The smoother on the faces that any camera sees; length_mm : see `surface_motion`"""
    cells = [(np.asarray(pm.conn), np.asarray(pm.kind)) for pm in (eye.reference.pixel_map for eye in eyes)]
    return surface_smoother(in_space(eyes[0].experiment.model.mesh.nodes), cells, length_mm)


def measured_frame(eyes: Sequence[Eye], frame: int, start: np.ndarray,
                   smoother: SurfaceSmoother) -> tuple[np.ndarray, np.ndarray, int, bool]:
    """Motion of all nodes (n_nodes, 3) mm, rms per camera, iterations, whether it converged."""
    u, step, rms = start.copy(), np.inf, np.full(len(eyes), np.nan)
    for count in range(1, MAX_ITERATIONS + 1):
        matrix, rhs, rms, per_px = _normal_equations(eyes, frame, u, smoother)
        change = splu(matrix).solve(rhs).reshape(-1, 3)
        step = float(np.sqrt(np.mean(change**2))) / per_px
        if not step < LARGEST_STEP_PX:
            return u, rms, count, False
        u[smoother.nodes] += change
        if step < TOLERANCE_PX:
            return u, rms, count, True
    return u, rms, MAX_ITERATIONS, False


def _normal_equations(eyes: Sequence[Eye], frame: int, u: np.ndarray, smoother: SurfaceSmoother):
    """Matrix and right-hand side of a step at the surface nodes, rms per camera, mm per px."""
    information, gap, rms = information_of(eyes, frame, u, smoother)
    penalty = smoother.penalty(information)
    rhs = gap - penalty @ u[smoother.nodes].ravel()
    size = float(np.mean([eye.view.camera.pixel_size for eye in eyes]))
    return sparse.csc_matrix(information + penalty), rhs, rms, size


def information_of(eyes: Sequence[Eye], frame: int, u: np.ndarray,
                   smoother: SurfaceSmoother) -> tuple[sparse.csc_array, np.ndarray, np.ndarray]:
    """sum_c w J^T H J and sum_c w J^T q with gain and offset eliminated, and rms per camera.

    The gain and offset of a frame are taken out of q; their part of H, two directions of all nodes together, only
    lengthens the way.
    """
    nodes, total, rms = eyes[0].experiment.model.mesh.nodes, None, []
    gap = np.zeros(3 * len(smoother.nodes))
    for eye in eyes:
        view = eye.view.at(frame)
        nodal = eye.reference.compare(eye.experiment, frame, view.motion(nodes, u))
        light = np.linalg.pinv(nodal.bb, hermitian=True) @ nodal.rb if nodal.n_brightness else np.zeros(0)
        q = nodal.q - nodal.hb @ light
        jacobian = view.moved_camera.jacobian(view.deformed(nodes, u))[smoother.nodes]  # (n, 2, 3)
        onto = sparse.block_diag(list(jacobian), format="csr")
        at = (2 * smoother.nodes[:, None] + np.arange(2)).ravel()
        part = eye.weight * (onto.T @ nodal.H[at][:, at] @ onto)
        total = part if total is None else total + part
        gap = gap + eye.weight * (onto.T @ q[at])
        rms.append(np.sqrt(max(nodal.rr - light @ nodal.rb, 0.0) / max(nodal.n_valid, 1)))
    return total.tocsc(), gap, np.array(rms)


def _noise(eyes: Sequence[Eye], frame: int, u: np.ndarray, smoother: SurfaceSmoother) -> np.ndarray:
    """Standard deviation of the displacement of every node  # (n, 3) mm

    Cov = S A S with A the information, whose weights are the inverse variance of a residual, and S = (A + P)^-1.
    """
    information, _, _ = information_of(eyes, frame, u, smoother)
    solver = splu(sparse.csc_matrix(information + smoother.penalty(information)))
    size = information.shape[0]
    variance = np.empty(size)
    for first in range(0, size, COLUMNS_AT_A_TIME):
        end = min(first + COLUMNS_AT_A_TIME, size)
        columns = np.zeros((size, end - first))
        columns[np.arange(first, end), np.arange(end - first)] = 1.0
        solved = solver.solve(columns)
        variance[first:end] = np.einsum("ij,ij->j", solved, information @ solved)
    return np.sqrt(np.maximum(variance, 0.0)).reshape(-1, 3)
