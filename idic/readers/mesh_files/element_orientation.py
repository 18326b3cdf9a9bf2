"""Elements whose nodes are numbered the wrong way round, turned where it is certain what is meant."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.fe import Mesh, cell_type

_MIRRORED_CORNERS = {"tri": (0, 2, 1), "quad": (0, 3, 2, 1), "tet": (0, 2, 1, 3), "hex": (0, 3, 2, 1, 4, 7, 6, 5)}

Cells = list[tuple[str, np.ndarray]]


def oriented(nodes: np.ndarray, cells: Cells, labels: np.ndarray, file: Path, notes: list[str]) -> Cells:
    """The cells with positive area (volume), as far as reversing their node order gives it.

    A clockwise element, a left-handed solid (MED) or a surface drawn the other way round (gmsh) is the same element in
    another numbering. A mesh that folds over itself has such elements, too: there two elements lie on the same side
    of a common edge (face) once all are turned, and nothing is certain.

    Parameters
    ----------
    nodes : (n, dim)
    cells : [(kind, connectivity)]
    labels : of the elements, in the order of `cells`
    notes : gets a note on what was turned

    Raises
    ------
    InputError
        The mesh folds over itself.
    """
    reversed_masks = [_is_reversed(nodes, kind, connectivity) for kind, connectivity in cells]
    number, total = sum(int(mask.sum()) for mask in reversed_masks), len(labels)
    if number == 0:
        return cells
    turned_cells = []
    for (kind, connectivity), mask in zip(cells, reversed_masks, strict=True):
        turned = connectivity.copy()
        turned[mask] = connectivity[mask][:, list(mirrored(kind))]
        turned_cells.append((kind, turned))
    if number < total:
        _check_sides(turned_cells, labels, file)
    way = "clockwise" if nodes.shape[1] == 2 else "left-handed (the top face first)"
    subject = "all elements are" if number == total else f"{number} of {total} elements are"
    notes.append(f"{file.name}: {subject} numbered {way}; their node order was reversed")
    return turned_cells


def turned_around(mesh: Mesh) -> Mesh:
    """The plane mesh with the reversed node order in every element; sets keep their meaning."""
    blocks = tuple(replace(b, connectivity=np.ascontiguousarray(b.connectivity[:, list(mirrored(b.cell))]))
                   for b in mesh.blocks)
    edge_sets = {}
    for name, faces in mesh.edge_sets.items():
        corners = np.array([mesh.block_of(int(e)).kind.n_corners for e, _ in faces])
        edge_sets[name] = np.column_stack([faces[:, 0], corners - 1 - faces[:, 1]])  # edge k: corners k, k + 1
    return replace(mesh, blocks=blocks, edge_sets=edge_sets)


def mirrored(kind: str) -> tuple[int, ...]:
    """The order of the nodes of a cell in a mirrored one: the same edges, with the same mid-side nodes on them."""
    cell = cell_type(kind)
    corners = _MIRRORED_CORNERS[kind.rstrip("0123456789")]
    if cell.n_nodes == cell.n_corners:
        return corners
    edges = [set(edge) for edge in cell_type(kind).edges]
    return (*corners, *(cell.n_corners + edges.index({corners[a], corners[b]}) for a, b in cell_type(kind).edges))


def _is_reversed(nodes: np.ndarray, kind: str, connectivity: np.ndarray) -> np.ndarray:
    """Whether the area (volume) of an element is negative everywhere  # (n_elements,)"""
    cell = cell_type(kind)
    points = np.concatenate([cell_type(kind).quadrature_rule()[0], cell.reference_nodes[:cell.n_corners]])
    with np.errstate(over="ignore", invalid="ignore"):  # infinite areas are refused later by `check_elements`
        jacobians = np.einsum("eai,qaj->eqij", nodes[connectivity], cell_type(kind).shape_gradients(points))
        return (np.linalg.det(jacobians) < 0.0).all(axis=1)


def _check_sides(cells: Cells, labels: np.ndarray, file: Path) -> None:
    """InputError where two elements walk along a common edge (face) in the same direction."""
    owners: dict[tuple[int, ...], int] = {}
    for element, face in _walked_faces(cells):
        first = owners.setdefault(face, element)
        if first != element:
            pair = sorted((labels[first], labels[element]))
            raise InputError("the mesh folds over itself", file=file, key="mesh",
                             expected="elements on the two sides of every common edge (face)",
                             found=f"elements {pair[0]} and {pair[1]} on the same side",
                             remedy="move the nodes that lie beyond their neighbours, or generate the mesh again")


def _walked_faces(cells: Cells) -> Iterator[tuple[int, tuple[int, ...]]]:
    """Element index, and the corners of each of its faces in walking order, the lowest first."""
    start = 0
    for kind, connectivity in cells:
        corners = cell_type(kind).n_face_corners
        for local in cell_type(kind).faces:
            rows = connectivity[:, list(local[:corners])]
            if corners > 2:  # a closed walk begins anywhere
                shift = rows.argmin(axis=1)[:, None]
                rows = np.take_along_axis(rows, (np.arange(corners) + shift) % corners, axis=1)
            for element, walk in enumerate(rows.tolist(), start):
                yield element, tuple(walk)
        start += len(connectivity)
