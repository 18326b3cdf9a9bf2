"""A mesh in memory as the mesh readers give that of a file: of meshio, of idic itself, or a path."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from idic.errors import InputError
from idic.fe import Mesh
from idic.readers.foreign_mesh import check_indices
from idic.readers.meshes import raw_mesh_of, read_mesh_file
from idic.readers.mesh_files.raw_mesh import RawMesh

KEY, MESH_IN_MEMORY = "mesh", Path("mesh")  # in messages


def mesh_of(mesh: Any) -> RawMesh:
    """The cells and sets of a mesh.

    Parameters
    ----------
    mesh : meshio.Mesh, the Mesh of an experiment (lengths in mm), or a path

    Raises
    ------
    InputError
        Another object; elements or sets that refer to missing nodes or cells.
    """
    if isinstance(mesh, (str, os.PathLike)):
        path = Path(mesh)
        if not path.is_file():
            raise InputError("no such file", key=KEY, expected="a mesh file", found=str(path),
                             remedy="correct the path of the mesh")
        return read_mesh_file(path)
    if isinstance(mesh, Mesh):
        return _of_own(mesh)
    if isinstance(mesh, meshio.Mesh):
        try:
            check_indices(mesh)
        except ValueError as problem:
            raise InputError("the mesh cannot be used", key=KEY, expected="nodes, and elements that refer to them",
                             found=str(problem), remedy="generate the mesh again") from None
        return raw_mesh_of(mesh, MESH_IN_MEMORY)
    raise InputError("not a mesh", key=KEY,
                     expected='a meshio.Mesh, a path, or {"roi_px": [x0, y0, x1, y1], "element_px": 20}',
                     found=type(mesh).__name__, remedy="convert the mesh, e.g. with meshio.Mesh(points, cells)")


def _of_own(mesh: Mesh) -> RawMesh:
    nodes = np.zeros((mesh.n_nodes, 3))
    nodes[:, :mesh.n_dim] = mesh.nodes
    cells = [(block.cell, block.connectivity, mesh.element_labels[block.first:block.first + block.n_elements])
             for block in mesh.blocks]
    faces = {name: [_corners(mesh, int(e), int(k)) for e, k in entries] for name, entries in mesh.edge_sets.items()}
    return RawMesh(MESH_IN_MEMORY, nodes, mesh.node_labels, cells, dict(mesh.node_sets), dict(mesh.element_sets), faces)


def _corners(mesh: Mesh, e: int, k: int) -> tuple[int, ...]:
    """Corner nodes of edge (face) `k` of element `e`."""
    block = mesh.block_of(e)
    local = block.kind.faces[k][:block.kind.n_face_corners]
    return tuple(int(node) for node in block.connectivity[e - block.first, list(local)])
