"""Do the cameras of a rig see the same speckle at the same points of the mesh? A check of calibration and placement.

The reference image of every camera is carried to the nodes and to points between them; of two cameras the correlation
of these grey values is near 1 where calibration, alignment and pairing of images are right. No result uses it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from idic.correlation.pinhole.ray_map import build_ray_map
from idic.correlation.views.pinhole_view import in_space
from idic.correlation.pixels.pixel_map import PixelMap
from idic.errors import InputError
from idic.fe import Mesh
from idic.images import PlacedCamera

COARSE_PX = 4.0   # blur before a comparison that has to survive a rough alignment
MIN_POINTS, MAX_POINTS = 200, 200_000  # of an image; more are thinned out
MAX_APART_PX = 5.0  # between a point and what another camera shows in its place; more: another face hides it


@dataclass(frozen=True, eq=False)
class Seen:
    """A camera with its reference image (ny, nx) and the face set that it sees."""

    camera: PlacedCamera
    image: np.ndarray
    surface: str | None


@dataclass(frozen=True)
class Agreement:
    """Of two cameras: correlation of the grey values at common material points, -1 … 1, NaN where they share too few;
    share : of the points that the first sees, those that the second sees as well."""

    correlation: float
    share: float


def speckle_agreement(mesh: Mesh, first: Seen, second: Seen, blur_px: float = 0.0) -> Agreement:
    """How two cameras agree on the speckle; blur_px : of both images first."""
    every = max(1, int(np.ceil(np.sqrt(first.image.size / MAX_POINTS))))
    sampled, targets = (np.zeros(view.image.shape, dtype=bool) for view in (first, second))
    sampled[::every, ::every] = True
    ny, nx = second.image.shape
    try:
        pixels = _ray_map(mesh, first, sampled)
        places = pixels.interpolate(in_space(mesh.nodes))
        at = second.camera.project(places)
        column, row = np.rint(at).astype(int).T
        inside = (column >= 0) & (column < nx) & (row >= 0) & (row < ny)
        targets[row[inside], column[inside]] = True
        target_map = _ray_map(mesh, second, targets)
    except InputError:
        return Agreement(float("nan"), 0.0)
    images = [scipy.ndimage.gaussian_filter(np.asarray(view.image, dtype=float), blur_px) for view in (first, second)]
    inside = seen_as_well(places, second.camera, target_map, in_space(mesh.nodes))
    share = float(inside.mean())
    if inside.sum() < MIN_POINTS:
        return Agreement(float("nan"), share)
    first_grey = images[0][pixels.iy[inside], pixels.ix[inside]]
    second_grey = scipy.ndimage.map_coordinates(images[1], at[inside, ::-1].T, order=1)
    if first_grey.std() == 0.0 or second_grey.std() == 0.0:
        return Agreement(float("nan"), share)
    return Agreement(float(np.corrcoef(first_grey, second_grey)[0, 1]), share)


def seen_as_well(places: np.ndarray, camera: PlacedCamera, pixel_map: PixelMap, nodes: np.ndarray) -> np.ndarray:
    """Which points a camera sees, and no other face in their place  # places (n, 3), nodes (n_nodes, 3) mm -> (n,) bool

    pixel_map : of this camera
    """
    column, row = np.rint(camera.project(places)).astype(int).T
    ny, nx = pixel_map.shape
    visible = (column >= 0) & (column < nx) & (row >= 0) & (row < ny)
    grid = np.full((ny, nx, 3), np.nan)
    grid[pixel_map.iy, pixel_map.ix] = pixel_map.interpolate(nodes)
    distance = np.linalg.norm(grid[row[visible], column[visible]] - places[visible], axis=1)
    visible[visible] = distance < MAX_APART_PX * camera.pixel_size  # not where it is NaN
    return visible


def _ray_map(mesh: Mesh, view: Seen, mask: np.ndarray) -> PixelMap:
    return build_ray_map(mesh, mesh.surface_cells(view.surface), view.camera, view.image.shape, mask, view.surface)
