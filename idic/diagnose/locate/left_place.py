"""Place of the residual motion of the last model: the centre of the free motions with the largest excess.

A cut, a band or a loose patch moves in a way that no law of the body follows: the motion jumps or concentrates there,
whatever the stiffness of an element could take.
"""

from __future__ import annotations

import numpy as np

from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.diagnose.residual.subspace import Grid, hats, projected

MIN_PEAK_SHARE = 0.5  # of the largest excess of a single free motion: what belongs to the place
MAX_EXTENT_SHARE = 0.5  # of the visible region along its longer side: a larger place is the whole body
MIN_PEAK_Z = 5.0  # standard deviations of the excess of one free motion over all frames


def left_place(residual: ResidualEvidence, grid: Grid) -> np.ndarray | None:
    """Centre of the residual motion, at the nearest node  # (dim,) mm; None where it fills the body, or is noise."""
    evidence = residual.evidence
    basis = hats(evidence, grid)
    excess = np.zeros(basis.n)
    for part in evidence.parts:
        matrix, rhs = projected(evidence, part, basis.fields)
        is_seen = np.diagonal(matrix) > 1e-6 * max(np.diagonal(matrix).max(initial=0.0), 1e-300)
        excess += np.where(is_seen, rhs**2 / np.where(is_seen, np.diagonal(matrix), 1.0) - 1.0, 0.0)
    if not excess.max(initial=0.0) > MIN_PEAK_Z * np.sqrt(2.0 * len(evidence.parts)):
        return None
    n_nodes = residual.context.experiment.model.mesh.n_nodes
    camera = basis.first_node(evidence) // n_nodes
    strong = (excess > MIN_PEAK_SHARE * excess.max()) & (camera == camera[np.argmax(excess)])
    places, weights = basis.places[strong], excess[strong]
    visible = grid.extent.copy()
    visible[0] /= len(residual.cameras)  # they stand side by side
    if np.ptp(places, axis=0).max() > MAX_EXTENT_SHARE * visible.max():
        return None
    middle = (weights[:, None] * places).sum(axis=0) / weights.sum()
    nearest = int(np.argmin(((grid.at - middle) ** 2).sum(axis=1)))
    return residual.context.experiment.model.mesh.nodes[nearest % n_nodes]
