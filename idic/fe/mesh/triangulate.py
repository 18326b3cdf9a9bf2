"""Triangles in a region: a lattice of points, refinement where edges are short, smoothing.

Points are inserted at the centres of circumscribed circles (Ruppert 1995, doi 10.1006/jagm.1995.1021) and move to the
mean centre of their triangles, weighted by area (Chen 2004), between triangulations of Delaunay, as in Persson and
Strang (2004, doi 10.1137/S0036144503429121). The boundary points stay.
"""

from __future__ import annotations

import numpy as np
import scipy

from idic.errors import InputError
from idic.fe.mesh.outline import Boundary, Segments, halved
from idic.fe.mesh.region import areas, inside, missing_edges, near_edges, size_at, triangles_inside

KEPT_FROM_BOUNDARY = 1.25  # half edge lengths: distance of a point from the middles of boundary edges
MAX_CIRCUMRADIUS = 0.85  # of the size; an equilateral triangle has 0.58
MIN_ANGLE = np.radians(28.0)  # sharper triangles are refined, except at sharp corners
MAX_REFINEMENTS, SMOOTHINGS, MAX_REPAIRS = 40, 12, 6


def triangulate(segments: Segments, boundary: Boundary, size: float,
                square: bool = False) -> tuple[np.ndarray, np.ndarray, Boundary]:
    """Points, counter-clockwise triangles, and the boundary that they keep.

    Parameters
    ----------
    square : bool
        Points on a square lattice along x and y, for quadrilaterals; else on a hexagonal one, smoothed.

    Returns
    -------
    points (n, 2), the boundary points first; triangles (m, 3) int; boundary, halved where it was needed

    Raises
    ------
    InputError
        A boundary edge is missing in the triangulation.
    """
    for _ in range(MAX_REPAIRS):
        inner = _lattice(boundary, size, square)
        inner = _refined(boundary, inner, size)
        inner = _smoothed(boundary, inner, size, 4 if square else SMOOTHINGS, square)
        inner = _refined(boundary, inner, size)
        points, triangles = _triangles(boundary, inner)
        missing = missing_edges(boundary, triangles, len(points))
        if not missing.any():
            return points, triangles, boundary
        boundary = halved(boundary, segments, missing)
    raise InputError("the outline cannot be meshed", expected="gaps in the boundary that elements can fill",
                     found=f"{int(missing.sum())} edges that no element has", remedy="choose smaller elements")


def _triangles(boundary: Boundary, inner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    points = np.concatenate([boundary.points, inner])
    mesh, in_region = triangles_inside(boundary, points)
    triangles = mesh.simplices[in_region].astype(np.int64)
    clockwise = areas(points, triangles) < 0
    triangles[clockwise] = triangles[clockwise][:, ::-1]
    return points, triangles


def _lattice(boundary: Boundary, size: float, square: bool) -> np.ndarray:
    """Lattice points in the region where elements of full size are wanted, clear of the boundary  # (n, 2)"""
    low, high = boundary.points.min(axis=0), boundary.points.max(axis=0)
    step = np.array([size, size if square else size * np.sqrt(0.75)])
    counts = np.maximum(np.round((high - low) / step), 1).astype(int)
    step = (high - low) / counts
    x, y = np.meshgrid(low[0] + step[0] * np.arange(counts[0] + 1), low[1] + step[1] * np.arange(counts[1] + 1))
    if not square:
        x[1::2] += step[0] / 2
    points = np.column_stack([x.ravel(), y.ravel()])
    points = points[inside(boundary, points)]
    points = points[~near_edges(boundary, points, KEPT_FROM_BOUNDARY)]
    return points[size_at(boundary, points, size) > 0.9 * size]


def _refined(boundary: Boundary, inner: np.ndarray, size: float) -> np.ndarray:
    """The points with those that large or sharp triangles need."""
    for _ in range(MAX_REFINEMENTS):
        points, triangles = _triangles(boundary, inner)
        centre, radius, shortest = _circles(points[triangles])
        sizes = size_at(boundary, centre, size)
        sharp = shortest < 2 * np.sin(MIN_ANGLE) * radius
        bad = np.flatnonzero((radius > MAX_CIRCUMRADIUS * sizes) | (sharp & (radius > 0.6 * sizes)))
        bad = bad[inside(boundary, centre[bad])]
        bad = bad[~near_edges(boundary, centre[bad], 1.0)]
        if not len(bad):
            break
        bad = bad[np.argsort(-radius[bad] / sizes[bad], kind="stable")]
        chosen = _spaced_out(centre[bad], 0.7 * sizes[bad])
        inner = np.concatenate([inner, centre[bad][chosen]])
    return inner


def _circles(corners: np.ndarray):
    """Centre and radius of the circumscribed circles, and the shortest edges, of triangles (n, 3, 2)."""
    a = corners[:, 0]
    b, c = corners[:, 1] - a, corners[:, 2] - a
    twice = 2 * (b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])
    bb, cc = (b**2).sum(axis=1), (c**2).sum(axis=1)
    offset = np.column_stack([c[:, 1] * bb - b[:, 1] * cc, b[:, 0] * cc - c[:, 0] * bb]) / twice[:, None]
    edges = np.hypot(*np.moveaxis(corners - np.roll(corners, 1, axis=1), -1, 0))
    return a + offset, np.hypot(*offset.T), edges.min(axis=1)


def _spaced_out(points: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Which points to keep so that none lies nearer to an earlier one than its distance  # (n,) bool"""
    is_kept = np.ones(len(points), dtype=bool)
    neighbours = scipy.spatial.cKDTree(points).query_ball_point(points, distance)
    for k, close_points in enumerate(neighbours):
        if is_kept[k]:
            is_kept[[j for j in close_points if j > k]] = False
    return is_kept


def _smoothed(boundary: Boundary, inner: np.ndarray, size: float, rounds: int, square: bool) -> np.ndarray:
    """The inner points in the mean centre of their triangles; of a square lattice only those next to the boundary."""
    n = len(boundary.points)
    for _ in range(rounds if len(inner) else 0):
        points, triangles = _triangles(boundary, inner)
        corners = points[triangles]
        weight = np.abs(areas(points, triangles)) / size_at(boundary, corners.mean(axis=1), size) ** 3
        total, sums = np.zeros(len(points)), np.zeros((len(points), 2))
        np.add.at(total, triangles, weight[:, None])
        np.add.at(sums, triangles, (weight[:, None] * corners.mean(axis=1))[:, None, :])
        if square:
            touched = np.zeros(len(points), dtype=bool)
            touched[triangles[(triangles < n).any(axis=1)]] = True
            move = touched[n:] & ~_on_square(points, triangles, size)[n:]
        else:
            move = np.ones(len(inner), dtype=bool)
        moved = np.where(move[:, None] & (total[n:, None] > 0), sums[n:] / np.maximum(total[n:, None], 1e-300), inner)
        inner = moved[~near_edges(boundary, moved, 1.0)]
    return inner


def _on_square(points: np.ndarray, triangles: np.ndarray, size: float) -> np.ndarray:
    """Points whose triangles are all halves of squares of about the size  # (n,) bool"""
    corners = points[triangles]
    edges = np.sort(np.hypot(*np.moveaxis(corners - np.roll(corners, 1, axis=1), -1, 0)), axis=1)
    half = np.abs(edges[:, 2] ** 2 - edges[:, 0] ** 2 - edges[:, 1] ** 2) < 0.05 * edges[:, 2] ** 2
    half &= edges[:, 0] > 0.7 * edges[:, 1]
    regular = np.ones(len(points), dtype=bool)
    regular[triangles[~half]] = False
    return regular
