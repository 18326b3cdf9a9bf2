"""Plane stress: the seen surface moves out of its plane by half of the thickness change.

    u_z = side t/2 (F33 - 1)                                         docs/method.md, equation 17.6

with the out-of-plane stretch F33 that the law finds at every integration point (P33 = 0), carried to the nodes as a
linear field of each element and averaged there. Its derivatives are those of the law along each direction. The middle
of the sheet stays in its plane.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from idic.fe.assembly.assembly import stretch_changes
from idic.fe.assembly.assembly import System
from idic.fe.equilibrium import Converged
from idic.fe.assembly.point_means import add_carried_values, quotient
from idic.fe.body.body import Direction


def surface_rise(system: System, end: Converged, changes: Sequence[np.ndarray],
                 directions: Sequence[Direction]) -> tuple[np.ndarray, np.ndarray]:
    """Motion of the seen surface out of the plane, and its derivatives  # (n_nodes,) mm, (n_nodes, nd)

    changes : per group (n_points, nd, n_state), derivatives of the states
    """
    body = system.body
    half = 0.5 * body.surface_side * body.thickness
    stretch = _at_nodes(system, [np.concatenate([g.state[:, -1:] - 1.0, change[:, :, -1]], axis=1)
                                 for g, change in zip(end.evaluation.groups, changes, strict=True)])
    slopes = half * stretch[:, 1:]
    for k, direction in enumerate(directions):
        if direction.thickness:
            slopes[:, k] += half / body.thickness * stretch[:, 0]
    return half * stretch[:, 0], slopes


def influence_on_rise(system: System, params: Mapping[str, np.ndarray], start: Converged, end: Converged,
                      du: np.ndarray) -> np.ndarray:
    """What motions at the end of an increment do to the rise at fixed history  # du (n_nodes, d, m) -> (n_nodes, m)"""
    body, dt = system.body, end.time - start.time
    changes = [stretch_changes(system, k, g, params[body.sections[system.groups[k].section].name],
                                        start.states, dt, du) for k, g in enumerate(end.evaluation.groups)]
    return 0.5 * body.surface_side * body.thickness * _at_nodes(system, changes)


def _at_nodes(system: System, values: Sequence[np.ndarray]) -> np.ndarray:
    """Values of the points of every group, carried to the nodes  # (n_points, k) each -> (n_nodes, k)"""
    body = system.body
    total, weight = np.zeros((body.mesh.n_nodes, values[0].shape[1])), np.zeros(body.mesh.n_nodes)
    for group, point_values in zip(system.groups, values, strict=True):
        add_carried_values(body.mesh, group.cell, group.elements, point_values, body.quadrature, total, weight)
    return np.nan_to_num(quotient(total, weight))  # nodes of no element stay
