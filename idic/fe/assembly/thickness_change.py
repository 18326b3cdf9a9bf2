"""Plane stress: the seen surface moves out of its plane by half of the thickness change.

    u_z = side t/2 (F33 - 1)                                         docs/method.md, equation 17.6

with the out-of-plane stretch F33 that the law finds at every integration point (P33 = 0), averaged to the nodes. Its
derivatives are those of the law along each direction. The middle of the sheet stays in its plane.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from idic.fe.assembly.assembly import System
from idic.fe.equilibrium import Converged
from idic.fe.assembly.point_means import add_point_values, quotient
from idic.fe.model import Direction


def surface_rise(system: System, now: Converged, changes: Sequence[np.ndarray],
                 directions: Sequence[Direction]) -> tuple[np.ndarray, np.ndarray]:
    """Motion of the seen surface out of the plane, and its derivatives  # (n_nodes,) mm, (n_nodes, nd)

    changes : per group (n_points, nd, n_state), derivatives of the states
    """
    model = system.model
    half = 0.5 * model.surface_side * model.thickness
    values = [np.concatenate([g.state[:, -1:] - 1.0, change[:, :, -1]], axis=1)
              for g, change in zip(now.evaluation.groups, changes, strict=True)]
    total, weight = np.zeros((model.mesh.n_nodes, 1 + len(directions))), np.zeros(model.mesh.n_nodes)
    for group, own in zip(system.groups, values, strict=True):
        add_point_values(model.mesh, group.cell, group.elements, own, model.quadrature, total, weight)
    stretch = np.nan_to_num(quotient(total, weight))  # nodes of no element stay
    slopes = half * stretch[:, 1:]
    for k, direction in enumerate(directions):
        if direction.thickness:
            slopes[:, k] += half / model.thickness * stretch[:, 0]
    return half * stretch[:, 0], slopes
