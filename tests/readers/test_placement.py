"""A mesh with axes of its own laid along the outline of measured points."""

from __future__ import annotations

import numpy as np
import pytest

from idic.errors import InputError
from idic.readers import Edges, MIN_HOLE, Placement, loops_of, roi_mesh

WIDTH, HEIGHT, PITCH, MARGIN = 20.0, 50.0, 0.7, 0.5
ORIGIN = np.array([5.0, -7.0])


def turned(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def edges(holes) -> Edges:
    mesh = roi_mesh((0.0, 0.0, WIDTH, HEIGHT), 2.0, holes, down=False, file="x.toml", key="mesh")
    return Edges.of(mesh.nodes[:, :2], mesh.surface_cells(None))


def seen(angle: float, holes, view=(0.0, HEIGHT)) -> np.ndarray:
    """Points of a grid of the system on the specimen, which is turned by `angle` in it; view : its part along y"""
    grid = np.arange(-80.0, 80.0, PITCH)
    points = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    x, y = ((points - ORIGIN) @ turned(angle)).T
    inside = (x > MARGIN) & (x < WIDTH - MARGIN) & (y > max(MARGIN, view[0])) & (y < min(HEIGHT - MARGIN, view[1]))
    for column, row, radius in holes:
        inside &= np.hypot(x - column, y - row) > radius + MARGIN
    return points[inside]


def placed(angle: float, holes, view=(0.0, HEIGHT), near=None):
    points = seen(angle, holes, view)
    loops = sorted(loops_of(points, PITCH), key=lambda loop: -float(np.prod(np.ptp(loop, axis=0))))
    loops = [loop for k, loop in enumerate(loops) if k == 0 or len(loop) >= MIN_HOLE]
    return edges(holes).fitted_placement(points, loops, PITCH, near or Placement(np.full(2, np.nan), 0.0, 0.0))


@pytest.mark.parametrize("degrees", [pytest.param(31.0, marks=pytest.mark.slow), 170.0])
def test_a_plate_with_a_hole_beside_its_middle_is_found_wherever_it_lies(degrees):
    found, others = placed(np.radians(degrees), [[8.0, 18.0, 4.0]])
    np.testing.assert_allclose(found.origin, ORIGIN, atol=0.5 * PITCH)  # a grid shows an edge to half a distance
    assert np.degrees(found.angle) == pytest.approx(degrees, abs=0.2) and not others


def test_a_hole_holds_a_view_that_shows_no_end():
    found, _ = placed(np.radians(47.0), [[8.0, 18.0, 4.0]], (12.0, 38.0))
    np.testing.assert_allclose(found.origin, ORIGIN, atol=0.5 * PITCH)


def test_of_a_symmetric_plate_the_smallest_turn_is_taken_and_the_other_told():
    found, others = placed(np.radians(31.0), [])
    assert np.degrees(found.angle) == pytest.approx(31.0, abs=0.2)
    assert [np.degrees(one.angle - found.angle) % 360 for one in others] == pytest.approx([180.0], abs=0.5)


def test_a_view_within_a_strip_is_refused_unless_its_place_is_said():
    with pytest.raises(InputError, match="in several ways"):
        placed(np.radians(4.0), [], (-1.0, 30.0))  # one end of the outline is that of the specimen: which one?
    found, _ = placed(np.radians(4.0), [], (-1.0, 30.0), Placement(ORIGIN + [0.5, 2.0], np.radians(4.0), 0.0))
    np.testing.assert_allclose(found.origin, ORIGIN, atol=0.5 * PITCH)


def test_a_mesh_of_another_specimen_is_refused():
    points = seen(0.0, [])
    loops = loops_of(points, PITCH)
    with pytest.raises(InputError, match="does not lie along the edges"):
        edges([[10.0, 25.0, 8.0]]).fitted_placement(points, loops, PITCH, Placement(np.full(2, np.nan), 0.0, 0.0))
