"""From motion in space to motion in a volume: column, row and slice of every node.

    motion = scanner of the scan (X + u) - scanner (X)          voxels
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from idic.correlation.views.kinds import ViewKind
from idic.images import Scanner


@dataclass(frozen=True, eq=False)
class VolumeView:
    """Projection of the motion of the nodes into the scans.

    camera : the scanner of the reference; later : of the deformed scan, where it drifts (`at`)
    """

    camera: Scanner
    later: Scanner | None = None
    kind = ViewKind.VOLUME
    n_components = 3
    is_affine = False  # as `View`: the derivative depends on the drift of the scan

    def at(self, frame: int) -> VolumeView:
        """The same for one scan."""
        return self if self.camera.motion is None else replace(self, later=self.camera.at(frame))

    @property
    def moved_camera(self) -> Scanner:
        """The scanner of the deformed scan."""
        return self.camera if self.later is None else self.later

    def points(self, nodes: np.ndarray) -> np.ndarray:
        """Places of the nodes that the camera sees: all of a solid  # (n_nodes, 3) mm"""
        return nodes

    def motion(self, nodes: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Motion in the volume  # (n_nodes, 3) mm -> (n_nodes, 3) voxels"""
        return self.moved_camera.project(nodes + u) - self.camera.project(nodes)

    def jacobian(self, nodes: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Derivative of the place in the scan by that of a deformed node  # (n_nodes, 3, 3) voxels/mm"""
        return self.moved_camera.jacobian(nodes + u)

    def columns(self, nodes: np.ndarray, u: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Nodal sensitivities in the volume  # (n_nodes, 3, m) mm per unit -> (3 n_nodes, m)"""
        return self.projected(self.jacobian(nodes, u), columns)

    def projected(self, jacobian: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """The same as `columns`; jacobian : of the scan, `jacobian`."""
        return np.einsum("nij,njm->nim", jacobian, columns).reshape(3 * len(columns), -1)

    def camera_column(self, nodes: np.ndarray, u: np.ndarray, gradient: np.ndarray, name: str) -> np.ndarray:
        """Sensitivity to an amplitude of the drift, in which the reference scan has no part  # (3 n_nodes,)"""
        return self.moved_camera.motion_slope(nodes + u, name).ravel()
