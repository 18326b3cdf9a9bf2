"""The mesh of a drawing: an outline with holes, in px of the reference image or in mm of the mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from idic.errors import InputError
from idic.fe import Mesh, Segments, fill, mesh_polygon
from idic.images import AnyCamera
from idic.readers.gmsh_mesher import fill_with_gmsh
from idic.readers.mesh_files.element_orientation import turned_around

MESHERS = {"idic": fill, "gmsh": fill_with_gmsh}


@dataclass(frozen=True)
class Drawing:
    """Outline, holes and element size as in `idic.fe.mesh.polygon.mesh_polygon`.

    Attributes
    ----------
    edge_names : {name: numbers of segments of the outline, from 1}
    mesher : "idic" or "gmsh"
    """

    outline: Sequence
    holes: Sequence
    size: float
    quads: bool = True
    edge_names: Mapping[str, Sequence[int]] = field(default_factory=dict)
    mesher: str = "idic"

    def mesh(self, file=None, key: str = "experiment.mesh") -> Mesh:
        """The mesh in the unit of the drawing.

        Raises
        ------
        InputError
            With file and key: the drawing or the element size cannot be meshed.
        """
        try:
            return mesh_polygon(self.outline, self.holes, self.size, quads=self.quads, names=self.edge_names,
                                mesher=MESHERS[self.mesher])
        except InputError as error:
            raise InputError(error.what, file=file, key=key if error.key is None else f"{key}.edge_names.{error.key}",
                             expected=error.expected, found=error.found, remedy=error.remedy) from None

    def on_arcs(self, mesh: Mesh, camera: AnyCamera | None = None) -> Mesh:
        """The quadratic mesh in mm with the mid-side nodes of the boundary on the arcs; `camera`: of a drawing in
        px."""
        segments = Segments.of(self.outline, self.holes)
        if camera is None:
            return segments.on_arcs(mesh)
        drawn = replace(mesh, nodes=camera.project(mesh.nodes))
        followed = segments.on_arcs(drawn)
        moved = (followed.nodes != drawn.nodes).any(axis=1)
        nodes = mesh.nodes.copy()
        nodes[moved] = camera.inverse(followed.nodes[moved])
        return replace(mesh, nodes=nodes)


def from_image(mesh: Mesh, camera: AnyCamera) -> Mesh:
    """A mesh in px of the image (rows count downwards) as a mesh in mm, counter-clockwise."""
    nodes = camera.inverse(mesh.nodes)
    if np.linalg.det(camera.jacobian(nodes[:1])[0, :, :2]) > 0:
        return replace(mesh, nodes=nodes)
    return turned_around(replace(mesh, nodes=nodes))  # y of the mesh points up in the image
