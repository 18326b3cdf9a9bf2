"""Shapes along edges and courses in time: what any motion of an edge is made of."""

import numpy as np
import pytest

from idic.errors import InputError
from idic.fe import make_mesh, raise_order
from idic.model.boundary_modes import edge_pieces, edge_shapes, time_courses


def plate(nx=12, ny=8, hole=False):
    """A rectangle of unit squares, optionally with a square hole in its middle."""
    nodes = np.array([[1.0 * x, 1.0 * y] for y in range(ny + 1) for x in range(nx + 1)])
    quads = [[i + (nx + 1) * j, i + 1 + (nx + 1) * j, i + nx + 2 + (nx + 1) * j, i + nx + 1 + (nx + 1) * j]
             for j in range(ny) for i in range(nx) if not (hole and 4 <= i < 8 and 2 <= j < 6)]
    used = np.unique(quads)
    return raise_order(make_mesh(nodes[used], [("quad4", np.searchsorted(used, quads))]))


def ring(n=40):
    """Quads between two circles: no corner anywhere."""
    angle = np.arange(n) * 2 * np.pi / n
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    nodes = np.concatenate([2.0 * circle, 3.0 * circle])
    quads = np.array([[k, n + k, n + (k + 1) % n, (k + 1) % n] for k in range(n)])
    return make_mesh(nodes, [("quad4", quads)])


def rim(mesh, which=0):
    return np.random.default_rng(0).permutation(mesh.face_set_nodes(mesh.boundary_edges()[which]))


def misfit(shapes, motion):
    return np.abs(shapes @ np.linalg.lstsq(shapes, motion, rcond=None)[0] - motion).max()


@pytest.mark.parametrize("modes", [4, 5, 8, 12, 16, 25])
def test_splines_around_a_rectangle_hold_a_linear_motion_and_are_a_partition_of_unity(modes):
    mesh = plate()
    nodes = rim(mesh)
    shapes = edge_shapes(mesh, nodes, "bspline", modes)
    assert shapes.shape == (len(nodes), modes) and np.linalg.matrix_rank(shapes) == modes
    assert np.abs(shapes.sum(axis=1) - 1.0).max() < 1e-12 and shapes.min() > -1e-12
    linear = mesh.nodes[nodes] @ [0.3, -0.7] + 0.1  # bends at every corner
    assert misfit(shapes, linear) < 1e-12


def test_splines_around_a_rectangle_are_smooth_along_its_sides():
    mesh = plate()
    nodes = rim(mesh)
    side = mesh.nodes[nodes, 1] == 0.0
    x = mesh.nodes[nodes][side, 0]
    shapes = edge_shapes(mesh, nodes, "bspline", 16)[side][np.argsort(x)]
    kink = np.abs(np.sort(x) - 6.0)
    assert misfit(shapes, np.sort(x) ** 3) < 1e-9 and misfit(shapes, kink) > 0.05


def test_splines_of_an_edge_without_corners_are_periodic():
    mesh = ring()
    nodes = rim(mesh)
    shapes = edge_shapes(mesh, nodes, "bspline", 10)
    assert np.abs(shapes.sum(axis=1) - 1.0).max() < 1e-12 and np.linalg.matrix_rank(shapes) == 10
    assert misfit(shapes, mesh.nodes[nodes] @ [0.3, -0.7]) < 2e-3  # a sine on ten cubic intervals: (2 pi / 10)^4 / 384
    order = np.argsort(np.arctan2(*mesh.nodes[nodes].T))
    assert np.abs(np.sort(shapes[order], axis=1) - np.roll(np.sort(shapes[order], axis=1), 4, axis=0)).max() < 1e-9


def test_separate_edges_of_one_set_have_their_own_modes():
    mesh = plate(hole=True)
    x, y = mesh.nodes.T
    nodes = np.flatnonzero((x < 1e-9) | (x > 12 - 1e-9))
    assert len(edge_pieces(mesh, nodes)) == 2
    shapes = edge_shapes(mesh, nodes, "bspline", 10)
    left = x[nodes] < 1.0
    assert not np.any((np.abs(shapes[left]).sum(axis=0) > 0) & (np.abs(shapes[~left]).sum(axis=0) > 0))
    assert misfit(shapes, np.where(left, y[nodes], 3.0 - 2.0 * y[nodes])) < 1e-12


def test_two_cut_sides_that_meet_bend_at_their_corner():
    mesh = plate()
    x, y = mesh.nodes.T
    nodes = np.flatnonzero((x > 12 - 1e-9) | (y > 8 - 1e-9))
    piece, = edge_pieces(mesh, nodes)
    assert not piece.closed and piece.corners == (8.0,) and piece.length == 20.0
    assert misfit(edge_shapes(mesh, nodes, "bspline", 7), x[nodes]) < 1e-9


def test_polynomials_and_splines_of_as_many_modes_hold_the_same_motions_of_a_straight_edge():
    mesh = plate()
    nodes = np.flatnonzero(mesh.nodes[:, 0] < 1e-9)
    for modes in (1, 2, 3, 4):
        motion = mesh.nodes[nodes, 1] ** (modes - 1)
        for kind in ("bspline", "polynomial"):
            assert misfit(edge_shapes(mesh, nodes, kind, modes), motion) < 1e-9


def test_a_polynomial_does_not_turn_a_corner_and_too_few_modes_are_refused():
    mesh = plate()
    with pytest.raises(InputError, match="corner"):
        edge_shapes(mesh, rim(mesh), "polynomial", 6)
    with pytest.raises(InputError, match="too few modes"):
        edge_shapes(mesh, rim(mesh), "bspline", 3)


def test_nodes_inside_the_body_are_taken_along_their_main_direction():
    mesh = plate()
    nodes = np.flatnonzero(np.abs(mesh.nodes[:, 1] - 4.0) < 1e-9)
    assert edge_pieces(mesh, nodes) == []
    assert misfit(edge_shapes(mesh, nodes, "bspline", 4), mesh.nodes[nodes, 0]) < 1e-12


@pytest.mark.parametrize("kind", ["bspline", "polynomial"])
@pytest.mark.parametrize("modes", [1, 2, 3, 6, 12])
def test_courses_start_from_nothing_hold_a_steady_motion_and_are_well_conditioned(kind, modes):
    times = np.concatenate([[-2.0, -1.0], np.linspace(0.0, 30.0, 40)])
    courses = time_courses(times, 2, kind, modes)
    assert not courses[:3].any() and courses.shape == (42, modes)
    assert misfit(courses[3:], times[3:]) < 1e-9
    scaled = courses / np.linalg.norm(courses, axis=0)
    assert np.linalg.cond(scaled) < (40.0 if kind == "bspline" else 400.0)  # powers of t reach 1e8 at twelve modes
