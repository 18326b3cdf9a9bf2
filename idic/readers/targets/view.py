"""Points of a calibration target in an image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class TargetView:
    """Points of a target found in one image.

    Attributes
    ----------
    index : int array (n, 2)
        Place of every point on the target, in spacings along its two axes. The axes are right-handed in the image.
    points_px : array (n, 2)
        (column, row) of the corners, or of the centroids of the dots.
    areas_px : array (n,) or None
        Areas of the dots in px²; None for a chessboard.
    unique : bool
        The target has markers that tell its orientation; False: the same up to a rotation of the grid.
    """

    index: np.ndarray
    points_px: np.ndarray
    areas_px: np.ndarray | None = None
    unique: bool = False

    @property
    def n(self) -> int:
        return len(self.index)
