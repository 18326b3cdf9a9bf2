"""Reads mesh files: input decks, msh of gmsh and MED by `mesh_files`; VTU and other formats by meshio."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from idic.errors import InputError
from idic.readers.formats.format import MESH, Format
from idic.readers.mesh_files.abaqus import read_inp
from idic.readers.mesh_files.gmsh_msh import VERSIONS as GMSH_VERSIONS, gmsh_version, read_msh
from idic.readers.mesh_files.med import SUFFIX as MED_SUFFIX, read_med
from idic.readers.mesh_files.nastran import SUFFIXES as NASTRAN_SUFFIXES, read_nastran
from idic.readers.mesh_files.raw_mesh import RawMesh

if TYPE_CHECKING:
    import meshio  # loaded for other formats than inp

_KINDS = {"vertex": "point", "line": "line2", "line3": "line3", "triangle": "tri3", "triangle6": "tri6",
          "quad": "quad4", "quad8": "quad8",
          "quad9": "quad9", "hexahedron": "hex8", "hexahedron20": "hex20", "hexahedron27": "hex27", "tetra": "tet4",
          "tetra10": "tet10",
          "wedge": "wedge6", "wedge15": "wedge15", "pyramid": "pyramid5"}
FORMATS = (
    Format(MESH, "Abaqus, CalculiX", (".inp",), "", "sets, surfaces", "mesh_unit",
           "of CalculiX 2.20; made"),
    Format(MESH, "Nastran, gmsh, MED, VTU, XDMF and others", (".bdf", ".msh", ".med", ".vtu", ".vtk", ".xdmf"),
           "meshio", "groups", "mesh_unit", "of gmsh 4.15, meshio"),
)
_MAX_SETS_OF_ARRAY = 64  # an integer array with more different values is a result and defines no sets


def mesh_suffixes() -> tuple[str, ...]:
    """Those of the files that may be meshes."""
    import meshio

    return tuple(sorted({".inp", *meshio.extension_to_filetypes}))


def read_mesh_file(path: Path) -> RawMesh:
    """The cells and sets of a mesh file.

    gmsh: physical groups are sets (``physical_7`` where they have no name). MED (Salome): groups are sets. VTU: an
    integer array of 0 and 1 is the set of that name, other integer arrays give ``NAME_value``. Nastran: the elements of
    property 7 are ``property_7``.

    Raises
    ------
    InputError
        The format is unknown, or the file is unreadable.
    """
    if path.suffix.lower() == ".inp":
        return read_inp(path)
    if path.suffix.lower() in NASTRAN_SUFFIXES:
        return read_nastran(path)
    if path.suffix.lower() == MED_SUFFIX:
        return read_med(path)
    if path.suffix.lower() not in mesh_suffixes():
        raise InputError("not a mesh format that idic reads", file=path, key="mesh",
                         expected=".inp (Abaqus, CalculiX), .bdf (Nastran), .msh (gmsh), .med, .vtu or others",
                         found=path.suffix or "no suffix", remedy="export the mesh in one of these")
    if path.suffix.lower() == ".msh" and gmsh_version(path) in GMSH_VERSIONS:
        return read_msh(path)
    from idic.readers.foreign_mesh import read_by_meshio

    return raw_mesh_of(read_by_meshio(path), path)


def raw_mesh_of(mesh: meshio.Mesh, path: Path) -> RawMesh:
    """The cells and sets of a mesh that meshio has read or a program has made.

    path : names the mesh in messages

    Raises
    ------
    InputError
        An element type is unknown.
    """
    unknown = sorted({block.type for block in mesh.cells} - set(_KINDS))
    if unknown:
        raise InputError("an element type that idic does not know", file=path, key="mesh", expected=", ".join(_KINDS),
                         found=", ".join(unknown),
                         remedy="mesh the specimen with one of these types")
    nodes = np.zeros((len(mesh.points), 3))
    nodes[:, :mesh.points.shape[1]] = mesh.points
    node_labels = np.arange(1, len(nodes) + 1)
    element_labels = np.arange(1, sum(len(block.data) for block in mesh.cells) + 1)
    cells, starts, start = [], [], 0
    for block in mesh.cells:
        starts.append(start)
        cells.append((_KINDS[block.type], np.asarray(block.data, dtype=np.int64),
                      element_labels[start:start + len(block.data)]))
        start += len(block.data)
    raw = RawMesh(path, nodes, node_labels, cells)
    raw.node_sets |= {name: np.unique(np.asarray(ids, dtype=np.int64)) for name, ids in mesh.point_sets.items()}
    for name, parts in mesh.cell_sets.items():
        if not name.startswith("gmsh:"):
            _add(raw.element_sets, name, [np.asarray(ids, dtype=np.int64) + s for ids,
                                          s in zip(parts, starts, strict=True) if ids is not None])
    _gmsh_groups(mesh, starts, raw)
    _array_sets(mesh, raw)
    return raw


def _add(sets: dict[str, np.ndarray], name: str, parts: list[np.ndarray]) -> None:
    ids = np.unique(np.concatenate([sets.get(name, np.zeros(0, np.int64)), *parts])).astype(np.int64)
    if len(ids):
        sets[name] = ids


def _gmsh_groups(mesh: meshio.Mesh, starts: list[int], raw: RawMesh) -> None:
    if "gmsh:physical" not in mesh.cell_data:
        return
    names = {(int(tag), int(dim)): name for name, (tag, dim) in mesh.field_data.items()}
    for block, start, tags in zip(mesh.cells, starts, mesh.cell_data["gmsh:physical"], strict=True):
        for tag in np.unique(tags):
            if tag != 0:
                name = names.get((int(tag), block.dim), f"physical_{tag}")
                _add(raw.element_sets, name, [np.flatnonzero(tags == tag) + start])


def _array_sets(mesh: meshio.Mesh, raw: RawMesh) -> None:
    for name, values in mesh.point_data.items():
        for label, inside in _labelled(name, np.asarray(values)):
            _add(raw.node_sets, label, [np.flatnonzero(inside)])
    for name, parts in mesh.cell_data.items():
        values = np.concatenate([np.asarray(part) for part in parts])
        for label, inside in _labelled(name, values):
            _add(raw.element_sets, label, [np.flatnonzero(inside)])


def _labelled(name: str, values: np.ndarray) -> list[tuple[str, np.ndarray]]:
    if name.startswith("gmsh:") or name.lower().startswith("vtk") or values.ndim != 1 or values.dtype.kind not in "iub":
        return []
    labels = np.unique(values)
    if set(labels.tolist()) <= {0, 1}:
        return [(name, values == 1)]
    return [(f"{name}_{value}", values == value) for value in labels] if len(labels) <= _MAX_SETS_OF_ARRAY else []
