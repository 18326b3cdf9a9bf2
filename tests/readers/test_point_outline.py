"""The outline of measured points, with the holes of the specimen and without those of the measurement."""

from __future__ import annotations

import numpy as np
import pytest

from idic.errors import InputError
from idic.readers import PointOutline, narrowest_width, notched_axis, sides_of_any

PITCH, MARGIN = 0.8, 0.5


def grid(width: float, height: float) -> np.ndarray:
    """Points of a measurement of a rectangle from the origin: they end `MARGIN` before its edges."""
    x, y = (np.linspace(MARGIN, size - MARGIN, round((size - 2 * MARGIN) / PITCH) + 1) for size in (width, height))
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def area(corners: np.ndarray) -> float:
    following = np.roll(corners, -1, axis=0)
    return 0.5 * float(np.sum(corners[:, 0] * following[:, 1] - following[:, 0] * corners[:, 1]))


def test_a_rectangle_has_its_four_corners():
    found = PointOutline.around(grid(24.0, 60.0), PITCH, MARGIN)
    corners = np.array([[0, 0], [24, 0], [24, 60], [0, 60]])
    assert len(found.outline) == 4 and not found.holes and found.filled == pytest.approx(1.0)
    for corner in corners:
        assert np.hypot(*(found.outline - corner).T).min() < 1e-6
    assert set(found.ends) == {"LEFT", "RIGHT", "BOTTOM", "TOP"}


def test_missing_points_are_no_holes_and_a_round_hole_is_a_circle():
    points = grid(24.0, 60.0)
    rng = np.random.default_rng(2)
    points = points[np.hypot(*(points - [11.0, 32.0]).T) > 5.0 + MARGIN]
    points = points[rng.random(len(points)) > 0.03]
    found = PointOutline.around(points, PITCH, MARGIN)
    (hole,) = found.holes
    assert hole.shape == (3,)
    # a grid reaches an edge that it does not follow within one distance, half of it in the mean
    np.testing.assert_allclose(hole, [11.0, 32.0, 5.0], atol=0.5 * PITCH)


def test_a_turned_strip_keeps_its_width():
    """A grid along x and y on a strip at 20 degrees: its edges are steps."""
    c, s = np.cos(np.radians(20.0)), np.sin(np.radians(20.0))
    x, y = np.meshgrid(np.arange(-40, 40, PITCH), np.arange(-40, 40, PITCH))
    points = np.column_stack([x.ravel(), y.ravel()])
    along, across = points @ [c, s], points @ [-s, c]
    points = points[(np.abs(along) < 30.0) & (np.abs(across) < 8.0)]
    found = PointOutline.around(points, PITCH, 0.0)
    assert len(found.outline) == 4
    sizes = np.sort(np.hypot(*(np.roll(found.outline, -1, axis=0) - found.outline).T))
    np.testing.assert_allclose(sizes, [16.0, 16.0, 60.0, 60.0], atol=2 * 0.75 * PITCH)  # of a step at each end


def test_the_gauge_of_a_waisted_specimen_is_not_turned_by_its_fillets():
    points = grid(40.0, 100.0)
    off = np.abs(points[:, 1] - 50.0)
    half = np.where(off < 25, 6.0, np.minimum(6.0 + 40.0 - np.sqrt(np.maximum(40.0**2 - (off - 25.0) ** 2, 0.0)), 14.0))
    points = points[np.abs(points[:, 0] - 20.0) < half - MARGIN]
    found = PointOutline.around(points, PITCH, MARGIN)
    middle = [[20.0 + side * 6.0] for side in (-1, 1)]
    following = np.roll(found.outline, -1, axis=0)
    crossing = (found.outline[:, 1] - 50.0) * (following[:, 1] - 50.0) < 0
    # upright
    np.testing.assert_allclose(np.sort(found.outline[crossing, 0]), np.sort(following[crossing, 0]), atol=1e-6)
    np.testing.assert_allclose(np.sort(found.outline[crossing, 0])[:, None], middle, atol=PITCH)
    exact = 2 * (25 * 6 * 2 + 2 * np.trapezoid(half_width(np.linspace(25, 50, 2001)), np.linspace(25, 50, 2001)))
    perimeter = np.hypot(*(following - found.outline).T).sum()
    # the grid ends within a distance before the edges
    assert abs(area(found.outline) - exact) < 0.5 * PITCH * perimeter


def half_width(off: np.ndarray) -> np.ndarray:
    return np.minimum(6.0 + 40.0 - np.sqrt(np.maximum(40.0**2 - (off - 25.0) ** 2, 0.0)), 14.0)


