"""The free motion of measured fields: the smooth nodal displacement that follows the points of every frame best.

    (H + w D^T D) u = q,      H = s² Σ NᵀN,   q = s Σ Nᵀ v          docs/method.md, equation 15.5

Linear: one solution per frame, with one factorisation for all frames that show the same points. Motion along the normal
of a solid's surface is left out (`FieldReference.in_plane`).
"""

from __future__ import annotations

from collections.abc import Callable
from weakref import WeakKeyDictionary

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from idic.correlation import FieldEquations, FieldReference
from idic.measure.dic.frame import DicFrame, Factorisation, measured_nodes
from idic.measure.dic.noise import fitted_dof
from idic.measure.dic.regularisation import Regularisation, Smoother, build_smoother
from idic.model import Experiment, Model

MAX_RMS_RATIO = 2.0  # residual of a frame to the median of all; more is a jump (a crack, a break) that no mesh follows
MIN_SEEN_PART = 0.5  # of the points; fewer: the frame is lost


# by reference: the smoother, the points that are measured and the factorisation of the frame before
_LAST: WeakKeyDictionary[FieldReference, tuple[Smoother, np.ndarray, Factorisation | None]] = WeakKeyDictionary()


def field_frame(reference: FieldReference, measured: np.ndarray, smoother: Smoother) -> DicFrame | None:
    """The free motion of one frame; None where too few points are measured.

    measured : (n_pixels,) µm, NaN where not measured
    """
    zero = np.zeros((reference.pixel_map.n_nodes, 2))
    nodal = reference.equations(measured, zero)
    if nodal.n_valid < MIN_SEEN_PART * reference.pixel_map.n_pixels:
        return None
    factor = _factor_of(reference, np.isfinite(measured), nodal, smoother)
    if factor is None:
        return None
    u = factor.lu.solve(nodal.q).reshape(-1, 2)
    residual = reference.equations(measured, u)
    reached = smoother.reached(factor.measured)
    return DicFrame(np.where(reached[:, None], u, np.nan), u, float(np.sqrt(residual.rr / residual.n_valid)),
                    residual.rr,
                    residual.element_rr, np.zeros(0), residual.n_valid, residual.n_lost, 1, True, 0.0, 1.0, residual.H,
                    factor)


def _factor_of(reference: FieldReference, pattern: np.ndarray, nodal: FieldEquations,
               smoother: Smoother) -> Factorisation | None:
    """The factorisation of a frame that shows these points; that of the frame before where it shows the same ones."""
    latest = _LAST.get(reference)
    if latest is None or latest[0] is not smoother or not np.array_equal(latest[1], pattern):
        latest = _LAST[reference] = smoother, pattern, _factorised(reference, nodal.H, smoother, nodal.n_valid)
    return latest[2]


def _factorised(reference: FieldReference, hessian: sparse.csr_array, smoother: Smoother,
                n_valid: int) -> Factorisation | None:
    measured = measured_nodes(hessian)
    if measured.sum() < 3:
        return None
    penalty = sparse.csc_array(smoother.matrix(reference.scale**2, ~measured))
    matrix = sparse.csc_array(hessian + penalty)
    idle = np.where(matrix.diagonal() == 0.0, 1.0, 0.0)  # nodes of no element
    try:
        lu: SuperLU = splu(sparse.csc_matrix(matrix + sparse.diags_array(idle)), permc_spec="MMD_AT_PLUS_A",
                           diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError:  # singular: the measured nodes do not hold the others
        return None
    return Factorisation(lu, np.zeros((0, 2, 2)), n_valid, measured, penalty)


def smoother_of(model: Model, reference: FieldReference, regularisation: Regularisation) -> Smoother:
    """The regularisation on the nodes of the grid; without a length, waves of two nodes' distance are damped by
    half."""
    nodes, cells = reference.pixel_map.nodes_px, model.mesh.surface_cells(model.surface)
    smoother = build_smoother(nodes, cells, regularisation)
    if regularisation.length_px is not None or regularisation.kind == "none":
        return smoother
    return build_smoother(nodes, cells, Regularisation(regularisation.kind, 2.0 * smoother.size_px))


def field_motion(experiment: Experiment, regularisation: Regularisation,
                 progress: Callable[[int, int], None] | None = None,
                 keep: Callable[[np.ndarray], None] | None = None) -> dict:
    """The free motion of all frames: the entries of `idic.measure.dic.stack.DicStack`.

    keep : takes the motion of the frames one by one (`idic.measure.dic.stack.dic_stack`)
    """
    model, recording = experiment.model, experiment.recording
    reference = FieldReference.of(experiment, model.camera).in_plane
    smoother = smoother_of(model, reference, regularisation)
    n, nodes = model.n_frames, model.mesh.n_nodes
    motions: list[np.ndarray] = []
    keep_motion = motions.append if keep is None else keep
    rms, chi2, local = (np.full(n, np.nan) for _ in range(3))
    pixels, lost = np.zeros(n, dtype=int), np.zeros(n, dtype=int)
    std = recording.noise.std_gv or np.nan
    factor, dof = None, 0.0
    for k in range(n):
        if k == model.reference or k in recording.excluded:
            keep_motion(np.full((nodes, 2), 0.0 if k == model.reference else np.nan))
            continue
        frame = field_frame(reference, reference.measured(experiment, k), smoother)
        if frame is not None and frame.factorisation is not None:
            if frame.factorisation is not factor:
                factor, dof = frame.factorisation, fitted_dof(frame)
            rms[k], pixels[k], lost[k] = frame.rms_gv, frame.n_pixels, frame.n_lost
            keep_motion(frame.u_px)
            local[k] = frame.field_variance(reference, dof)
            chi2[k] = local[k] / std**2
        else:
            keep_motion(np.full((nodes, 2), np.nan))
        if progress is not None:
            progress(k + 1, n)
    typical = np.nanmedian(rms) if np.isfinite(rms).any() else np.inf
    status = ["excluded" if k in recording.excluded else "ok" if k == model.reference
              else "lost" if not np.isfinite(rms[k]) else "unexplained" if rms[k] > MAX_RMS_RATIO * typical else "ok"
              for k in range(n)]
    u_px = np.array(motions) if keep is None else np.empty((0, nodes, 2))
    return {"u_px": u_px, "status": status, "rms_gv": rms, "chi2_dof": chi2, "noise_gv": float(std),
            "noise_frames_gv": np.sqrt(local), "n_pixels": pixels, "n_lost": lost, "mismatched": np.zeros(n),
            "iterations": np.where(np.isfinite(rms), 1, 0), "converged": np.isfinite(rms), "attempts": np.zeros(n, int),
            "length_px": smoother.length_px}
