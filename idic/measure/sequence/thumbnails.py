"""How far the images of a test are from each other: their order by the smallest steps, repeated and lost images, and
the time by which one camera is late against another.

Images are looked at through thumbnails: means over squares of pixels, on three levels. Two images that are d apart
agree less on every level whose squares are not much larger than d; the sum over the levels grows with d up to the
largest square.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

SQUARES_ALONG = 96  # of a thumbnail, along the longer side of the region
LEVELS = 3
MAX_PASSES = 100  # over a path, each of which shortens it


@dataclass(frozen=True, eq=False)
class Thumbnail:
    """Means over squares of a region of an image, less their mean and over their standard deviation.

    levels : (ny, nx) each, the finest first; size_px : side of a square of the finest
    """

    levels: tuple[np.ndarray, ...]
    size_px: int


def thumbnail(image: np.ndarray, box: tuple[int, int, int, int]) -> Thumbnail:
    """The thumbnail of a region; pixels without a value count as the others of their square.

    Parameters
    ----------
    image : (ny, nx)
    box : first row, first column, end row, end column
    """
    first_row, first_column, end_row, end_column = box
    size = max(1, int(np.ceil(max(end_row - first_row, end_column - first_column) / SQUARES_ALONG)))
    shape = max(1, (end_row - first_row) // size), max(1, (end_column - first_column) // size)
    means = _means(image, first_row, first_column, size, shape)
    if image.dtype.kind == "f" and not np.isfinite(means).all():
        means = np.where(np.isfinite(means), means, np.nanmean(means) if np.isfinite(means).any() else 0.0)
    levels = [means]
    for _ in range(LEVELS - 1):
        ny, nx = levels[-1].shape[0] // 2, levels[-1].shape[1] // 2
        if min(ny, nx) < 4:
            break
        levels.append(levels[-1][:2 * ny, :2 * nx].reshape(ny, 2, nx, 2).mean(axis=(1, 3)))
    return Thumbnail(tuple(_normal(level).astype(np.float32) for level in levels), size)


def distances(thumbnails: Sequence[Thumbnail]) -> np.ndarray:
    """How far the images are from each other, in about px of motion  # (n, n)"""
    total = np.zeros((len(thumbnails), len(thumbnails)))
    for number in range(len(thumbnails[0].levels)):
        rows = np.array([entry.levels[number].ravel() for entry in thumbnails])
        parts = np.sqrt(np.clip(1.0 - rows @ rows.T / rows.shape[1], 0.0, 1.0))
        total += thumbnails[0].size_px * 2**number * parts
    np.fill_diagonal(total, 0.0)
    return total


def apart(thumbnails: Sequence[Thumbnail], lag: int = 1) -> np.ndarray:
    """How far each image is from the one so many before  # (n - lag,) px"""
    total = np.zeros(max(len(thumbnails) - lag, 0))
    for number in range(len(thumbnails[0].levels)):
        rows = np.array([entry.levels[number].ravel() for entry in thumbnails])
        alike = np.einsum("kp,kp->k", rows[:-lag], rows[lag:]) / rows.shape[1]
        total += thumbnails[0].size_px * 2**number * np.sqrt(np.clip(1.0 - alike, 0.0, 1.0))
    return total


def smoothest_order(distance: np.ndarray, starts: Sequence[Sequence[int]] = ()) -> list[int]:
    """An order of images whose steps are small: the shortest of the paths from nearest to nearest and of some given
    ones, after exchanges that shorten them.

    distance : (n, n)
    """
    n = len(distance)
    ends = {0, n - 1, *(int(k) for k in np.unravel_index(np.argmax(distance), distance.shape))}
    paths = [_nearest_path(distance, end) for end in sorted(ends)] + [list(start) for start in starts]
    paths.sort(key=lambda path: length(distance, path))
    return min((_shortened(distance, path) for path in paths[:3]), key=lambda path: length(distance, path))


def length(distance: np.ndarray, path: Sequence[int]) -> float:
    """The sum of the steps of an order."""
    return float(steps(distance, path).sum())


def steps(distance: np.ndarray, path: Sequence[int]) -> np.ndarray:
    """The steps of an order  # (n - 1,)"""
    return distance[list(path[:-1]), list(path[1:])]


