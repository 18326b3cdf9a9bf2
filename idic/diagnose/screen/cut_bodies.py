"""The change by a crack that opens, at the nodes of a body without it.

The body with the cut has a mesh of its own, on which it is simulated twice: closed and open. Their difference is the
crack's alone.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial import KDTree

from idic.diagnose.physics.candidate import Variant
from idic.errors import NotConverged
from idic.fe import Mesh, interpolation
from idic.identification import Identification
from idic.model import Experiment, ForwardModel, build_forward

SAME_PLACE = 1e-9  # of the size of the body


def changed_by_opening(experiment: Experiment, variant: Variant,
                       identification: Identification) -> tuple[np.ndarray, np.ndarray] | None:
    """Change of motion (n, n_nodes, dim) mm and channels (n, n_channels) from a crack's null to its probe, from the
    reference on, at the nodes of the identified model; None where there is no answer."""
    forward = build_forward(experiment)
    if not isinstance(forward, ForwardModel):
        return None
    try:
        closed, opened = (_simulated(forward, experiment, identification, at) for at in (variant.null, variant.probe))
    except NotConverged:
        return None
    to_nodes = _carried(experiment.model.mesh, identification.experiment.model.mesh)
    (u_closed, channels_closed), (u_opened, channels_opened) = closed, opened
    return np.array([to_nodes @ change for change in u_opened - u_closed]), channels_opened - channels_closed


def _simulated(forward: ForwardModel, experiment: Experiment, identification: Identification,
               at: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
    values = experiment.model.parameters.own_of(identification.parameters.as_values()) | dict(at)
    states = [(state.u.copy(), state.channels.copy()) for state in forward.march(
        experiment.model.parameters.with_values(values), (), identification.local, identification.steps, may_cut=True)]
    return np.array([u for u, _ in states]), np.array([channels for _, channels in states])


def _carried(mesh: Mesh, uncut: Mesh) -> np.ndarray:
    """Weights that carry nodal values of a mesh to the nodes of the uncut one  # (n_uncut, n) sparse"""
    weights, inside = interpolation(mesh.nodes, mesh.blocks, uncut.nodes)
    weights = weights.tolil()
    distance, nearest = KDTree(mesh.nodes).query(uncut.nodes)
    for node in np.flatnonzero((distance <= SAME_PLACE * mesh.size) | ~inside):
        weights.rows[node], weights.data[node] = [int(nearest[node])], [1.0]
    return weights.tocsr()
