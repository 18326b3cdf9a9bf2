"""Chessboards: inner corners with their place on the board, found by OpenCV and fitted with a model of crossing
edges."""

from __future__ import annotations

import cv2
import numpy as np

from idic.readers.targets.corner_fit import fit_corners
from idic.readers.targets.view import TargetView


def find_chessboard(image: np.ndarray, grid: tuple[int, int]) -> TargetView | None:
    """The inner corners of a chessboard; None where the image does not show all of them.

    Parameters
    ----------
    image : array (ny, nx)
    grid : (int, int)
        Number of inner corners along both axes.
    """
    low, high = np.percentile(image, (0.5, 99.5))
    if not high > low:
        return None
    grey = np.clip((image.astype(np.float32) - low) * (255.0 / (high - low)), 0, 255).astype(np.uint8)
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    is_complete, corners = cv2.findChessboardCornersSB(grey, grid, flags)
    if not is_complete:
        return None
    points = np.asarray(corners, dtype=float).reshape(-1, 2)
    column, row = np.meshgrid(np.arange(grid[0]), np.arange(grid[1]))
    index = np.column_stack([column.ravel(), row.ravel()])
    field = fit_corners(image, points.reshape(grid[1], grid[0], 2))
    along, down = (field[:, -1] - field[:, 0]).sum(axis=0), (field[-1] - field[0]).sum(axis=0)
    if along[0] * down[1] - along[1] * down[0] < 0:  # mirrored: count from the other side
        index[:, 0] = grid[0] - 1 - index[:, 0]
    return TargetView(index, field.reshape(-1, 2))
