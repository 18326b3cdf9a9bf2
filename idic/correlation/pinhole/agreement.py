"""Do the cameras of a rig see the same speckle at the same points of the mesh? A check of calibration and placement.

The reference image of every camera is carried to the nodes and to points between them; of two cameras the correlation
of these grey values is near 1 where calibration, alignment and pairing of images are right. No result uses it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from idic.correlation.pinhole.ray_map import build_ray_map
from idic.errors import InputError
from idic.fe.mesh.mesh import Mesh, surface_cells
from idic.images.placed_camera import PlacedCamera

COARSE_PX = 4.0   # blur before a comparison that has to survive a rough alignment
MIN_POINTS = 200


@dataclass(frozen=True, eq=False)
class Seen:
    """A camera with its reference image (ny, nx) and the face set that it sees."""

    camera: PlacedCamera
    image: np.ndarray
    surface: str | None


def speckle_agreement(mesh: Mesh, one: Seen, two: Seen, blur_px: float = 0.0) -> float:
    """Correlation of the grey values of two cameras at common material points, -1 … 1; NaN where they share too few.

    blur_px : of both images first
    """
    try:
        pixels = build_ray_map(mesh, surface_cells(mesh, one.surface), one.camera, one.image.shape, surface=one.surface)
        other = build_ray_map(mesh, surface_cells(mesh, two.surface), two.camera, two.image.shape, surface=two.surface)
        points = pixels.interpolate(mesh.nodes)
        at = two.camera.project(points)
    except InputError:
        return float("nan")
    images = [gaussian_filter(np.asarray(seen.image, dtype=float), blur_px) for seen in (one, two)]
    owned = np.isfinite(other.to_image(np.zeros(other.n_pixels)))  # what the second camera sees of the mesh
    column, row = np.rint(at).astype(int).T
    ny, nx = two.image.shape
    inside = (column >= 0) & (column < nx) & (row >= 0) & (row < ny)
    inside[inside] = owned[row[inside], column[inside]]
    if inside.sum() < MIN_POINTS:
        return float("nan")
    ours = images[0][pixels.iy[inside], pixels.ix[inside]]
    theirs = map_coordinates(images[1], at[inside, ::-1].T, order=1)
    if ours.std() == 0.0 or theirs.std() == 0.0:
        return float("nan")
    return float(np.corrcoef(ours, theirs)[0, 1])


def agreements(mesh: Mesh, cameras: Sequence[Seen]) -> list[float]:
    """Of the first camera with every other one."""
    return [speckle_agreement(mesh, cameras[0], other) for other in cameras[1:]]
