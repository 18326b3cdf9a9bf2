"""Do the cameras of a rig see the same speckle at the same points of the mesh? A check of calibration and placement.

The reference image of every camera is carried to the nodes and to points between them; of two cameras the correlation
of these grey values is near 1 where calibration, alignment and pairing of images are right. No result uses it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from idic.correlation.pinhole.ray_map import build_ray_map
from idic.correlation.pixels.pixel_map import PixelMap
from idic.errors import InputError
from idic.fe.mesh.mesh import Mesh, surface_cells
from idic.images.placed_camera import PlacedCamera

COARSE_PX = 4.0   # blur before a comparison that has to survive a rough alignment
MIN_POINTS, MAX_POINTS = 200, 200_000  # of an image; more are thinned out


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
    every = max(1, int(np.ceil(np.sqrt(one.image.size / MAX_POINTS))))
    some, wanted = (np.zeros(seen.image.shape, dtype=bool) for seen in (one, two))
    some[::every, ::every] = True
    ny, nx = two.image.shape
    try:
        pixels = _ray_map(mesh, one, some)
        at = two.camera.project(pixels.interpolate(mesh.nodes))
        column, row = np.rint(at).astype(int).T
        inside = (column >= 0) & (column < nx) & (row >= 0) & (row < ny)
        wanted[row[inside], column[inside]] = True
        other = _ray_map(mesh, two, wanted)
    except InputError:
        return float("nan")
    images = [scipy.ndimage.gaussian_filter(np.asarray(seen.image, dtype=float), blur_px) for seen in (one, two)]
    owned = np.isfinite(other.to_image(np.zeros(other.n_pixels)))  # what the second camera sees of the mesh
    inside[inside] = owned[row[inside], column[inside]]
    if inside.sum() < MIN_POINTS:
        return float("nan")
    ours = images[0][pixels.iy[inside], pixels.ix[inside]]
    theirs = scipy.ndimage.map_coordinates(images[1], at[inside, ::-1].T, order=1)
    if ours.std() == 0.0 or theirs.std() == 0.0:
        return float("nan")
    return float(np.corrcoef(ours, theirs)[0, 1])


def _ray_map(mesh: Mesh, seen: Seen, mask: np.ndarray) -> PixelMap:
    return build_ray_map(mesh, surface_cells(mesh, seen.surface), seen.camera, seen.image.shape, mask, seen.surface)


def agreements(mesh: Mesh, cameras: Sequence[Seen]) -> list[float]:
    """Of the first camera with every other one."""
    return [speckle_agreement(mesh, cameras[0], other) for other in cameras[1:]]
