"""Middle nodes of a raised mesh on the arcs that its corners follow."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest
from fe_bodies import grid, volume

from idic.fe import Mesh, Segments, cell_type, curved, make_mesh, mesh_polygon, raise_order
from idic.virtual_tests import strip_with_hole

RADIUS = 3.0


def plate(cell: str) -> Mesh:
    mesh = strip_with_hole(24.0, 16.0, RADIUS, "quad4", around=3, radial=4, along=2)
    quads = mesh.blocks[0].connectivity
    if cell == "tri3":
        return make_mesh(mesh.nodes, [("tri3", np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))])
    return mesh


def bricks() -> Mesh:
    mesh = plate("quad4")
    quads = mesh.blocks[0].connectivity
    nodes = np.concatenate([np.column_stack([mesh.nodes, np.full(mesh.n_nodes, z)]) for z in (0.0, 0.5, 1.0)])
    return make_mesh(nodes, [("hex8", np.concatenate([np.hstack([quads + k * mesh.n_nodes,
                                                                quads + (k + 1) * mesh.n_nodes]) for k in (0, 1)]))])


@pytest.mark.parametrize("cell", ["quad4", "tri3"])
def test_the_hole_of_a_linear_mesh_becomes_a_circle_and_all_else_stays(cell):
    straight = raise_order(plate(cell))
    mesh = curved(straight)
    moved = (mesh.nodes != straight.nodes).any(axis=1)
    distance = np.hypot(*straight.nodes.T)
    assert moved.sum() == 24 and distance[moved].max() < RADIUS * (1.0 - 0.008)  # the heights of 24 arcs: 0.86 %
    assert np.allclose(np.hypot(*mesh.nodes[moved].T), RADIUS, rtol=1e-9)
    whole = 24.0 * 16.0 - np.pi * RADIUS**2
    # parabolas for arcs
    assert volume(straight) / whole - 1.0 > 8e-4 and volume(mesh) == pytest.approx(whole, rel=3e-6)
    mesh.check_elements()
    assert curved(straight) is mesh  # made once: caches know meshes by their identity


def test_the_hole_through_bricks_becomes_a_cylinder():
    straight = raise_order(bricks())
    mesh = curved(straight)
    moved = np.abs(mesh.nodes - straight.nodes).max(axis=1) > 1e-9
    assert moved.sum() == 3 * 24 and np.array_equal(mesh.nodes[:, 2], straight.nodes[:, 2])
    assert np.allclose(np.hypot(*mesh.nodes[moved, :2].T), RADIUS, rtol=1e-9)


def test_fillets_and_notches_follow_the_arcs_that_were_drawn_and_straight_edges_stay():
    notched = [[0, 0], [18, 0], [20, 2, 22, 0], [40, 0], [40, 12], [30, 12], [28.5, 12.6213, 27.8787, 14.1213],
               [27.8787, 18], [0, 18]]
    straight = raise_order(mesh_polygon(notched, [[12.0, 9.0, 2.5]], 0.8))
    wanted, mesh = Segments.of(notched, [[12.0, 9.0, 2.5]]).on_arcs(straight), curved(straight)
    on_arc = (wanted.nodes != straight.nodes).any(axis=1)
    assert on_arc.sum() > 20
    assert np.abs(mesh.nodes - wanted.nodes)[on_arc].max() < 0.05 * np.abs(wanted.nodes - straight.nodes).max()
    assert np.array_equal(mesh.nodes[~on_arc], straight.nodes[~on_arc])


def polygonal(n: int) -> Mesh:
    """A ring of quadrilaterals between a regular polygon and a larger one that is turned against it."""
    angle = 2.0 * np.pi * np.arange(n) / n
    rings = [radius * np.column_stack([np.cos(angle), np.sin(angle)]) for radius in (3.0, 4.0, 5.0)]
    k, following = np.arange(n), (np.arange(n) + 1) % n
    quads = np.concatenate([np.column_stack([k, k + n, following + n, following]) + i * n for i in (0, 1)])
    return make_mesh(np.concatenate(rings), [("quad4", quads)])


@pytest.mark.parametrize(("n", "is_round"), [(6, False), (8, False), (12, True), (60, True)])
def test_an_octagon_stays_one(n, is_round):
    straight = raise_order(polygonal(n))
    mesh = curved(straight)
    assert (mesh is not straight) == is_round
    if is_round:
        edge = mesh.boundary_faces()
        radii = np.hypot(*mesh.nodes[[mesh.face_nodes(face)[2] for face in edge]].T)
        assert np.allclose(np.minimum(abs(radii - 3.0), abs(radii - 5.0)), 0.0, atol=1e-9)


def test_rectangles_chamfers_and_rough_outlines_stay_straight():
    block = raise_order(grid("quad4", (5, 5), (5.0, 5.0)))
    assert curved(block) is block
    octagon = raise_order(mesh_polygon([[0, 1], [1, 0], [9, 0], [10, 1], [10, 9], [9, 10], [1, 10], [0, 9]], [], 1.5))
    assert curved(octagon) is octagon
    wide, rng = np.arange(0.0, 40.0), np.random.default_rng(4)
    rough = raise_order(mesh_polygon([*np.column_stack([wide, 0.15 * rng.standard_normal(len(wide))]).tolist(),
                                      [40.0, 20.0], [-1.0, 20.0]], [], 1.0))
    bent = (curved(rough).nodes != rough.nodes).any(axis=1)
    assert bent.mean() < 0.02


def test_a_layer_thinner_than_the_arcs_keeps_straight_edges():
    ring = polygonal(16)
    thin = ring.nodes.copy()
    thin[16:32] *= 3.01 / 4.0  # arcs are 0.058 high, and the layer is 0.01 thick
    straight = raise_order(replace(ring, nodes=thin))
    mesh = curved(straight)
    moved = straight.nodes[(mesh.nodes != straight.nodes).any(axis=1)]
    assert len(moved) == 16 and np.hypot(*moved.T).min() > 4.5
    mesh.check_elements()


def test_linear_elements_are_refused():
    with pytest.raises(ValueError, match="no middle nodes"):
        curved(plate("quad4"))


def ring(radii: list[float], n: int, cell: str = "quad4", **sets) -> Mesh:
    """Rings of n quadrilaterals, or of twice as many triangles."""
    angle = 2.0 * np.pi * np.arange(n) / n
    nodes = np.concatenate([radius * np.column_stack([np.cos(angle), np.sin(angle)]) for radius in radii])
    k, following = np.arange(n), (np.arange(n) + 1) % n
    quads = np.concatenate([np.column_stack([k, k + n, following + n, following]) + i * n
                            for i in range(len(radii) - 1)])
    cells = quads if cell == "quad4" else np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return make_mesh(nodes, [(cell, cells)], **sets)


def extruded(plane: Mesh, levels: int) -> Mesh:
    """Bricks over a plane mesh, 1 mm each."""
    quads, n = plane.blocks[0].connectivity, plane.n_nodes
    nodes = np.concatenate([np.column_stack([plane.nodes, np.full(n, float(z))]) for z in range(levels + 1)])
    return make_mesh(nodes, [("hex8", np.concatenate([np.hstack([quads + k * n, quads + (k + 1) * n])
                                                      for k in range(levels)]))])


@pytest.mark.parametrize("n", [24, 48])
def test_both_walls_of_a_tube_become_round(n):
    """With the inner one alone the wall of 1 mm was 12 % too thin."""
    mesh = curved(raise_order(extruded(ring([20.0, 20.5, 21.0], n), 3)))
    assert volume(mesh) == pytest.approx(np.pi * (21.0**2 - 20.0**2) * 3.0, rel=3e-5)


def test_rounded_coordinates_leave_a_hole_through_bricks_round():
    straight = raise_order(bricks())
    noisy = straight.nodes + np.random.default_rng(3).normal(0.0, 5e-5, straight.nodes.shape) * [1.0, 1.0, 0.0]
    moved = np.abs(curved(replace(straight, nodes=noisy)).nodes - noisy).max(axis=1) > 1e-3
    assert moved.sum() == 3 * 24


@pytest.mark.parametrize("at", [0, 2])
def test_a_layer_of_another_material_keeps_its_thickness(at):
    """A liner of a hole, a coat of a ring: with the free edge alone on its arc its area was 12 % too small or large."""
    n, radii = 24, [5.0, 5.25, 7.75, 8.0]
    lined = ring(radii, n, element_sets={"LAYER": np.arange(n) + at * n})
    mesh = curved(raise_order(lined))
    layer = make_mesh(mesh.nodes, [("quad8", mesh.blocks[0].connectivity[mesh.element_sets["LAYER"]])])
    assert volume(layer) == pytest.approx(np.pi * (radii[at + 1]**2 - radii[at]**2), rel=1e-3)


def test_beside_flattened_triangles_the_other_rim_of_a_thin_ring_stays_a_polygon_too():
    """With one rim round the area was 11 % too large, with both as polygons it is 1.1 % too small."""
    straight = raise_order(ring([20.0, 20.5, 21.0], 24, "tri3"))
    assert curved(straight) is straight
    sound = curved(raise_order(ring([20.0, 20.5, 21.0], 72, "tri3")))
    assert volume(sound) == pytest.approx(np.pi * 41.0, rel=1e-4)


def test_no_element_is_turned_over_between_its_integration_points():
    """A layer of 0.095 mm under arcs of 0.102 mm: sound at corners and integration points, not at middle nodes."""
    straight = raise_order(ring([3.0, 3.095, 4.0, 5.0], 12))
    mesh = curved(straight)
    slopes = cell_type("quad8").shape_gradients(cell_type("quad8").reference_nodes)
    det = np.linalg.det(np.einsum("eai,qaj->eqij", mesh.nodes[mesh.blocks[0].connectivity], slopes))
    assert det.min() > 0.0


def test_a_mesh_without_arcs_is_not_kept_alive():
    straight = raise_order(grid("quad4", (3, 3), (3.0, 3.0)))
    alive = weakref.ref(straight)
    assert curved(straight) is straight
    del straight
    gc.collect()
    assert alive() is None
