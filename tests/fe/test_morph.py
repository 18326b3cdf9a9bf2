"""Meshes that morph with the place and size of a round hole."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from fe_bodies import grid

from idic.errors import NotConverged
from idic.fe import Morph, admissible, find_holes, make_mesh, morphed, on_circle, raise_order
from idic.readers import roi_mesh
from idic.virtual_tests import strip_with_hole

RADIUS = 3.0


def strip(cell="quad8"):
    mesh = strip_with_hole(24.0, 16.0, RADIUS, "quad8" if cell == "quad8" else "quad4", around=3, radial=4, along=2)
    if cell in ("quad4", "quad8"):
        return mesh
    if cell == "raised":
        mesh = raise_order(mesh)
        return on_circle(mesh, find_holes(mesh))
    quads = mesh.blocks[0].connectivity
    if cell == "tri3":
        return make_mesh(mesh.nodes, [("tri3", np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))])
    nodes = np.concatenate([np.column_stack([mesh.nodes, np.full(mesh.n_nodes, z)]) for z in (0.0, 0.5, 1.0)])
    return make_mesh(nodes, [("hex8", np.concatenate([np.hstack([quads + k * mesh.n_nodes,
                                                                quads + (k + 1) * mesh.n_nodes]) for k in (0, 1)]))])


CELLS = ["quad4", "quad8", "raised", "tri3", "hex8"]


@pytest.mark.parametrize("cell", CELLS)
def test_the_hole_is_found_with_its_centre_radius_and_rim(cell):
    mesh = strip(cell)
    (hole,) = find_holes(mesh)
    assert np.allclose(hole.centre, 0.0, atol=1e-9) and hole.radius == pytest.approx(RADIUS, rel=1e-9)
    on_rim = np.flatnonzero(np.abs(np.hypot(*mesh.nodes[:, :2].T) - RADIUS) < 1e-9)
    assert np.array_equal(hole.rim, on_rim)


@pytest.mark.parametrize("cell", CELLS)
def test_the_rim_stays_a_circle_and_the_other_walls_stay(cell):
    mesh = strip(cell)
    (hole,) = find_holes(mesh)
    fields = hole.velocities(mesh)
    nodes = mesh.nodes + 0.3 * fields["x"] - 0.2 * fields["y"] + 0.4 * fields["radius"]
    rim = nodes[hole.rim, :2]
    assert np.allclose(np.hypot(*(rim - (0.3, -0.2)).T), RADIUS + 0.4, rtol=1e-12)
    outer = np.any(np.isclose(np.abs(mesh.nodes[:, :2]), (12.0, 8.0)), axis=1)
    assert outer.any() and np.array_equal(nodes[outer], mesh.nodes[outer])
    if mesh.n_dim == 3:
        assert np.array_equal(nodes[:, 2], mesh.nodes[:, 2])
    replace(mesh, nodes=nodes).check_elements()


def test_the_velocity_obeys_the_maximum_principle_and_falls_with_the_distance_from_the_hole():
    mesh = strip("quad4")
    (hole,) = find_holes(mesh)
    shift = hole.velocities(mesh)["x"][:, 0]
    assert shift.min() > -1e-12 and shift.max() < 1.0 + 1e-12
    distance = np.hypot(*mesh.nodes.T)
    bounds = (2.9, 4.0, 5.0, 6.0, 7.0)  # a ring of nodes in each
    rings = [shift[(distance >= a) & (distance < b)].mean() for a, b in pairwise(bounds)]
    assert np.all(np.diff(rings) < 0)


def test_within_the_admissible_range_elements_keep_a_quarter_of_their_jacobian_and_just_beyond_one_does_not():
    mesh = strip("quad8")
    (hole,) = find_holes(mesh)
    for field in hole.velocities(mesh).values():
        low, high = admissible(mesh, field)
        assert low < 0 < high
        for limit in (low, high):
            inside, outside = (mesh.jacobian_ratios(mesh.nodes + s * limit * field).min() for s in (0.999, 1.001))
            assert inside > 0.25 > outside
            path = [mesh.jacobian_ratios(mesh.nodes + s * limit * field).min() for s in np.linspace(0.0, 0.99, 12)]
            assert min(path) > 0.25


def test_a_mesh_that_would_fold_is_refused_as_a_trial():
    mesh = strip("quad4")
    (hole,) = find_holes(mesh)
    morph = Morph("geometry.hole_x", 0.0, hole.velocities(mesh)["x"])
    assert morphed(mesh, [morph], {}) is mesh
    assert np.allclose(morphed(mesh, [morph], {"geometry.hole_x": 0.1}).nodes[hole.rim, 0],
                       mesh.nodes[hole.rim, 0] + 0.1)
    with pytest.raises(NotConverged, match="flattened"):
        morphed(mesh, [morph], {"geometry.hole_x": 20.0})


def test_two_holes_come_from_left_to_right_and_one_moves_without_the_other():
    mesh = roi_mesh((0.0, 0.0, 60.0, 30.0), 2.0, [(42.0, 15.0, 6.0), (15.0, 14.0, 5.0)], down=False)
    left, right = find_holes(mesh)
    assert left.centre == pytest.approx((15.0, 14.0), abs=0.2) and right.centre == pytest.approx((42.0, 15.0), abs=0.2)
    assert (left.radius, right.radius) == (pytest.approx(5.0, rel=0.04), pytest.approx(6.0, rel=0.04))  # few cells
    field = left.velocities(mesh)["radius"]
    assert not field[right.rim].any() and np.hypot(*field[left.rim].T).min() > 0.9


def test_a_square_hole_and_a_body_without_one_give_none():
    plate = grid("quad4", (5, 5), (5.0, 5.0))
    assert find_holes(plate) == ()
    centre = plate.nodes[plate.blocks[0].connectivity].mean(axis=1)
    keep = np.abs(centre - 2.5).max(axis=1) > 1.0
    assert find_holes(make_mesh(plate.nodes, [("quad4", plate.blocks[0].connectivity[keep])])) == ()


def test_every_wall_of_a_hex_mesh_is_upright():
    mesh = strip("hex8")
    faces = mesh.boundary_faces()
    rim = find_holes(mesh)[0].rim
    assert len(rim) * 2 / 3 == pytest.approx(  # two layers of faces over three rings of nodes
        sum(np.isin(mesh.face_nodes(face), rim).all() for face in faces))
    assert len(mesh.face_set_nodes(faces)) < mesh.n_nodes
