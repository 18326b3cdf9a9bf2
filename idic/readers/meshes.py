"""Reads mesh files: inp of Abaqus and CalculiX by `readers.abaqus`; gmsh msh, VTU and other formats by meshio."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from idic.errors import InputError
from idic.readers.abaqus import read_inp
from idic.readers.formats.format import MESH, Format
from idic.readers.raw_mesh import RawMesh

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
_PROPERTIES = "nastran:ref"  # what meshio calls the property of an element
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
    if path.suffix.lower() not in mesh_suffixes():
        raise InputError("not a mesh format that idic reads", file=path, key="mesh",
                         expected=".inp (Abaqus, CalculiX), .bdf (Nastran), .msh (gmsh), .med, .vtu or others",
                         found=path.suffix or "no suffix", remedy="export the mesh in one of these")
    from idic.readers.foreign_mesh import read_by_meshio

    return raw_mesh_of(read_by_meshio(path), path)


def raw_mesh_of(mesh: meshio.Mesh, path: Path) -> RawMesh:
    """The cells and sets of a mesh that meshio has read or a program has made.

    path : names the mesh in messages; the numbers of nodes and elements are taken from an ASCII msh file of that name

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
    node_labels, element_labels = _gmsh_labels(path) if path.suffix.lower() == ".msh" else (None, None)
    n_cells = sum(len(block.data) for block in mesh.cells)
    if node_labels is None or len(node_labels) != len(nodes):
        node_labels = np.arange(1, len(nodes) + 1)
    if element_labels is None or len(element_labels) != n_cells:
        element_labels = np.arange(1, n_cells + 1)
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
    named = _med_groups(mesh, starts, raw)
    _array_sets(mesh, starts, raw, named)
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


def _med_groups(mesh: meshio.Mesh, starts: list[int], raw: RawMesh) -> tuple[str, ...]:
    """The groups of a MED file: a family is the nodes or elements that are in the same groups. Returns the arrays that
    hold the numbers of families, where any has a name."""
    points, cells = getattr(mesh, "point_tags", {}), getattr(mesh, "cell_tags", {})
    if "point_tags" in mesh.point_data:
        families = np.asarray(mesh.point_data["point_tags"])
        for family, names in points.items():
            for name in names:
                _add(raw.node_sets, name, [np.flatnonzero(families == family)])
    for start, values in zip(starts, mesh.cell_data.get("cell_tags", ()), strict=False):
        for family, names in cells.items():
            for name in names:
                _add(raw.element_sets, name, [np.flatnonzero(np.asarray(values) == family) + start])
    return (*(["point_tags"] if points else []), *(["cell_tags"] if cells else []))


def _array_sets(mesh: meshio.Mesh, starts: list[int], raw: RawMesh, named: tuple[str, ...]) -> None:
    for name, values in mesh.point_data.items():
        for label, inside in [] if name in named else _labelled(name, np.asarray(values)):
            _add(raw.node_sets, label, [np.flatnonzero(inside)])
    for name, parts in mesh.cell_data.items():
        if name in named:
            continue
        values = np.concatenate([np.asarray(part) for part in parts])
        for label, inside in _labelled(name, values):
            _add(raw.element_sets, label, [np.flatnonzero(inside)])


def _labelled(name: str, values: np.ndarray) -> list[tuple[str, np.ndarray]]:
    if name.startswith("gmsh:") or name.lower().startswith("vtk") or values.ndim != 1 or values.dtype.kind not in "iub":
        return []
    labels = np.unique(values)
    if name == _PROPERTIES:
        return [(f"property_{value}", values == value) for value in labels]
    if set(labels.tolist()) <= {0, 1}:
        return [(name, values == 1)]
    return [(f"{name}_{value}", values == value) for value in labels] if len(labels) <= _MAX_SETS_OF_ARRAY else []


def _gmsh_labels(path: Path) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Node and element tags of an ASCII msh file, in file order; None if unavailable (meshio drops them)."""
    try:
        return _ascii_labels(path.read_text(encoding="ascii").split("\n"))
    except (UnicodeDecodeError, ValueError, IndexError, OverflowError):  # meshio reads more than this
        return None, None


def _ascii_labels(lines: list[str]) -> tuple[np.ndarray | None, np.ndarray | None]:
    version, binary = lines[lines.index("$MeshFormat") + 1].split()[:2]
    nodes = lines[lines.index("$Nodes") + 1:lines.index("$EndNodes")]
    elements = lines[lines.index("$Elements") + 1:lines.index("$EndElements")]
    if binary != "0":
        return None, None
    if version.startswith("2"):
        return (np.array([int(line.split()[0]) for line in nodes[1:] if line.strip()], dtype=np.int64),
                np.array([int(line.split()[0]) for line in elements[1:] if line.strip()], dtype=np.int64))
    if not version.startswith("4.1"):
        return None, None
    node_tags, element_tags, k = [], [], 1
    while k < len(nodes) and nodes[k].strip():
        n = int(nodes[k].split()[3])
        node_tags += [int(line) for line in nodes[k + 1:k + 1 + n]]
        k += 1 + 2 * n
    k = 1
    while k < len(elements) and elements[k].strip():
        n = int(elements[k].split()[3])
        element_tags += [int(line.split()[0]) for line in elements[k + 1:k + 1 + n]]
        k += 1 + n
    return np.array(node_tags, dtype=np.int64), np.array(element_tags, dtype=np.int64)
