"""The target in every image of a calibration: which kind it is, and where its points are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.errors import InputError
from idic.readers.targets.chessboard import find_chessboard
from idic.readers.targets.dots import find_dots
from idic.readers.targets.view import TargetView

KINDS = ("chessboard", "dots")
MIN_FILLED = 0.9            # of the points of a dot grid without markers
MIN_BORDER_FILLED = 0.5     # of its outermost rows and columns: with one cut off, the count is ambiguous


def find_target(image: np.ndarray, kind: str, grid: tuple[int, int] | None) -> TargetView | None:
    """The target in one image; None where it is not seen as needed.

    Parameters
    ----------
    image : array (ny, nx)
    kind : "chessboard" | "dots"
    grid : (int, int) or None
        Inner corners, or dots, along both axes. A dot grid with markers needs none.

    Raises
    ------
    InputError
        Where the target needs a grid and none is given.
    """
    if kind == "chessboard":
        return None if grid is None else _first_axis_right(find_chessboard(image, grid))
    view = find_dots(image)
    if view is None or view.unique:
        return view
    if grid is None:
        raise InputError("the target needs its grid", key="--grid",
                         found="none, and no dot grid with three hollow dots",
                         expected="COLUMNSxROWS: inner corners of a chessboard, or dots",
                         remedy="count them, e.g. --grid 11x7")
    return _whole_grid(view, grid)


def kind_of(images, grid: tuple[int, int] | None) -> str:
    """The kind of target that the first images show; "chessboard" where they show a board of this grid, else "dots"."""
    return "chessboard" if any(find_target(image, "chessboard", grid) is not None for image in images) else "dots"


def _first_axis_right(view):
    """The grid counted so that its first axis points to the right of the image."""
    if view is None:
        return None
    largest = view.index.max(axis=0)
    ends = [view.points_px[view.index[:, 0] == i].mean(axis=0) for i in (0, largest[0])]
    return view if ends[1][0] >= ends[0][0] else replace(view, index=largest - view.index)


def _whole_grid(view, grid):
    """The dots of the grid, counted along its axes; None where they are not all seen."""
    for turned in ((False, True) if grid[0] != grid[1] else (False,)):
        index = np.column_stack([view.index[:, 1], -view.index[:, 0]]) if turned else view.index
        index = index - index.min(axis=0)
        window = _window(index, grid)
        if window is not None:
            inside = ((index >= window) & (index < window + np.array(grid))).all(axis=1)
            return _first_axis_right(TargetView(index[inside] - window, view.points_px[inside], view.areas_px[inside]))
    return None


def _window(index, grid):
    size = index.max(axis=0) + 1
    best, place = 0, None
    for i in range(max(size[0] - grid[0] + 1, 0)):
        for j in range(max(size[1] - grid[1] + 1, 0)):
            inside = ((index >= (i, j)) & (index < (i + grid[0], j + grid[1]))).all(axis=1)
            if inside.sum() > best:
                best, place = int(inside.sum()), np.array([i, j])
    if place is None or best < MIN_FILLED * grid[0] * grid[1]:
        return None
    local = index - place
    local = local[((local >= 0) & (local < grid)).all(axis=1)]
    borders = [((local[:, axis] == end).sum(), grid[1 - axis]) for axis in (0, 1) for end in (0, grid[axis] - 1)]
    return place if all(n >= MIN_BORDER_FILLED * full for n, full in borders) else None
