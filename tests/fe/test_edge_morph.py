"""Free edges that move outwards: the body grows by their length, what does not move keeps its shape."""

from __future__ import annotations

import numpy as np
import pytest

from idic.fe import edges_by_name, free_edges, Mesh, mesh_polygon, outward_velocity, raise_order

V = [[0.0, 0.0], [8.0, 4.0], [16.0, 0.0], [16.0, 20.0], [8.0, 16.0], [0.0, 20.0]]  # notched below and above


@pytest.fixture(scope="module", params=[False, True], ids=["linear", "quadratic"])
def notched(request) -> Mesh:
    mesh = mesh_polygon(V, [[8.0, 10.0, 2.0]], 1.5, quads=True, names={"LEFT": [6], "RIGHT": [3]})
    return raise_order(mesh) if request.param else mesh


def area(mesh: Mesh, nodes: np.ndarray) -> float:
    total = 0.0
    for block in mesh.blocks:
        points, weights = block.kind.quadrature_rule()
        jacobian = np.einsum("eai,qaj->eqij", nodes[block.connectivity], block.kind.shape_gradients(points))
        total += float((np.linalg.det(jacobian) * weights).sum())
    return total


def length(mesh: Mesh, faces: np.ndarray) -> float:
    ends = np.array([mesh.face_nodes(face)[:2] for face in faces])
    return float(np.hypot(*(mesh.nodes[ends[:, 1]] - mesh.nodes[ends[:, 0]]).T).sum())


def test_the_area_grows_by_the_length_of_the_edges_and_ends_stay_where_they_are(notched):
    held = {name: notched.node_sets[name] for name in ("LEFT", "RIGHT")}
    free = free_edges(notched, held)
    known = edges_by_name(notched, free)
    assert set(known) == {"EDGE1", "EDGE2", "EDGE4", "EDGE5", "HOLE1"}
    for faces in (free, known["EDGE1"], known["HOLE1"]):
        velocity, h = outward_velocity(notched, faces), 1e-5
        slope = (area(notched, notched.nodes + h * velocity) - area(notched, notched.nodes - h * velocity)) / (2.0 * h)
        assert slope == pytest.approx(length(notched, faces), rel=1e-3)
        for name, x in (("LEFT", 0.0), ("RIGHT", 16.0)):
            moved = (notched.nodes + 0.3 * velocity)[notched.node_sets[name]]
            np.testing.assert_allclose(moved[:, 0], x, atol=1e-9)


def test_straight_edges_stay_straight_and_corners_stay_on_the_lines_of_both(notched):
    faces = notched.edge_sets["EDGE1"]  # from (0, 0) to (8, 4)
    moved = notched.nodes + 0.5 * outward_velocity(notched, faces)
    out = np.array([4.0, -8.0]) / np.hypot(4.0, 8.0)
    np.testing.assert_allclose(moved[notched.face_set_nodes(faces)] @ out, 0.5, atol=1e-9)
    for name in ("EDGE2", "EDGE4", "EDGE5", "LEFT", "RIGHT", "HOLE1"):  # the others slide along themselves
        nodes = notched.node_sets[name]
        before, after = notched.nodes[nodes], moved[nodes]
        if name == "HOLE1":
            np.testing.assert_allclose(after, before, atol=1e-6)
        else:
            along = np.linalg.svd(before - before.mean(axis=0))[2][0]
            off = np.array([-along[1], along[0]])
            np.testing.assert_allclose(after @ off, (before @ off).mean(), atol=1e-9)


def test_a_flat_corner_goes_half_way_and_neighbouring_edges_stay_where_they_are():
    """A waist whose flanks turn by 16 degrees: on the line of both edges the corner would run 3.6 times as far."""
    half = [[10.0, 30.0], [7.0, 20.0], [7.0, -20.0], [10.0, -30.0]]
    outline = [*half[::-1], *([-x, y] for x, y in half)]
    mesh = mesh_polygon(outline, [], 2.0, quads=True, names={"BOTTOM": [8], "TOP": [4]})
    held = {name: mesh.node_sets[name] for name in ("BOTTOM", "TOP")}
    known = edges_by_name(mesh, free_edges(mesh, held))
    moved = outward_velocity(mesh, known["EDGE1"])  # from (10, -30) to (7, -20)
    assert np.hypot(*moved.T).max() < 1.2
    corner = np.argmin(np.hypot(*(mesh.nodes - (7.0, -20.0)).T))
    assert np.hypot(*moved[corner]) == pytest.approx(0.5, rel=0.02)
    for name, along in (("EDGE2", [0.0, 1.0]), ("EDGE3", [3.0, 10.0])):
        nodes = np.setdiff1d(mesh.node_sets[name], [corner])
        assert np.abs(moved[nodes] @ [along[1], -along[0]]).max() < 0.05 * np.hypot(*along)
    both = sum(outward_velocity(mesh, known[name]) for name in ("EDGE1", "EDGE2"))
    np.testing.assert_allclose(both[corner], outward_velocity(mesh, np.concatenate([known["EDGE1"], known["EDGE2"]]))[
        corner], atol=1e-9)
