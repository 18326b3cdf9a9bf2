"""From motion in space to motion in the image of a pinhole camera: two components per node.

    motion     P_t(X + u) - P(X)                                     docs/method.md, equation 17.1
    columns    J_P,t(X + u) phi                                      equation 17.3

P is the projection, J_P its 2 x 3 Jacobian at the deformed surface, t the frame. Both are exact at the nodes; between
them they are what the shape functions of the face make of it. Nodes of a plane specimen have z = 0; its motion has a
third component where the thickness change is known (`idic.fe.thickness_change`), else none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from idic.correlation.views.kinds import ViewKind
from idic.errors import InputError, NotConverged
from idic.fe import Mesh, PerMesh
from idic.images import PlacedCamera

_TANGENTS = PerMesh()


@dataclass(frozen=True, eq=False)
class PinholeView:
    """Projection of the motion of the nodes into the images of one pinhole camera; used as
    `idic.correlation.views.view.View`.

    Attributes
    ----------
    camera : PlacedCamera
    mesh : Mesh
    surface : str, optional
        Face set that is seen, of a solid.
    later : PlacedCamera, optional
        The camera of the deformed frame, where the specimen moves as a rigid body: see `at`.
    """

    camera: PlacedCamera
    mesh: Mesh
    surface: str | None = None
    later: PlacedCamera | None = None
    kind: ViewKind = ViewKind.GREY
    axis: int = -1
    rise: float = 0.0
    n_components: int = 2

    def at(self, frame: int) -> PinholeView:
        """The same for one frame, where the specimen moves as a rigid body from frame to frame."""
        return self if self.camera.motion is None else replace(self, later=self.camera.at(frame))

    @property
    def moved_camera(self) -> PlacedCamera:
        """The camera of the deformed frame."""
        return self.camera if self.later is None else self.later

    def points(self, nodes: np.ndarray) -> np.ndarray:
        """The points to project  # (n_nodes, 2|3) mm -> (n_nodes, 3) mm"""
        return in_space(nodes)

    def deformed(self, nodes: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Where the nodes are in the frame, before its rigid motion  # (n_nodes, 3) mm"""
        return in_space(nodes) + in_space(u)

    def motion(self, nodes: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Motion in the image  # nodes (n_nodes, dim), u (n_nodes, 2|3) mm -> (n_nodes, 2) px

        Raises
        ------
        NotConverged
            If the motion carries the mesh behind the camera, or beyond the fold of its distortion.
        """
        still = in_space(nodes)
        try:
            return self.moved_camera.project(self.deformed(nodes, u)) - self.camera.project(still)
        except InputError as error:
            raise NotConverged(f"{error.what}: {error.found}") from None

    def columns(self, nodes: np.ndarray, u: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Nodal sensitivities in the image  # (n_nodes, 2|3, m) mm per unit -> (2 n_nodes, m)"""
        return self.projected(self.jacobian(nodes, u), columns)

    def jacobian(self, nodes: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Derivative of the position in the frame by that of a deformed node  # (n_nodes, 2, 3) px/mm"""
        return self.moved_camera.jacobian(self.deformed(nodes, u))

    def projected(self, jacobian: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """The same as `columns`; jacobian : of the frame, `jacobian`."""
        return np.einsum("ncd,ndm->ncm", jacobian[:, :, :columns.shape[1]], columns).reshape(2 * len(columns), -1)

    def camera_column(self, nodes: np.ndarray, u: np.ndarray, gradient: np.ndarray, name: str) -> np.ndarray:
        """Sensitivity to a parameter of camera or placement at fixed reference pixels  # (2 n_nodes,) px per unit

        The parameter moves the material point of a pixel along the surface as well as its image after deformation:
        ``phi = c(X + u) - J(X + u) F T [J(X) T]^-1 c(X)``, T two tangents of the surface (docs/method.md, equation
        17.5). A motion of the specimen after the reference frame has the first term only.

        Parameters
        ----------
        gradient : array (n_nodes, 2|3, dim)
            Deformation gradient at the nodes.
        """
        still, moved = in_space(nodes), self.deformed(nodes, u)
        changed = self.moved_camera.parameter_jacobian(moved, name)
        if self.camera.is_motion(name):
            return changed.ravel()
        tangents = surface_tangents(self.mesh, self.surface)  # (n_nodes, dim, 2)
        carried = np.einsum("nij,njk->nik", gradient, tangents)
        moved_slopes = np.einsum("nci,nik->nck", self.moved_camera.jacobian(moved)[:, :, :gradient.shape[1]], carried)
        still_slopes = np.einsum("nci,nik->nck", self.camera.jacobian(still)[:, :, :tangents.shape[1]], tangents)
        back = solved_at_seen(still_slopes, self.camera.parameter_jacobian(still, name))
        return (changed - np.einsum("nck,nk->nc", moved_slopes, back)).ravel()


def in_space(field: np.ndarray) -> np.ndarray:
    """A nodal field with three components, 0 for one that is not there  # (n_nodes, 2|3, ...) -> (n_nodes, 3, ...)"""
    if field.shape[1] == 3:
        return field
    return np.concatenate([field, np.zeros_like(field[:, :1])], axis=1)


def surface_tangents(mesh: Mesh, surface: str | None) -> np.ndarray:
    """Two orthonormal tangents of the seen surface at the nodes  # (n_nodes, dim, 2)

    Of a solid they are square to the mean normal of the faces around a node; elsewhere they do not matter.
    """
    if mesh.n_dim == 2:
        return np.broadcast_to(np.eye(2), (mesh.n_nodes, 2, 2))
    return _TANGENTS.once(mesh, surface, lambda: _tangents(nodal_normals(mesh, surface)))


def nodal_normals(mesh: Mesh, surface: str | None) -> np.ndarray:
    """Mean outward normal of the seen faces around each node, not of unit length; 0 elsewhere  # (n_nodes, 3)"""
    total = np.zeros((mesh.n_nodes, 3))
    for block in mesh.surface_cells(surface):
        slopes = block.kind.shape_gradients(block.kind.reference_nodes)  # (where, whose, 2)
        by = np.einsum("eai,qak->eqik", mesh.nodes[block.connectivity], slopes)  # (n, nodes, 3, 2)
        np.add.at(total, block.connectivity, np.cross(by[..., 0], by[..., 1]))
    return total


def _tangents(normals: np.ndarray) -> np.ndarray:
    size = np.linalg.norm(normals, axis=1, keepdims=True)
    unit = np.where(size > 0, normals / np.maximum(size, 1e-300), [0.0, 0.0, 1.0])
    least = np.eye(3)[np.argmin(np.abs(unit), axis=1)]
    first = np.cross(unit, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(unit, first)], axis=2)


def solved_at_seen(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Solutions of 2 x 2 systems; 0 at nodes whose surface stands edge on or looks away: no pixel shows them."""
    det = np.linalg.det(matrices)
    usable = np.abs(det) > 1e-6 * np.abs(det).max(initial=0.0)
    solution = np.zeros_like(vectors)
    solution[usable] = np.linalg.solve(matrices[usable], vectors[usable][:, :, None])[:, :, 0]
    return solution
