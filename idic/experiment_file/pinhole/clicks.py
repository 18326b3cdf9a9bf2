"""Points of the specimen and where a user has clicked them in an image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.images import LensCamera


@dataclass(frozen=True, eq=False)
class Clicks:
    """Points of the mesh frame (n, 3) mm and their places (n, 2) px in the image of a camera; key : in the file."""

    key: str
    camera: LensCamera
    points_mm: np.ndarray
    points_px: np.ndarray
