"""Points of a perspective image of a grid to rows and columns: neighbours are followed from a seed."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

MAX_MISS = 0.3              # of a spacing between a neighbour and its predicted place: perspective and distortion
MIN_SINE = 0.85             # of the angle between the axes where dots are round: 58 degrees, a diagonal has 45
MAX_LENGTH_RATIO = 1.35     # of the two spacings there; a diagonal is 1.41
SEEDS = 12
NEIGHBOURS = 12


def grid_index(points_px: np.ndarray, rounding: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The largest grid among points.

    Parameters
    ----------
    points_px : array (n, 2)
    rounding : array (n, 2, 2)
        Map of the neighbourhood of each point to one where the grid is square.

    Returns
    -------
    chosen : int array (m,)
        Which points belong to the grid.
    index : int array (m, 2)
        Their place, smallest (0, 0); first axis along the columns of the image, second right-handed to it (downwards).
    """
    empty = np.zeros(0, dtype=int), np.zeros((0, 2), dtype=int)
    if len(points_px) < 4:
        return empty
    tree = cKDTree(points_px)
    _, order = tree.query(np.median(points_px, axis=0), k=min(len(points_px), SEEDS))
    best: dict[int, tuple[int, int]] = {}
    for seed in np.atleast_1d(order):
        axes = _axes(points_px, rounding[seed], tree, int(seed))
        if axes is not None:
            places = _follow(points_px, tree, int(seed), axes)
            best = places if len(places) > len(best) else best
        if 2 * len(best) > len(points_px):
            break
    if len(best) < 4:
        return empty
    chosen = np.array(sorted(best))
    index = np.array([best[i] for i in chosen])
    return chosen, index - index.min(axis=0)


def _axes(points, rounding, tree, seed):
    """Vectors to the next point along each axis, the first along the columns; None where there are none."""
    _, nearest = tree.query(points[seed], k=min(len(points), NEIGHBOURS + 1))
    vectors = points[nearest[1:]] - points[seed]
    square = vectors @ rounding.T
    order = np.argsort(np.linalg.norm(square, axis=1))
    first, lengths = vectors[order[0]], np.linalg.norm(square, axis=1)
    for n in order[1:]:
        if lengths[n] > MAX_LENGTH_RATIO * lengths[order[0]]:
            return None
        if abs(_cross(square[order[0]], square[n])) > MIN_SINE * lengths[order[0]] * lengths[n]:
            second = vectors[n]
            break
    else:
        return None
    if abs(second[0]) * np.hypot(*first) > abs(first[0]) * np.hypot(*second):
        first, second = second, first
    first = first if first[0] > 0 else -first
    return first, second if _cross(first, second) > 0 else -second


def _follow(points, tree, seed, axes):
    """Point number to (i, j), breadth first; every step takes the spacing that it found on."""
    place, point_at = {seed: (0, 0)}, {(0, 0): seed}
    queue = [(seed, *axes)]
    while queue:
        i, a, b = queue.pop(0)
        for step, vector in (((1, 0), a), ((-1, 0), -a), ((0, 1), b), ((0, -1), -b)):
            target = place[i][0] + step[0], place[i][1] + step[1]
            if target in point_at:
                continue
            distance, j = tree.query(points[i] + vector)
            if distance > MAX_MISS * np.linalg.norm(vector) or int(j) in place:
                continue
            j, moved = int(j), points[j] - points[i]
            place[j], point_at[target] = target, j
            queue.append((j, moved * step[0], b) if step[0] else (j, a, moved * step[1]))
    return place


def _cross(a, b):
    return a[0] * b[1] - a[1] * b[0]