def motions(thumbnails: Sequence[Thumbnail]) -> np.ndarray:
    """The affine motion from each image to the next: of the middle, and at half of the region its change along columns
    and rows  # (n - 1, 6) px"""
    return np.array([_motion(first, second) for first, second in pairwise(thumbnails)]).reshape(-1, 6)


def _motion(first: Thumbnail, second: Thumbnail) -> np.ndarray:
    """By least squares on the grey values, from the coarsest level to the finest, which is fitted twice."""
    motion = np.zeros(6)  # in squares of the finest level
    numbers = [*range(len(first.levels) - 1, -1, -1), 0]
    for number in numbers:
        f, g, scale = first.levels[number], second.levels[number], 2.0**number
        y, x = np.indices(f.shape)
        half = 0.5 * np.array(f.shape[::-1])
        a, b = (x - half[0] + 0.5) / half[0], (y - half[1] + 0.5) / half[1]
        basis = np.stack([np.ones_like(a), a, b])
        shift = [np.tensordot(part, basis, 1) / scale for part in (motion[:3], motion[3:])]
        places = [y + shift[1], x + shift[0]]
        moved = scipy.ndimage.map_coordinates(g, places, order=1, mode="nearest") if motion.any() else g
        down, right = np.gradient(0.5 * (f + moved))
        inner = (slice(1, -1),) * 2
        columns = np.concatenate([right * basis, down * basis])[(slice(None), *inner)].reshape(6, -1)
        full = np.vstack([columns, moved[inner].ravel(), np.ones(columns.shape[1])])
        gram = full @ full.T
        fit = np.linalg.lstsq(gram, full @ (f[inner] - moved[inner]).ravel(), rcond=1e-9)[0][:6]
        motion = motion + scale * fit
        if not np.isfinite(motion).all() or np.abs(motion).max() > 0.5 * max(f.shape) * scale:
            return np.full(6, np.nan)
    return motion * first.size_px


def _normal(values: np.ndarray) -> np.ndarray:
    deviation = float(values.std())
    return (values - values.mean()) / deviation if deviation > 0.0 else np.zeros_like(values)


def _nearest_path(distance: np.ndarray, start: int) -> list[int]:
    remaining, path = np.ones(len(distance), bool), [start]
    remaining[start] = False
    while remaining.any():
        following = int(np.argmin(np.where(remaining, distance[path[-1]], np.inf)))
        path.append(following)
        remaining[following] = False
    return path


def _shortened(distance: np.ndarray, path: list[int]) -> list[int]:
    """The path after turns of parts of it, each the best one, as long as one shortens it."""
    order, n = np.array(path), len(path)
    for _ in range(MAX_PASSES):
        at = distance[np.ix_(order, order)]
        step = np.concatenate([[0.0], np.diagonal(at, 1), [0.0]])  # before each place, and after the last
        wide = np.zeros((n + 1, n + 1))
        wide[1:, :n] = at  # place before i, place j
        before_i_to_j = np.vstack([np.zeros(n), at])[:n]  # from i - 1 to j
        i_to_after_j = np.hstack([at, np.zeros((n, 1))])[:, 1:]  # from i to j + 1
        gain = step[:n, None] + step[None, 1:] - before_i_to_j - i_to_after_j
        gain[np.tril_indices(n, 0)] = 0.0
        i, j = np.unravel_index(np.argmax(gain), gain.shape)
        if gain[i, j] <= 1e-9 * max(step.max(), 1e-300):
            break
        order[i:j + 1] = order[i:j + 1][::-1]
    return order.tolist()


def _means(image: np.ndarray, first_row: int, first_column: int, size: int, shape: tuple[int, int]) -> np.ndarray:
    """Means over two rows of each square  # (ny, nx)"""
    ny, nx = shape
    rows = first_row + size * np.arange(ny)[:, None] + np.arange(0, size, max(1, (size + 1) // 2))
    values = image[rows.ravel(), first_column:first_column + nx * size].reshape(ny, -1, nx, size)
    totals = values.sum(axis=3, dtype=np.int64 if image.dtype.kind in "ui" else float).sum(axis=1)
    return totals / (rows.shape[1] * size)
