"""Specimens of the trial as meshes of eight-node quadrilaterals, and the bricks of their real thickness.

    hole       strip with a central hole
    two_holes  two holes, one behind the other
    notches    round notches of both edges, not opposite to each other
    d_shape    one straight edge, one round one
    shear      two opposite notches; the right end moves across (Iosipescu)
    bending    a slender beam; the right end moves across
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from idic.fe import Mesh, make_mesh
from idic.virtual_tests import Patch, mesh_patches, strip_with_hole

Edge = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Specimen:
    """A kind of specimen.

    length, width (mm); along : direction of the grip's motion; grip : its size over that of a strip in tension;
    concentration : largest strain over grip motion by length, about
    """

    length: float
    width: float
    along: str
    grip: float
    concentration: float


MERGE_DISTANCE = 1e-7  # mm: nodes closer than this are one node
FINER_FROM_PX = 220  # columns from which meshes are twice as fine
SPECIMENS: Mapping[str, Specimen] = {
    "hole": Specimen(10.0, 6.0, "x", 1.0, 3.0),
    "two_holes": Specimen(14.0, 6.0, "x", 1.4, 3.0),
    "notches": Specimen(10.0, 6.0, "x", 1.0, 2.0),
    "d_shape": Specimen(10.0, 6.0, "x", 1.0, 1.5),
    "shear": Specimen(10.0, 6.0, "y", 1.5, 2.0),
    "bending": Specimen(12.0, 3.0, "y", 4.0, 0.75),
}


def is_fine(view) -> bool:
    """Whether images are so large that the user's mesh and the true one are twice as fine.

    view : `idic_studies.trial.scenes.scene.View`
    """
    return view.shape[1] >= FINER_FROM_PX


def specimen_mesh(geometry, divisions: Sequence[int], name: str) -> Mesh:
    """Node sets LEFT and RIGHT, element set `name`.

    Parameters
    ----------
    geometry : `idic_studies.trial.scenes.scene.Geometry`
    divisions : around an eighth of a hole, outwards from it, beside it
    """
    length, width, radius = geometry.length, geometry.width, geometry.radius
    around, outwards, along = divisions
    if geometry.kind == "hole":
        return strip_with_hole(length, width, radius, "quad8", around, outwards, along, name=name)
    if geometry.kind == "two_holes":
        half = strip_with_hole(0.5 * length, width, radius, "quad8", around, outwards, along, name=name)
        nodes = np.concatenate([half.nodes + [side * 0.25 * length, 0.0] for side in (-1.0, 1.0)])
        cells = np.concatenate([half.blocks[0].connectivity + k * half.n_nodes for k in range(2)])
        _, first, number = np.unique(np.round(nodes / MERGE_DISTANCE).astype(np.int64), axis=0, return_index=True,
                                     return_inverse=True)
        return _with_ends(nodes[first], number.ravel()[cells], length, name)
    bottom, top = _edges(geometry)

    def shape(s, t):
        x = length * (s - 0.5)
        return x, (1.0 - t) * bottom(x) + t * top(x)

    return _with_ends(*mesh_patches([Patch(shape, 4 * (around + along), 2 * outwards)], "quad8"), length, name)


def _edges(geometry) -> tuple[Edge, Edge]:
    """Bottom and top edge: y (mm) at x (mm)."""
    half, r = 0.5 * geometry.width, geometry.radius

    def notch(x: np.ndarray, at: float) -> np.ndarray:
        return r * np.exp(-((x - at) / r) ** 2)

    if geometry.kind == "notches":
        return lambda x: -half + notch(x, -0.8 * r), lambda x: half - notch(x, 0.8 * r)
    if geometry.kind == "shear":
        return lambda x: -half + notch(x, 0.0), lambda x: half - notch(x, 0.0)
    if geometry.kind == "d_shape":
        return lambda x: -half + 0.0 * x, lambda x: half - r + 2.0 * r * (0.25 - (x / geometry.length) ** 2)
    return lambda x: -half + 0.0 * x, lambda x: half + 0.0 * x


def _with_ends(nodes: np.ndarray, cells: np.ndarray, length: float, name: str) -> Mesh:
    ends = {"LEFT": np.flatnonzero(nodes[:, 0] < -length / 2 + MERGE_DISTANCE),
            "RIGHT": np.flatnonzero(nodes[:, 0] > length / 2 - MERGE_DISTANCE)}
    return make_mesh(nodes, [("quad8", cells)], node_sets=ends, element_sets={name: np.arange(len(cells))})


def bricks(flat: Mesh, depth: float) -> Mesh:
    """Twenty-node bricks behind a plane mesh: one layer of `depth` (mm), MIDDLE the plane of symmetry.

    The first nodes, with their labels, are those of the plane mesh: the surface that the camera sees.
    """
    quads, n = flat.blocks[0].connectivity, flat.n_nodes
    through = partners_of(flat)
    corners = np.unique(quads[:, :4])
    nodes = np.concatenate([np.column_stack([flat.nodes, np.full(n, depth)]),
                            np.column_stack([flat.nodes[corners], np.full(len(corners), 0.5 * depth)]),
                            np.column_stack([flat.nodes, np.zeros(n)])])
    front, half, back = through
    cells = np.hstack([back[quads[:, :4]], front[quads[:, :4]], back[quads[:, 4:]], front[quads[:, 4:]],
                       half[quads[:, :4]]])
    sets = {name: np.concatenate([plane[members][plane[members] >= 0] for plane in through])
            for name, members in flat.node_sets.items()}
    return make_mesh(nodes, [("hex20", cells)], node_sets=sets | {"MIDDLE": back},
                     element_sets={name: np.arange(len(cells)) for name in flat.element_sets})


def partners_of(flat: Mesh) -> list[np.ndarray]:
    """Number in the bricks of every plane node, on the surface, half-way and in the middle; -1 where there is none."""
    n, corners = flat.n_nodes, np.unique(flat.blocks[0].connectivity[:, :4])
    half = np.full(n, -1)
    half[corners] = n + np.arange(len(corners))
    return [np.arange(n), half, n + len(corners) + np.arange(n)]
