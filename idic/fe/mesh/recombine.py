"""Pairs of triangles become quadrilaterals, best shape first; where none fits a triangle stays."""

from __future__ import annotations

import numpy as np

MIN_QUAD_SHAPE = 0.45  # smallest sine of a corner of a quadrilateral; a square has 1


def recombined(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Quadrilaterals (n, 4) and the triangles (m, 3) that are left, counter-clockwise.

    The shape of a pair is its smallest sine of a corner, negative where it is not convex; pairs are merged in falling
    order of shape, equal ones in the order of the triangles.
    """
    pairs, quads = _pairs(triangles)
    shape = corner_sines(points, quads).min(axis=1)
    order = np.lexsort((pairs[:, 0], -np.round(shape, 6)))
    used, chosen = np.zeros(len(triangles), dtype=bool), []
    for k in order[: int((shape > MIN_QUAD_SHAPE).sum())].tolist():
        if not used[pairs[k]].any():
            used[pairs[k]] = True
            chosen.append(k)
    chosen = np.sort(np.array(chosen, dtype=int))
    return quads[chosen].reshape(-1, 4), triangles[~used]


def _pairs(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Neighbours (n, 2) and the quadrilateral of each pair (n, 4)."""
    ends = np.concatenate([triangles[:, [k, (k + 1) % 3]] for k in range(3)])
    opposite = np.concatenate([triangles[:, (k + 2) % 3] for k in range(3)])
    owner = np.tile(np.arange(len(triangles)), 3)
    order = np.lexsort(np.sort(ends, axis=1).T)
    key = np.sort(ends, axis=1)[order]
    first = np.flatnonzero((key[1:] == key[:-1]).all(axis=1))
    a, b = order[first], order[first + 1]
    swap = owner[a] > owner[b]
    a, b = np.where(swap, b, a), np.where(swap, a, b)
    quads = np.column_stack([ends[a, 0], opposite[b], ends[a, 1], opposite[a]])
    return np.column_stack([owner[a], owner[b]]), quads


def corner_sines(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Sine of the inner angle at every corner, negative beyond 180 degrees  # (n, corners)"""
    corners = points[cells]
    ahead, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    cross = ahead[..., 0] * back[..., 1] - ahead[..., 1] * back[..., 0]
    return cross / np.maximum(np.linalg.norm(ahead, axis=-1) * np.linalg.norm(back, axis=-1), 1e-300)


def smoothed(points: np.ndarray, quads: np.ndarray, triangles: np.ndarray, n_fixed: int, rounds: int = 8) -> np.ndarray:
    """The points; those from `n_fixed` on move to the mean of their neighbours where every cell keeps its shape."""
    cells = [c for c in (quads, triangles) if len(c)]
    ends = np.concatenate([np.column_stack([c[:, k], np.roll(c, -1, axis=1)[:, k]]) for c in cells
                           for k in range(c.shape[1])])
    ends = np.unique(np.sort(ends, axis=1), axis=0)
    for _ in range(rounds):
        sums, count = np.zeros_like(points), np.zeros(len(points))
        for a, b in (ends.T, ends.T[::-1]):
            np.add.at(sums, a, points[b])
            np.add.at(count, a, 1.0)
        target = sums / np.maximum(count, 1.0)[:, None]
        moved = points.copy()
        moved[n_fixed:] += 0.5 * (target - points)[n_fixed:]
        for _ in range(10):
            worse = [c[corner_sines(moved, c).min(axis=1) < corner_sines(points, c).min(axis=1) - 1e-12].ravel()
                     for c in cells]
            worse = np.unique(np.concatenate(worse))
            worse = worse[(moved[worse] != points[worse]).any(axis=1)]
            if not len(worse):
                break
            moved[worse] = points[worse]
        else:
            return points
        points = moved
    return points
