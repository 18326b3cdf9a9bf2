"""Free FE-DIC of one frame: Gauss-Newton on the nodal displacement, brightness eliminated, with regularisation.

    (H + w D^T D) du = q - w D^T D u,    q = sum N^T (F^-T grad f) r,    u <- u + du

docs/method.md, equation 13.1. The convected gradient of the *reference* defines the fixed point, so the noise of the
frame does not bias it. The factorisation is kept while the strain changes little.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from idic.correlation import FieldReference, NodalEquations, ReferenceImage, nodal_equations
from idic.measure.dic.regularisation import Smoother
from idic.images import Spline, noise_share

_MAX_STRAIN_CHANGE = (0.03, 0.2)  # of F, rms and largest, under one factorisation: steps contract by twice that
_MAX_PIXEL_CHANGE = 0.002  # part of the pixels that enter or leave the image under one factorisation
_DIVERGENCE = 0.02, 6  # px, iterations: a larger step that has not halved within so many iterations diverges
_MIN_INFORMATION = 0.02  # over the median of the nodes: less is not measured (its std is 7 times that of the others)


@dataclass(frozen=True, eq=False)
class Factorisation:
    """H + w D^T D factorised, and the state it belongs to."""

    lu: SuperLU
    gradients: np.ndarray  # (n_elements, 2, 2)
    n_valid: int
    measured: np.ndarray  # (n_nodes,) bool: nodes that pixels locate
    penalty: sparse.csc_array  # w D^T D


@dataclass(frozen=True, eq=False)
class DicFrame:
    """The measured displacement of one frame.

    Attributes
    ----------
    u_px : array (n_nodes, 2)
        Displacement of the nodes in the image; NaN where neither a pixel nor the regularisation reaches.
    u_full_px : array (n_nodes, 2)
        The same without gaps (smoothly continued): what a neighbouring frame may start from.
    rms_gv : float
        Root of the mean squared residual over the valid pixels, brightness removed.
    rr_gv2 : float
        The sum behind it.
    element_rr : array (n_elements,)
        Sum of r^2 per element of the pixel map (before brightness).
    brightness : array (nb,)
        Gain and offset per patch: g(x + u) = f + gain f_centred + offset.
    n_pixels, n_lost : int
        Pixels in the sum; pixels of the map that left the image.
    iterations : int
    converged : bool
    last_step_px : float
        Root of the mean square of the last step over the measured nodes.
    kappa : float
        Mean of 1/det F.
    hessian : csr_array (2 n_nodes, 2 n_nodes), factorisation : Factorisation
        From them follows the uncertainty (`node_std`).
    """

    u_px: np.ndarray
    u_full_px: np.ndarray
    rms_gv: float
    rr_gv2: float
    element_rr: np.ndarray
    brightness: np.ndarray
    n_pixels: int
    n_lost: int
    iterations: int
    converged: bool
    last_step_px: float
    kappa: float
    hessian: sparse.csr_array
    factorisation: Factorisation | None

    def field_variance(self, reference: FieldReference, dof: float) -> float:
        """Variance of the noise of one component by what the free motion leaves; dof : `fitted_dof`  # µm²"""
        return self.rr_gv2 / max(self.n_pixels - dof, 1.0) / (1.0 + 1.0 / reference.n_images)

    def node_std(self, reference: ReferenceImage, noise_gv: float,
                 nodes: np.ndarray | None = None) -> np.ndarray:
        """Standard deviation of the measured displacement by image noise.

        ``A^-1 H A^-1 sigma^2 (1/n_images + kappa)`` with A = H + w D^T D: the scatter by noise, without the
        bias by regularisation.

        Parameters
        ----------
        noise_gv : float
            Noise of one image.
        nodes : array of node indices, optional
            Default all; two solutions per node, so a few of them suffice on large meshes.

        Returns
        -------
        array (n, 2) px; NaN where the displacement is
        """
        nodes = np.arange(len(self.u_px)) if nodes is None else np.asarray(nodes)
        factor = self.factorisation
        variance = np.empty(2 * len(nodes))
        dofs = (2 * nodes[:, None] + [0, 1]).ravel()
        for first in range(0, len(dofs), 256):
            part = dofs[first : first + 256]
            unit = np.zeros((2 * len(self.u_px), len(part)))
            unit[part, np.arange(len(part))] = 1.0
            x = factor.lu.solve(unit)
            variance[first : first + 256] = np.einsum("ij,ij->j", x, self.hessian @ x)
        residual_variance = noise_gv**2 * gradient_share(reference) * (1.0 / reference.n_images + self.kappa)
        std = np.sqrt(variance * residual_variance).reshape(-1, 2)
        return np.where(np.isfinite(self.u_px[nodes]), std, np.nan)