def test_points_that_hang_together_nowhere_are_refused():
    with pytest.raises(InputError, match="no outline"):
        PointOutline.around(np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0], [9.0, 9.0]]), 1.0, 0.5)


def test_gaps_that_are_no_holes_are_told():
    """A few points that were not measured, and a hole that the margin closes."""
    points = grid(24.0, 60.0)
    missing = np.abs(points - [6.0, 20.0]).max(axis=1) < 2.2 * PITCH
    points = points[~missing & (np.hypot(*(points - [15.0, 40.0]).T) > 1.6)]
    found = PointOutline.around(points, PITCH, 3.0)
    assert not found.holes and len(found.gaps) == 2
    at = found.gaps[np.argsort(found.gaps[:, 1]), :2]
    np.testing.assert_allclose(at, [[6.0, 20.0], [15.0, 40.0]], atol=PITCH)
    assert len(PointOutline.around(grid(24.0, 60.0), PITCH, MARGIN).gaps) == 0


def test_the_narrowest_width_is_that_between_a_hole_and_the_edges():
    points = grid(24.0, 60.0)
    found = PointOutline.around(points[np.hypot(*(points - [12.0, 30.0]).T) > 5.0 + MARGIN], PITCH, MARGIN)
    assert narrowest_width(found, PITCH)[0] == pytest.approx(14.0, abs=PITCH)
    assert narrowest_width(PointOutline.around(points, PITCH, MARGIN), PITCH)[0] == pytest.approx(24.0, abs=1e-6)


@pytest.mark.parametrize("turn", [0.0, 2.0])
def test_the_width_between_round_notches_is_within_the_stated_error(turn):
    """Iosipescu: 20 mm wide, 11.4 mm between notches of 90 degrees with a radius of 1.3 mm, whose lines meet deeper."""
    pitch, radius, depth = 0.55, 1.3, 4.3
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    x, y = np.meshgrid(np.arange(-25, 25, pitch), np.arange(-25, 25, pitch))
    points = np.column_stack([x.ravel(), y.ravel()]) @ [[c, s], [-s, c]]
    tip = 10.0 - depth + radius  # centre of the round
    within = np.abs(points[:, 1])
    wedge = (within > tip + np.abs(points[:, 0]) - np.sqrt(2.0) * radius) & (within > tip - radius / np.sqrt(2.0))
    notched = wedge | (np.hypot(points[:, 0], within - tip) < radius)
    points = points[(np.abs(points[:, 0]) < 20.0) & (within < 10.0) & ~notched] @ [[c, -s], [s, c]]
    found = PointOutline.around(points, pitch, 0.5 * pitch)
    width, error = narrowest_width(found, pitch)
    off = abs(width - 11.4)
    assert off < error < 5.0 * pitch
    assert off > pitch  # more than along straight edges


def test_the_error_of_a_rectangle_is_half_a_distance_on_every_side():
    assert narrowest_width(PointOutline.around(grid(24.0, 60.0), PITCH, MARGIN), PITCH)[1] == pytest.approx(PITCH)


@pytest.mark.parametrize("turn", [0.0, 3.0])
def test_notched_and_waisted_sides_are_free_edges(turn):
    """A rail shear specimen is taller than wide and notched above and below; of a dog bone the sides are waisted."""
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    points = grid(24.0, 56.0) - [12.0, 28.0]
    rail = points[np.abs(points[:, 1]) < 15.3 + np.abs(points[:, 0])]
    bone = points[np.abs(points[:, 0]) < 7.0 + 0.005 * points[:, 1] ** 2]
    turned = np.array([[c, s], [-s, c]])
    assert notched_axis(rail @ turned, PITCH) == 1
    assert notched_axis(bone @ turned, PITCH) == 0
    assert notched_axis(points @ turned, PITCH) is None
    found = PointOutline.around(rail @ turned, PITCH, MARGIN)
    width, error = narrowest_width(found, PITCH)
    assert abs(width - 30.6 - 2 * MARGIN) < error  # of the points, and the margin


def test_the_ends_of_an_outline_are_the_same_in_either_sense():
    outline = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 5.0], [5.0, 4.0], [0.0, 5.0]])
    for corners in (outline, outline[::-1]):
        ends = sides_of_any(corners)
        assert set(ends) == {"LEFT", "RIGHT", "BOTTOM"}
        for name, axis, value in (("LEFT", 0, 0.0), ("RIGHT", 0, 10.0), ("BOTTOM", 1, 0.0)):
            (k,) = ends[name]
            assert corners[k - 1, axis] == corners[k % len(corners), axis] == value
