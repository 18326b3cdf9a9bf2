"""From motion in space to motion in the image: two components per node for grey images, three for height images.

    grey      column, row                  camera(X + u) - camera(X)                      px
    (a measured field likewise: its px is the distance of neighbouring points)
    space     column, row, normal          a field of three components: the same, and  n u_z        px, px, px
    volume    column, row, slice           scanner(X + u) - scanner(X), `volume_view`            voxels
    height    column, row, height          the same, and  n u_z / height_unit             px, px, unit of the images
    section   column, row, height          camera at (x, 0); the height is  n u_y / height_unit

``n`` is the sign of the surface's outward normal: a height is positive where the surface rises towards the camera.
A camera with a lens has a view of its own, `pinhole_view`. A cross-section (2D mesh whose `surface` is a set of edges)
is seen from above: its x runs through the image, its y is the height, and nothing changes along the
third direction.

Degrees of freedom of the image kernels are numbered ``n_components * node + component``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from idic.correlation.views.kinds import ViewKind
from idic.correlation.views.pinhole_view import PinholeView, in_space
from idic.correlation.views.volume_view import VolumeView
from idic.errors import InputError
from idic.fe import Mesh
from idic.images import AnyCamera, Camera, PlacedCamera, Scanner
from idic.model import Experiment


@dataclass(frozen=True, eq=False)
class View:
    """Projection of the motion of the nodes into the images of one camera or profilometer.

    Attributes
    ----------
    kind : "grey" | "height" | "section" | "space"
    camera : Camera
    axis : int
        Component of the displacement that is the height (2 for a solid and a sheet, 1 for a cross-section); -1 for grey
        images.
    rise : float
        Height in the images' unit per mm of that component: its sign times 1/height_unit; 0 for grey images; of a
        field, its sign along the normal of the points over their distance.
    later : Camera, optional
        The camera of the deformed frame, where it moves: see `at`.
    """

    kind: ViewKind
    camera: Camera
    axis: int = -1
    rise: float = 0.0
    later: Camera | None = None

    def at(self, frame: int) -> View:
        """The same for one frame, where the camera moves from frame to frame."""
        return self if self.camera.motion is None else replace(self, later=self.camera.at(frame))

    @property
    def moved_camera(self) -> Camera:
        """The camera of the deformed frame."""
        return self.camera if self.later is None else self.later

    @property
    def n_components(self) -> int:
        return 2 if self.kind == ViewKind.GREY else 3

    @property
    def is_affine(self) -> bool:
        """Whether `columns` depend on the fields alone, in all frames."""
        return self.camera.motion is None and self.camera.is_affine

    def points(self, nodes: np.ndarray) -> np.ndarray:
        """The points to project: of a cross-section x alone  # (n_nodes, dim) mm"""
        return nodes if self.kind != ViewKind.SECTION else nodes * [1.0, 0.0]

    def deformed(self, nodes: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Where the nodes are in the frame  # (n_nodes, dim) mm"""
        return nodes + u[:, :nodes.shape[1]]

    def motion(self, nodes: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Motion in the image (docs/method.md, equation 1.1)  # (n_nodes, dim) mm -> (n_nodes, n_components)"""
        still, moved = self.points(nodes), self.points(self.deformed(nodes, u))
        plane = self.moved_camera.project(moved) - self.camera.project(still)
        return plane if self.kind == ViewKind.GREY else np.column_stack([plane, self.rise * u[:, self.axis]])

    def columns(self, nodes: np.ndarray, u: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Nodal sensitivities in the image  # (n_nodes, dim, m) mm per unit -> (n_components n_nodes, m)"""
        return self.projected(self.jacobian(nodes, u), columns)

    def jacobian(self, nodes: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Derivative of the position in the frame by that of a deformed node  # (n_nodes, 2, 2) px/mm"""
        jacobian = self.moved_camera.jacobian(self.points(self.deformed(nodes, u)))
        # the height does not move in the image
        return jacobian * [1.0, 0.0] if self.kind == ViewKind.SECTION else jacobian

    def projected(self, jacobian: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """The same as `columns`; jacobian : of the frame, `jacobian`."""
        plane = jacobian[:, :, :1] * columns[:, None, 0] + jacobian[:, :, 1:] * columns[:, None, 1]
        if self.kind == ViewKind.GREY:
            return plane.reshape(2 * len(columns), -1)
        spatial = np.concatenate([plane, self.rise * in_space(columns)[:, self.axis:self.axis + 1]], axis=1)
        return spatial.reshape(3 * len(columns), -1)

    def camera_column(self, nodes: np.ndarray, u: np.ndarray, gradient: np.ndarray, name: str) -> np.ndarray:
        """Sensitivity to a camera parameter at fixed reference pixels  # (n_components n_nodes,)

        The parameter moves the material point X that a pixel shows by ``-J^-1 c``, and with it the height there
        (docs/method.md, equation 5.6).

        Parameters
        ----------
        gradient : array (n_nodes, dim, dim)
            Deformation gradient at the nodes.
        """
        points = self.points(nodes)
        if self.kind == ViewKind.GREY:
            return self.camera.fixed_pixel_sensitivity(points, u, gradient, name, self.later).ravel()
        plane_gradient = gradient[:, :2, :2]
        slope = np.zeros((len(nodes), 2))  # height per mm; the small one of a sheet is left out
        if self.axis < gradient.shape[1]:
            slope = self.rise * (gradient[:, self.axis, :2] - np.eye(3)[self.axis, :2])
        if self.kind == ViewKind.SECTION:
            slope = slope * [1.0, 0.0]
            plane_gradient = gradient[:, :1, :1] * [[1.0, 0.0], [0.0, 0.0]] + np.diag([0.0, 1.0])
        plane = self.camera.fixed_pixel_sensitivity(points, self.points(u), plane_gradient, name, self.later)
        if self.camera.motion is not None and name in self.camera.motion.names:
            return np.column_stack([plane, np.zeros(len(plane))]).ravel()
        carried = np.linalg.solve(self.camera.jacobian(points),
                                  self.camera.parameter_jacobian(points, name)[:, :, None])[:, :, 0]
        return np.column_stack([plane, -(slope * carried).sum(axis=1)]).ravel()


def view_of(experiment: Experiment, camera: AnyCamera) -> View | PinholeView | VolumeView:
    """The view of an experiment by one of its cameras.

    Raises
    ------
    InputError
        For height images of a plane mesh without the edge set that is seen.
    """
    model, recording = experiment.model, experiment.recording
    if isinstance(camera, Scanner):
        return VolumeView(camera)
    if isinstance(camera, PlacedCamera):
        return PinholeView(camera, model.mesh, model.surface)
    if recording.points is not None and recording.points.depth is not None:
        return View(ViewKind.SPACE, camera, 2, camera.normal_sign() / recording.points.pitch_mm)
    if recording.quantity in ("grey", "displacement"):
        return View(ViewKind.GREY, camera)
    if model.n_dim == 3:
        return View(ViewKind.HEIGHT, camera, 2, surface_sign(model.mesh, model.surface) / recording.height_unit)
    if model.surface is None:
        raise InputError("height images of a plane mesh in its own plane", file="experiment.toml",
                         key="experiment.quantity", expected="a solid with its face set, or a cross-section with its "
                         "edge set in `surface`", found=f"kind = {model.kind!r} without a surface",
                         remedy="name the set that is seen, or model the specimen as a solid")
    return View(ViewKind.SECTION, camera, 1, surface_sign(model.mesh, model.surface) / recording.height_unit)


def surface_sign(mesh: Mesh, surface: str) -> float:
    """+1 where the outward normal of a face (edge) set points along +z (+y of a cross-section), -1 where against it.

    Raises
    ------
    InputError
        If the set faces neither way: it stands upright.
    """
    corners = mesh.nodes[_corners(mesh, np.asarray(mesh.edge_sets[surface]))]  # (n_faces, 2 or 4, dim)
    if mesh.n_dim == 3:
        normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    else:
        along = corners[:, 1] - corners[:, 0]  # material on the left: outwards is to the right
        normal = np.stack([along[:, 1], -along[:, 0]], axis=1)
    total, size = float(normal[:, -1].sum()), float(np.linalg.norm(normal, axis=1).sum())
    if not abs(total) > 1e-6 * size:
        raise InputError("the surface does not face the camera", file="experiment.toml", key="experiment.surface",
                         expected="faces whose outward normal points up or down along the line of sight",
                         found=f"{surface}, which stands upright", remedy="name the face set that is seen")
    return float(np.sign(total))


def _corners(mesh: Mesh, faces: np.ndarray) -> np.ndarray:
    """Corner nodes of faces (n, 2), outward orientation: two of an edge, four of a face, of a triangle the last one
    twice  # (n, 2 or 4)"""
    n_corners = 4 if mesh.n_dim == 3 else 2
    corners = np.empty((len(faces), n_corners), dtype=np.int64)
    for block in mesh.blocks:
        inside = (faces[:, 0] >= block.first) & (faces[:, 0] < block.first + block.n_elements)
        for local in np.unique(faces[inside, 1]):
            selection = inside & (faces[:, 1] == local)
            nodes = list(block.kind.faces[local][:n_corners])
            nodes += nodes[-1:] * (n_corners - len(nodes))
            corners[selection] = block.connectivity[faces[selection, 0] - block.first][:, nodes]
    return corners