def gradient_share(reference: ReferenceImage | FieldReference) -> float:
    """Part of the pixel noise variance in a sum against the gradient after the low-pass (1: no low-pass)."""
    to_image = reference.pixel_map.to_image
    return noise_share(to_image(reference.fx, 0.0), to_image(reference.fy, 0.0), reference.lowpass_px)


def dic_frame(reference: ReferenceImage, spline: Spline, start_px: np.ndarray, regularisation: Smoother,
              brightness: str = "frame", tolerance: float = 5e-4, max_iterations: int = 40,
              factorisation: Factorisation | None = None, exclude: np.ndarray | None = None) -> DicFrame:
    """Measure the nodal displacement between the reference image and one frame.

    Parameters
    ----------
    reference : ReferenceImage
        Built on a pixel map (`idic.correlation.ReferenceImage.of`).
    spline : Spline
        Of the frame (`idic.images.interpolate.prefilter`).
    start_px : array (n_nodes, 2)
        Within about the speckle size of the solution; see `idic.measure.dic.start` for larger motion.
    regularisation : Smoother
        `build_smoother(pixel_map.nodes_px, cells, Regularisation(...))`; kind "none" only holds nodes without pixels.
    brightness : "none" | "frame" | "patch"
    tolerance : float, px
        Stop where the root mean square of a step falls below; the default is a tenth of the noise of a good test.
    max_iterations : int
    factorisation : Factorisation, optional
        Of a neighbouring frame with the same reference and regularisation.
    exclude : array of pixel numbers, optional
        Pixels of the map to leave out; the regularisation carries the displacement across them.

    Returns
    -------
    DicFrame
        ``converged`` False where the tolerance was not reached.

    Examples
    --------
    >>> pixel_map = PixelMap.of(mesh.nodes, mesh.blocks, camera, f.shape)
    >>> smoother = build_smoother(pixel_map.nodes_px, mesh.blocks, Regularisation("mechanical", 60.0))
    >>> frame = dic_frame(ReferenceImage.of(pixel_map, f), prefilter(g), np.zeros((mesh.n_nodes, 2)), smoother)
    >>> frame.converged, frame.u_px.shape == (mesh.n_nodes, 2)
    (True, True)
    """
    u = np.array(start_px, dtype=float)
    factor, damping, steps = factorisation, 1.0, [np.inf]
    nodal = nodal_equations(reference, spline, u, brightness, exclude)
    while len(steps) <= max_iterations and nodal.n_valid > 0:
        factor = _factorise(reference, nodal, u, regularisation, factor)
        if factor is None:
            steps.append(np.inf)
            break
        du = _gauss_newton_step(nodal, factor, u) * damping
        steps.append(float(np.sqrt(np.mean(du[factor.measured] ** 2))))
        if not steps[-1] < max(reference.pixel_map.shape):
            steps[-1] = np.inf
            break
        u += du
        nodal = nodal_equations(reference, spline, u, brightness, exclude)
        if steps[-1] < tolerance or _diverges(steps):
            break
        damping = 0.5 if len(steps) > 5 and steps[-1] > 0.9 * steps[-2] else min(1.0, 1.2 * damping)
    return _result(nodal, regularisation, factor, u, len(steps) - 1, steps[-1], tolerance)


