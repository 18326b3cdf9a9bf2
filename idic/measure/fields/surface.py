"""The surface that the main camera sees, as a plane mesh: nodal motion becomes a plane deformation gradient.

Of a plane model it is the mesh itself. Of a solid it is the face set of `surface`, in the two coordinates that the
camera resolves: what a measurement shows, and a simulation in the same way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from idic.fe import Mesh, cell_type, interpolation, make_mesh, nodal_deformation


@dataclass(frozen=True, eq=False)
class Surface:
    """The seen surface.

    Attributes
    ----------
    plane : Mesh
        Plane mesh of its nodes, mm.
    index : (n,) int
        Its nodes in the mesh of the experiment.
    """

    plane: Mesh
    index: np.ndarray

    @property
    def n_nodes(self) -> int:
        return len(self.index)

    def deformation(self, u: np.ndarray) -> np.ndarray:
        """Plane deformation gradient at the nodes  # (..., n, 2) mm -> (..., n, 2, 2)"""
        in_plane = np.asarray(u)[..., :2]
        flat = np.reshape(in_plane, (-1, self.n_nodes, 2))
        return np.array([nodal_deformation(self.plane, motion) for motion in flat]).reshape(*in_plane.shape, 2)

    def weights(self, points: np.ndarray) -> tuple[sparse.csr_array, np.ndarray]:
        """See `idic.fe.mesh.locate.interpolation`  # (m, 2) mm -> (m, n), (m,) bool"""
        return interpolation(self.plane.nodes, self.plane.blocks, points)

    @cached_property
    def corners(self) -> np.ndarray:
        """Nodes that are corners of an element  # (m,)"""
        return np.unique(np.concatenate([block.connectivity[:, :block.kind.n_corners].ravel()
                                         for block in self.plane.blocks]))


def surface_of(mesh: Mesh, surface: str | None) -> Surface:
    """The surface that the main camera sees; surface : face set of a solid.

    Raises
    ------
    InputError
        A solid without that face set.
    """
    blocks = mesh.surface_cells(surface)
    index = np.unique(np.concatenate([block.connectivity.ravel() for block in blocks]))
    place = np.full(mesh.n_nodes, -1)
    place[index] = np.arange(len(index))
    nodes = mesh.nodes[index, :2]
    cells = [(block.cell, _counter_clockwise(nodes, place[block.connectivity], block.cell)) for block in blocks]
    return Surface(make_mesh(nodes, cells, node_labels=np.asarray(mesh.node_labels)[index]), index)


def _counter_clockwise(nodes: np.ndarray, connectivity: np.ndarray, cell: str) -> np.ndarray:
    """Faces that look away from +z are numbered the other way round."""
    n = cell_type(cell).n_corners
    x, y = np.moveaxis(nodes[connectivity[:, :n]], -1, 0)
    area = (x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1)
    order: Sequence[int] = [0, *range(n - 1, 0, -1)]
    if connectivity.shape[1] > n:
        order = [*order, *range(connectivity.shape[1] - 1, n - 1, -1)]
    return np.where((area < 0)[:, None], connectivity[:, list(order)], connectivity)
