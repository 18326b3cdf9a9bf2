"""Meshes of drawn regions: the area of the drawing, nodes on its arcs, angles, sets, and the drawings that are
refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from idic.errors import InputError
from idic.fe import Segments, mesh_polygon, raise_order
from idic.readers import Drawing, has_gmsh

STRIP = [[0, 0], [40, 0], [40, 100], [0, 100]]
DOG_BONE = [[0, 0], [30, 0], [30, 20], [26, 25, 24, 32], [24, 60], [26, 67, 30, 72], [30, 90], [0, 90], [0, 72],
            [4, 67, 6, 60], [6, 32], [4, 25, 0, 20]]
NOTCHED = [[0, 0], [40, 0], [40, 28], [38, 30, 40, 32], [40, 60], [0, 60], [0, 32], [2, 30, 0, 28]]
TRIANGLE = [[15, 40], [25, 40], [20, 48]]
# drawing, holes, element size
CASES = {
    "strip with a hole": (STRIP, [[20, 50, 6]], 4), "dog bone": (DOG_BONE, [], 2.5),
    "notches, a triangle and a small hole": (NOTCHED, [TRIANGLE, [12, 15, 1]], 3),
    "disc": ([0, 0, 20], [[12, 0, 6]], 3), "half circle": ([[-10, 0], [0, -10, 10, 0]], [], 2),
    "two holes with a narrow ligament": (STRIP, [[12, 50, 7], [28, 50, 7]], 4),
}
MESHERS = ["idic", pytest.param("gmsh", marks=pytest.mark.skipif(not has_gmsh(), reason="gmsh is not installed"))]


def area(mesh):
    total = 0.0
    for block in mesh.blocks:
        xi, weights = block.kind.quadrature_rule()
        jac = np.einsum("eak,qai->eqki", mesh.nodes[block.connectivity], block.kind.shape_gradients(xi))
        total += np.sum(np.linalg.det(jac) * weights)
    return total


@pytest.mark.parametrize("mesher", MESHERS)
@pytest.mark.parametrize("quads", [False, True])
@pytest.mark.parametrize("case", CASES)
def test_the_elements_fill_the_drawing_with_sound_angles(case, quads, mesher):
    outline, holes, size = CASES[case]
    mesh = Drawing(outline, holes, size, quads, mesher=mesher).mesh()
    mesh.check_elements()
    raised = Segments.of(outline, holes).on_arcs(raise_order(mesh))
    raised.check_elements()
    # parabolas through three points of an arc of 45 degrees: the area of the circle to 2e-4
    assert area(raised) == pytest.approx(Segments.of(outline, holes).area(), rel=1e-3)
    # the refinement aims at 28 degrees, smoothing may take some away; gmsh promises none: 20 is what FE codes warn at
    assert mesh.smallest_angle > (25.0 if mesher == "idic" else 20.0)
    assert len(mesh.boundary_edges()) == 1 + len(holes)
    lengths = np.hypot(*np.diff(mesh.nodes[[mesh.face_nodes(f)[:2] for f in mesh.boundary_faces()]], axis=1)[:, 0].T)
    assert lengths.max() < 1.5 * size + 1e-9  # segments are divided evenly


def test_without_arcs_the_area_is_that_of_the_polygon_to_rounding():
    mesh = mesh_polygon(NOTCHED[:3] + [[38, 30]] + [NOTCHED[4]] + [[0, 60]], [TRIANGLE], 3.0)
    assert area(mesh) == pytest.approx(Segments.of(NOTCHED[:3] + [[38, 30], [40, 60], [0, 60]], [TRIANGLE]).area(),
                                       rel=1e-12)


@pytest.mark.parametrize("quads", [False, True])
def test_nodes_lie_on_the_arcs_mid_side_nodes_included(quads):
    mesh = mesh_polygon(STRIP, [[20, 50, 6]], 4.0, quads=quads)
    for body in (mesh, Segments.of(STRIP, [[20, 50, 6]]).on_arcs(raise_order(mesh))):
        rim = body.nodes[np.unique([n for face in body.edge_sets["HOLE1"] for n in body.face_nodes(face)])]
        np.testing.assert_allclose(np.hypot(*(rim - (20, 50)).T), 6.0, rtol=1e-12)
    notch = mesh_polygon(NOTCHED, [], 3.0, quads=quads)
    right = notch.nodes[notch.node_sets["EDGE3"]]
    np.testing.assert_allclose(np.hypot(*(right - (40, 30)).T), 2.0, rtol=1e-12)
    assert (right[:, 0] < 40 + 1e-9).all()  # the side of the point that the arc goes through


def test_every_edge_of_the_boundary_is_in_the_set_of_its_segment_and_in_its_named_set():
    mesh = mesh_polygon(STRIP, [[20, 50, 6]], 4.0, quads=True, names={"ENDS": [1, 3]})
    y = mesh.nodes[:, 1]
    assert (y[mesh.node_sets["EDGE1"]] == 0).all() and (y[mesh.node_sets["EDGE3"]] == 100).all()
    assert len(mesh.edge_sets["ENDS"]) == len(mesh.edge_sets["EDGE1"]) + len(mesh.edge_sets["EDGE3"])
    parts = np.concatenate([mesh.edge_sets[f"EDGE{k}"] for k in range(1, 5)] + [mesh.edge_sets["HOLE1"]])
    assert sorted(map(tuple, parts.tolist())) == sorted(map(tuple, mesh.boundary_faces().tolist()))
    assert len(mesh.edge_sets["OUTER"]) == len(parts) - len(mesh.edge_sets["HOLE1"])


def test_a_rectangle_of_quadrilaterals_is_a_regular_grid():
    mesh = mesh_polygon(STRIP, [], 5.0, quads=True)
    assert [(block.cell, block.n_elements) for block in mesh.blocks] == [("quad4", 160)]
    assert mesh.smallest_angle == pytest.approx(90.0, abs=1e-6)


def test_one_drawing_gives_one_mesh_whatever_its_unit_and_sense_of_rotation():
    first, again = (mesh_polygon(DOG_BONE, [], 2.5, quads=True) for _ in range(2))
    assert np.array_equal(first.nodes, again.nodes)
    small = mesh_polygon([[x / 1000 for x in point] for point in DOG_BONE], [], 2.5e-3, quads=True)
    np.testing.assert_allclose(small.nodes * 1000, first.nodes, atol=1e-6)
    back = mesh_polygon(STRIP[::-1], [], 5.0)
    back.check_elements()
    assert area(back) == pytest.approx(4000.0)


def test_elements_shrink_at_small_details_and_grow_away_from_them():
    mesh = mesh_polygon(STRIP, [[20, 50, 0.5]], 5.0)
    corners = mesh.nodes[mesh.blocks[0].connectivity]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max(axis=1)
    far = np.hypot(*(corners.mean(axis=1) - (20, 50)).T)
    assert longest[far < 1].max() < 1.0 and longest.max() < 1.6 * 5
    assert mesh.n_elements < 800  # 400 without the hole


@pytest.mark.parametrize("outline, holes, size, what", [
    (STRIP, [], 400, "size"), (STRIP, [], 0.0, "size"), (STRIP, [], float("nan"), "size"), (STRIP, [], 1e-3, "size"),
    ([[0, 0], [40, 0]], [], 4, "encloses nothing"), ([[0, 0], [40, 0], [40, 0], [0, 40]], [], 4, "same"),
    ([[0, 0], [40, 40], [40, 0], [0, 41]], [], 4, "cross"), (STRIP, [[38, 50, 6]], 4, "cross"),
    (STRIP, [[80, 50, 6]], 4, "not in the material"), (STRIP, [[20, 50, 9], [20, 50, 3]], 2, "not in the material"),
    (STRIP, [[20, 50, -1]], 4, "not a circle"), ([[0, 0], [1, 2, 3], [5, 5]], [], 1, "not a point"),
    ([[0, 0], [1, float("inf")], [5, 5]], [], 1, "not a point"),
    ([[0, 0], [100, 0], [100, 1e-4]], [], 4, "cannot be meshed|size"),
])
def test_what_cannot_be_meshed_is_refused_with_a_remedy(outline, holes, size, what):
    with pytest.raises(InputError, match=what) as caught:
        mesh_polygon(outline, holes, size)
    assert caught.value.expected and caught.value.found and caught.value.remedy


def test_arcs_are_followed_only_between_their_ends():
    outline = [[0, 0], [10, 0], [10, 10], [5, 12, 0, 10]]
    mesh = raise_order(mesh_polygon(outline, [], 2.0))
    followed = Segments.of(outline).on_arcs(mesh)
    moved = (followed.nodes != mesh.nodes).any(axis=1)
    assert moved.any() and (mesh.nodes[moved, 1] > 9.9).all()
    assert area(replace(mesh, nodes=followed.nodes)) == pytest.approx(Segments.of(outline).area(), rel=1e-4)