def _diverges(steps: list[float]) -> bool:
    size, patience = _DIVERGENCE
    return len(steps) > patience and steps[-1] > max(size, 0.5 * steps[-patience])


def _result(nodal, smoother, factor, u, iterations, step, tolerance) -> DicFrame:
    fit = nodal.brightness_fit()
    reached = np.zeros(len(u), dtype=bool) if factor is None else smoother.reached(factor.measured)
    if not np.isfinite(step):
        reached[:] = False
    return DicFrame(
        u_px=np.where(reached[:, None], u, np.nan), u_full_px=u,
        rms_gv=float(np.sqrt(max(fit.rr, 0.0) / nodal.n_valid)) if nodal.n_valid else np.nan, rr_gv2=fit.rr,
        element_rr=nodal.element_rr, brightness=fit.coefficients, n_pixels=nodal.n_valid, n_lost=nodal.n_lost,
        iterations=iterations, converged=bool(step < tolerance), last_step_px=step, kappa=nodal.kappa,
        hessian=nodal.H, factorisation=factor)


def _factorise(reference: ReferenceImage, nodal: NodalEquations, u, smoother: Smoother,
                previous: Factorisation | None) -> Factorisation | None:
    """A new one where strain or visible pixels changed, else the previous one; None: too few nodes are measured."""
    gradients = nodal.motion.gradient
    if previous is not None and abs(nodal.n_valid - previous.n_valid) <= _MAX_PIXEL_CHANGE * nodal.n_valid:
        change = gradients - previous.gradients
        if np.sqrt(np.mean(change**2)) <= _MAX_STRAIN_CHANGE[0] and np.abs(change).max() <= _MAX_STRAIN_CHANGE[1]:
            return previous
    measured = measured_nodes(nodal.H)
    if measured.sum() < 3:
        return None
    mean_square = float(np.mean(reference.fx**2 + reference.fy**2)) / 2
    penalty = smoother.matrix(mean_square, ~measured)
    matrix = sparse.csc_array(nodal.H + penalty)
    idle = matrix.diagonal() == 0.0  # nodes of no element
    matrix = sparse.csc_matrix(matrix + sparse.diags_array(np.where(idle, 1.0, 0.0)))
    matrix.indices, matrix.indptr = matrix.indices.astype(np.int32), matrix.indptr.astype(np.int32)
    try:
        lu = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError:  # exactly singular: the measured nodes do not hold the others
        return None
    return Factorisation(lu, gradients, nodal.n_valid, measured, penalty)


def measured_nodes(hessian: sparse.csr_array) -> np.ndarray:
    """Nodes that the pixels around them locate in every direction  # (n_nodes,) bool"""
    diagonal = hessian.diagonal().reshape(-1, 2)
    cross = hessian.diagonal(1)[::2]
    mean, half = diagonal.mean(axis=1), (diagonal[:, 0] - diagonal[:, 1]) / 2
    smallest = mean - np.hypot(half, cross)  # eigenvalue of the node's 2 x 2 block
    informed = smallest > 0
    return smallest > _MIN_INFORMATION * np.median(smallest[informed]) if informed.any() else informed


def _gauss_newton_step(nodal: NodalEquations, factor: Factorisation, u) -> np.ndarray:
    """Step of the displacement with gain and offset eliminated  # (n_nodes, 2) px"""
    rhs = nodal.q - factor.penalty @ u.ravel()
    du = factor.lu.solve(rhs)
    if nodal.n_brightness:
        coupling = nodal.hb.toarray()
        moved = factor.lu.solve(coupling)  # (2 n_nodes, nb)
        schur = nodal.bb - coupling.T @ moved
        bright = np.linalg.pinv(schur, rcond=1e-12, hermitian=True) @ (nodal.rb - moved.T @ rhs)
        du -= moved @ bright
        if nodal.n_brightness == 2 and abs(bright[0]) < 0.8:
            du /= 1.0 + bright[0]  # the frame's gradient is this much steeper
    return du.reshape(-1, 2)
