"""Free motion of a cross-section seen from above: along the section and in height, from the images alone, no law.

    minimise  sum_px r^2 + w int |d''|^2 ds,     d = motion less the one it starts from

The second difference along the section regularises the motion of single columns. A straight line passes unchanged; a
wave of the length l keeps half its height. The weight follows from the information of a column, so l means
the same for the motion along the section and for the height.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from idic.correlation import NodalEquations, ResidualMap, SectionReference

MIN_LENGTH_PX = 24.0  # of the waves that are damped by half; as in a free FE-DIC of grey images
_MAX_STEP_STDS = 0.1  # of the last step, in standard deviations of the whole field
_COMPONENTS = (0, 2)  # of three: along the section, height


@dataclass(frozen=True, eq=False)
class SectionField:
    """The measured motion of one frame.

    Attributes
    ----------
    motion : array (n_nodes, 3)
        Column displacement (px), nothing, height; as it was given where no column of the section is near.
    nodes : array (n,)
        Those that were measured, in the order of their column.
    residual : ResidualMap
    fitted : float
        Degrees of freedom that the motion takes from the residual, tr(2 S - S^2).
    converged : bool
    """

    motion: np.ndarray
    nodes: np.ndarray
    residual: ResidualMap
    fitted: float
    converged: bool

    def chi2_dof(self, noise_std: float) -> float:
        """Squared residual over noise, per degree of freedom that is left."""
        n = float(self.residual.valid.sum())
        return self.residual.chi2_dof(noise_std) * n / max(n - self.fitted, 1.0)


def section_field(reference: SectionReference, image: np.ndarray, start: np.ndarray, columns_px: np.ndarray,
                  length_px: float | None = None, max_iterations: int = 20) -> SectionField:
    """Measure the motion of a section between the reference and one height image.

    Parameters
    ----------
    image : array (ny, nx)
        The frame as recorded.
    start : array (n_nodes, 3)
        Column displacement (px), row displacement, height: within a pixel or two of the solution.
    columns_px : array (n_nodes,)
        Column of the nodes in the reference image.
    length_px : float, optional
        `smoothing_length` without it.
    """
    nodes = section_nodes(reference, columns_px)
    x = columns_px[nodes]
    length = smoothing_length(reference, columns_px) if length_px is None else length_px
    bend = _bends(reference, nodes, x)
    dofs = (3 * nodes[:, None] + _COMPONENTS).T.ravel()  # along the section first, then the heights
    penalty, motion, converged = None, np.array(start, dtype=float), False
    begin = motion[nodes][:, _COMPONENTS].T.ravel()
    for _ in range(max_iterations):
        nodal = reference.equations(image, motion)
        if not nodal.n_valid:
            break
        H = nodal.H.tocsr()[dofs][:, dofs].toarray()
        penalty = _penalty(H, bend, x, length) if penalty is None else penalty
        moved = motion[nodes][:, _COMPONENTS].T.ravel() - begin
        step = _solve(H + penalty, nodal.q[dofs] - penalty @ moved)
        motion[np.ix_(nodes, _COMPONENTS)] += step.reshape(2, -1).T
        converged = _in_noise(step, H + penalty, nodal) < _MAX_STEP_STDS
        if converged:
            break
    residual = reference.residual_map(image, motion)
    if penalty is None:
        return SectionField(motion, nodes, residual, 0.0, False)
    passed = np.linalg.lstsq(H + penalty, H, rcond=None)[0]
    fitted = float(2.0 * np.trace(passed) - np.sum(passed * passed.T))
    return SectionField(motion, nodes, residual, fitted, converged)


def section_nodes(reference: SectionReference, columns_px: np.ndarray) -> np.ndarray:
    """Nodes of the edges that own a column, from left to right  # (n,)"""
    nodes = reference.pixel_map.visible_nodes
    return nodes[np.argsort(columns_px[nodes], kind="stable")]


def smoothing_length(reference: SectionReference, columns_px: np.ndarray) -> float:
    """Twice the distance of the nodes, the shortest wave of the edges, and at least `MIN_LENGTH_PX`  # px"""
    return max(2.0 * float(np.median(np.diff(columns_px[section_nodes(reference, columns_px)]))), MIN_LENGTH_PX)


def second_difference(x: np.ndarray) -> np.ndarray:
    """D with |D d|^2 = int |d''|^2 dx for values at the places x  # (n - 2, n)"""
    n = len(x)
    if n < 3:
        return np.zeros((0, n))
    backward, forward = np.diff(x)[:-1], np.diff(x)[1:]
    span, k = backward + forward, np.arange(n - 2)
    D = np.zeros((n - 2, n))
    D[k, k], D[k, k + 1], D[k, k + 2] = 2.0 / (backward * span), -2.0 / (backward * forward), 2.0 / (forward * span)
    return np.sqrt(0.5 * span)[:, None] * D


def _bends(reference: SectionReference, nodes: np.ndarray, x: np.ndarray) -> np.ndarray:
    """`second_difference` of every unbroken run of edges: the motion may jump at a step  # (m, n)"""
    conn = reference.pixel_map.conn
    place = np.full(reference.pixel_map.n_nodes, -1)
    place[nodes] = np.arange(len(nodes))
    joined = sparse.coo_array((np.ones(2 * len(conn)), (place[conn[:, [0, 0]]].ravel(), place[conn[:, 1:]].ravel())),
                              shape=(len(nodes), len(nodes)))
    number, run = connected_components(joined, directed=False)
    parts = []
    for members in (np.flatnonzero(run == k) for k in range(number)):
        rows = second_difference(x[members])
        parts.append(np.zeros((len(rows), len(nodes))))
        parts[-1][:, members] = rows
    return np.concatenate(parts)


def _penalty(H: np.ndarray, bend: np.ndarray, x: np.ndarray, length: float) -> np.ndarray:
    """(l / 2 pi)^4 times the information of a column, component by component  # (2 n, 2 n)"""
    n, extent = len(x), max(float(np.ptp(x)), 1.0)
    penalty = np.zeros((2 * n, 2 * n))
    for part in (slice(0, n), slice(n, 2 * n)):  # the sum over a block is that of all columns: sum_a N_a = 1
        penalty[part, part] = (length / (2.0 * np.pi)) ** 4 * H[part, part].sum() / extent * bend.T @ bend
    return penalty


def _solve(A: np.ndarray, rhs: np.ndarray) -> np.ndarray:
    """A has ones on its diagonal once scaled: pixels and heights differ by orders of magnitude."""
    scale = np.sqrt(np.maximum(np.diagonal(A), 1e-300))
    return np.linalg.lstsq(A / np.outer(scale, scale), rhs / scale, rcond=1e-12)[0] / scale


def _in_noise(step: np.ndarray, A: np.ndarray, nodal: NodalEquations) -> float:
    """Length of a step in standard deviations that follow from the present residual."""
    return float(np.sqrt(max(step @ A @ step, 0.0) / max(nodal.rr / nodal.n_valid, 1e-300)))
