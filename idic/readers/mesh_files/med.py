"""Reads the mesh of a MED file (Salome, Code_Aster): nodes, cells and groups.

meshio is no substitute: it refuses families without a group, which gmsh and MEDCoupling write. Layout: MED file format
3 and 4 in HDF5; values of one component stand side by side, numbers count from 1.
"""

from __future__ import annotations

from collections import defaultdict
from itertools import pairwise
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.readers.containers.references import refuse_references
from idic.readers.mesh_files.raw_mesh import RawMesh

SUFFIX = ".med"
_CELLS = {"PO1": ("point", 1), "SE2": ("line2", 2), "SE3": ("line3", 3), "TR3": ("tri3", 3), "TR6": ("tri6", 6),
          "QU4": ("quad4", 4), "QU8": ("quad8", 8), "QU9": ("quad9", 9), "TE4": ("tet4", 4), "T10": ("tet10", 10),
          "HE8": ("hex8", 8), "H20": ("hex20", 20), "H27": ("hex27", 27), "PE6": ("wedge6", 6), "P15": ("wedge15", 15),
          "P18": ("wedge18", 18), "PY5": ("pyramid5", 5), "P13": ("pyramid13", 13)}


def read_med(path: Path) -> RawMesh:
    """The cells and groups of a MED file with one mesh; of several steps of it, the first.

    Raises
    ------
    InputError
        The file is no MED file, holds several meshes, or cells that idic does not know.
    """
    import h5py

    refuse_references(path, "mesh")
    try:
        with h5py.File(path, "r") as file:
            return _mesh(path, file)
    except (OSError, KeyError, ValueError, TypeError, IndexError, AttributeError, RuntimeError) as problem:
        raise InputError("the mesh cannot be read", file=path, key="mesh", expected="a MED file of version 3 or 4",
                         found=f"{type(problem).__name__}: {problem}",
                         remedy="save the mesh again, or export it as .msh or .vtu") from None


def _mesh(path: Path, file) -> RawMesh:
    names = list(file["ENS_MAA"])
    if len(names) != 1:
        raise InputError("a MED file with several meshes", file=path, key="mesh", expected="one mesh",
                         found=", ".join(names) or "none", remedy="save the mesh of the specimen alone")
    mesh = file["ENS_MAA"][names[0]]
    dimension = int(mesh.attrs["ESP"])
    step = mesh if "NOE" in mesh else mesh[min(mesh)]
    coordinates = step["NOE"]["COO"]
    number = int(coordinates.attrs["NBR"])
    nodes = np.zeros((number, 3))
    nodes[:, :dimension] = coordinates[()].reshape(number, dimension, order="F")
    families = mesh["FAS"] if "FAS" in mesh else file["FAS"][names[0]] if "FAS" in file else {}
    raw = RawMesh(path, nodes, _labels(step["NOE"], number))
    raw.node_sets |= _sets(_groups(families, "NOEUD"), [_families(step["NOE"], number)])
    of_elements, labels = [], []
    for name, block in step["MAI"].items():
        if name not in _CELLS:
            raise InputError("an element type that idic does not know", file=path, key="mesh", found=name,
                             expected=", ".join(_CELLS), remedy="mesh the specimen with one of these types")
        cell, width = _CELLS[name]
        rows = int(block["NOD"].attrs["NBR"])
        connectivity = block["NOD"][()].reshape(rows, width, order="F").astype(np.int64) - 1
        if connectivity.size and not 0 <= connectivity.min() <= connectivity.max() < number:
            raise ValueError(f"{name} elements refer to nodes beyond the {number} that the file holds")
        raw.cells.append((cell, connectivity, np.zeros(rows, dtype=np.int64)))
        labels.append(_labels(block, rows))
        of_elements.append(_families(block, rows))
    if not sum(len(part) for part in labels):
        raise ValueError("the file holds no elements")
    raw.cells = [(cell, rows, part) for (cell, rows, _), part in zip(raw.cells, _distinct(labels), strict=True)]
    raw.element_sets |= _sets(_groups(families, "ELEME"), of_elements)
    return raw


def _labels(block, number: int) -> np.ndarray:
    """The numbers of nodes or cells, where the file gives them  # (number,)"""
    values = block["NUM"][()].astype(np.int64) if "NUM" in block else np.zeros(0, np.int64)
    return values if len(np.unique(values)) == number else np.arange(1, number + 1)


def _distinct(labels: list[np.ndarray]) -> list[np.ndarray]:
    """Numbers of cells, counted through where each kind of cell is counted from 1."""
    joined = np.concatenate(labels)
    if len(np.unique(joined)) == len(joined):
        return labels
    starts = np.concatenate([[0], np.cumsum([len(part) for part in labels])])
    return [np.arange(start + 1, end + 1) for start, end in pairwise(starts)]


def _families(block, number: int) -> np.ndarray:
    """The family of each node or cell; 0: in no group  # (number,)"""
    return block["FAM"][()].astype(np.int64) if "FAM" in block else np.zeros(number, dtype=np.int64)


def _groups(families, kind: str) -> dict[int, list[str]]:
    """{number of a family: its groups}; a family is the nodes or cells that are in the same groups."""
    groups = {}
    for family in (families[kind].values() if kind in families else ()):
        names = family["GRO"]["NOM"][()] if "GRO" in family else ()
        groups[int(family.attrs["NUM"])] = [bytes(np.asarray(name, dtype=np.int8).tobytes()).split(b"\0")[0]
                                            .decode("utf-8", errors="replace").strip() for name in names]
    return groups


def _sets(groups: dict[int, list[str]], families: list[np.ndarray]) -> dict[str, np.ndarray]:
    numbers, members = np.concatenate([*families, np.zeros(0, np.int64)]), defaultdict(list)
    for family, names in groups.items():
        for name in names:
            members[name].append(np.flatnonzero(numbers == family))
    sets = {name: np.unique(np.concatenate(parts)) for name, parts in members.items()}
    return {name: ids for name, ids in sets.items() if len(ids)}
