"""A solid of a drawn outline and a thickness: the plane mesh, repeated through the thickness.

The seen face is FRONT, at z = 0; the body lies behind it, BACK on its far side. Every set of the outline goes through
the thickness. Squares become bricks; where there are triangles, all become tetrahedra, whose diagonals match.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.fe import Mesh, make_mesh

FRONT, BACK = "FRONT", "BACK"
_PRISM = ((0, 1, 2, 5), (0, 1, 4, 5), (0, 3, 4, 5))  # tetrahedra of a prism whose first corners have rising numbers


@dataclass(frozen=True)
class _Layers:
    """n : nodes of the plane mesh; number : of layers of elements; front : number of the layer of nodes that is seen"""

    n: int
    number: int
    front: int

    def through(self, nodes: np.ndarray) -> np.ndarray:
        """Nodes of the plane mesh, in every layer."""
        return np.unique(np.add.outer(self.n * np.arange(self.number + 1), nodes))


def extruded(plane: Mesh, thickness_mm: float, layers: int, towards_camera: int) -> Mesh:
    """The solid.

    Parameters
    ----------
    plane : mesh of linear triangles and quadrilaterals, mm
    thickness_mm : along z
    layers : of elements through it
    towards_camera : +1 where z points to the camera, so that the body lies at z < 0, else -1
    """
    front = layers if towards_camera > 0 else 0
    stack = _Layers(plane.n_nodes, layers, front)
    z = thickness_mm * (np.arange(layers + 1) - front) / layers
    nodes = np.column_stack([np.tile(plane.nodes, (layers + 1, 1)), np.repeat(z, plane.n_nodes)])
    triangles = [block.connectivity for block in plane.blocks if block.cell == "tri3"]
    owners: list[np.ndarray]
    if triangles:
        cell, cells, owners = "tet4", *_tetrahedra(plane, nodes, stack)
    else:
        cell, cells, owners = "hex8", *_bricks(plane, stack)
    solid = make_mesh(nodes, [(cell, np.concatenate(cells))])
    owner = np.concatenate(owners)
    return make_mesh(
        nodes, [(cell, solid.blocks[0].connectivity)],
        node_sets={name: stack.through(np.asarray(index)) for name, index in plane.node_sets.items()},
        element_sets={name: np.flatnonzero(np.isin(owner, index)) for name, index in plane.element_sets.items()},
        edge_sets=_faces(plane, solid, stack))


def _bricks(plane: Mesh, stack: _Layers) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Connectivity of the bricks of every layer, and the plane elements that they stand on."""
    quads = np.concatenate([block.connectivity for block in plane.blocks])
    parts = [np.hstack([quads + k * stack.n, quads + (k + 1) * stack.n]) for k in range(stack.number)]
    return parts, [np.arange(len(quads))] * stack.number


def _tetrahedra(plane: Mesh, nodes: np.ndarray, stack: _Layers) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """The same of tetrahedra: prisms over triangles with rising node numbers are cut alike on both sides of a face."""
    triangles, owners = [], []
    for block in plane.blocks:
        conn, number = block.connectivity, block.first + np.arange(block.n_elements)
        if block.cell == "quad4":  # cut from its node of the lowest number
            turned = np.array([np.roll(row, -int(np.argmin(row))) for row in conn])
            conn, number = np.vstack([turned[:, [0, 1, 2]], turned[:, [0, 2, 3]]]), np.tile(number, 2)
        triangles.append(np.sort(conn, axis=1))
        owners.append(number)
    corners, owner = np.concatenate(triangles), np.concatenate(owners)
    parts = []
    for k in range(stack.number):
        prism = np.hstack([corners + k * stack.n, corners + (k + 1) * stack.n])
        parts += [_outwards(prism[:, list(tet)], nodes) for tet in _PRISM]
    return parts, [owner] * len(parts)


def _outwards(tets: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """With positive volumes."""
    sides = nodes[tets[:, 1:]] - nodes[tets[:, :1]]
    negative = np.linalg.det(sides) < 0.0
    return np.where(negative[:, None], tets[:, [0, 2, 1, 3]], tets)


def _faces(plane: Mesh, solid: Mesh, stack: _Layers) -> dict[str, np.ndarray]:
    """FRONT, BACK and the edge sets of the plane mesh as sets of faces."""
    block = solid.blocks[0]
    local = block.kind.faces
    element = np.repeat(np.arange(block.n_elements), len(local))
    faces = np.column_stack([element, np.tile(np.arange(len(local)), block.n_elements)])
    corners = np.stack([block.connectivity[:, list(face)] for face in local], axis=1).reshape(len(faces), -1)
    layer, place = corners // stack.n, corners % stack.n
    back = stack.number - stack.front
    sets = {FRONT: faces[(layer == stack.front).all(axis=1)], BACK: faces[(layer == back).all(axis=1)]}
    upright = (np.ptp(layer, axis=1) == 1) & np.array([len(set(row)) == 2 for row in place.tolist()])
    ends = np.sort(np.column_stack([place.min(axis=1), place.max(axis=1)]), axis=1)
    key = ends[:, 0] * stack.n + ends[:, 1]
    for name, edges in plane.edge_sets.items():
        pairs = np.array([sorted(plane.face_nodes(edge)[:2]) for edge in edges]).reshape(-1, 2)
        sets[name] = faces[upright & np.isin(key, pairs[:, 0] * stack.n + pairs[:, 1])]
    return sets
