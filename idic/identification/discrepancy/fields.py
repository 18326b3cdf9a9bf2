"""The fields of a discrepancy: where they are in the body, how they go over the frames, and how alike they are.

Motion and stress may be off in smooth fields: bilinear hats on a coarse grid over the body, each with a course over the
frames in linear hats; a channel has a course alone. A unit of a motion field is the rms motion of its frame, of a
stress field the stress of the model, of a channel its simulated value: what the model leaves out grows with what it
describes.

Amplitudes of one kind have one variance. Their correlation falls with the distance in the body and in the recording:

    K = exp(-d^2 / 2 l^2) (x) exp(-|s - s'| / tau)                                (docs/method.md, equation 14.3)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MAX_CELLS = 6  # of the grid along the longer side of the body; half its width otherwise
CELLS = 2.0
MOTION_LENGTH, STRESS_LENGTH = 0.25, 0.35  # correlation length over the body's width
COURSE_LENGTH = 1.0  # correlation length over the recording: what is wrong in one frame is wrong in the next ones
N_COURSES, N_CHANNEL_COURSES = 2, 4
JITTER = 1e-9  # on the diagonal of a correlation matrix whose neighbours are nearly one


@dataclass(frozen=True, eq=False)
class Hats:
    """Bilinear hats on a regular grid.

    values : (n_nodes, p); places : (p, 2) of their tops; width : of the body, in the unit of the points
    """

    values: np.ndarray
    places: np.ndarray
    width: float

    @property
    def n(self) -> int:
        return self.values.shape[1]


def hats_over(points: np.ndarray) -> Hats:
    """Hats over the nodes of a body, seen along its third axis  # points (n_nodes, d)"""
    points = points[:, :2]
    low, extent = points.min(axis=0), np.maximum(np.ptp(points, axis=0), 1e-12 * np.ptp(points))
    spacing = max(extent.min() / CELLS, extent.max() / MAX_CELLS)
    cells = np.maximum(1, np.rint(extent / spacing)).astype(int)
    at = (points - low) / extent * cells
    along = [np.maximum(0.0, 1.0 - np.abs(at[:, k, None] - np.arange(cells[k] + 1))) for k in (0, 1)]
    values = (along[0][:, :, None] * along[1][:, None, :]).reshape(len(points), -1)
    i, j = (part.ravel() for part in np.indices(cells + 1))
    places = low + np.column_stack([i, j]) / cells * extent
    keep = np.flatnonzero(values.any(axis=0))
    return Hats(values[:, keep], places[keep], CELLS * spacing)


def courses(at: np.ndarray, n: int) -> np.ndarray:
    """Linear hats over a coordinate of the frames  # (T,) 0 … 1 -> (T, n)"""
    return np.maximum(0.0, 1.0 - np.abs(at[:, None] * (n - 1) - np.arange(n)))


def field_correlation(hats: Hats, components: int, length: float) -> np.ndarray:
    """Of fields of some components, each for itself, and their courses  # (p components N_COURSES,) squared"""
    squared = ((hats.places[:, None] - hats.places) ** 2).sum(axis=-1)
    space = np.exp(-0.5 * squared / (length * hats.width) ** 2)
    return np.kron(np.kron(np.eye(components), space), course_correlation(N_COURSES))


def course_correlation(n: int) -> np.ndarray:
    """Of the hats of a course  # (n, n)"""
    s = np.linspace(0.0, 1.0, n)
    return np.exp(-np.abs(s[:, None] - s) / COURSE_LENGTH)


def root_of(correlation: np.ndarray) -> np.ndarray:
    """R with R R^T = correlation  # (q, q)"""
    return np.linalg.cholesky(correlation + JITTER * np.eye(len(correlation)))
