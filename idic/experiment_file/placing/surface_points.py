"""Points of the surface of a specimen, measured by two calibrated cameras.

A subset of the first image is carried to the mesh at its present place, along its rays by s, and into the second image.
The s of the best correlation is searched first; then the two images are matched to parts of a pixel. The point is where
the ray of the first camera is nearest to that of the second; what separates the rays is the epipolar distance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from idic.correlation import build_ray_map, Seen
from idic.errors import InputError
from idic.fe import Mesh

HALF_PX = 10          # of a subset
MAX_SUBSETS = 300
SEARCH_STEP_PX = 2.0
SEARCH_BLUR_PX, BLUR_PX = 2.0, 0.7
THINNED = 3           # pixels of a subset in the search: every third
N_REFINEMENTS = 6
MIN_CORRELATION = 0.7
MAX_EPIPOLAR_PX = 2.0  # more is a wrong match
MAX_SHIFT_PX = 4.0    # of a match from where the search ended


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Matched subsets.

    rig_mm : (n, 3) measured points, frame of the calibration; mesh_mm, normals : (n, 3) the point of the mesh on the
    same ray of the first camera, and the unit normal there, mesh frame; mm_per_px : (n,) along the normal, by a px in
    the second image; epipolar_px : (n,); n_tried : subsets
    """

    rig_mm: np.ndarray
    mesh_mm: np.ndarray
    normals: np.ndarray
    mm_per_px: np.ndarray
    epipolar_px: np.ndarray
    n_tried: int


def surface_points(mesh: Mesh, first: Seen, second: Seen, search_px: float) -> SurfacePoints:
    """Measure the surface where both cameras see it.

    search_px : how far the place of the mesh may be off, in the second image
    """
    nothing = SurfacePoints(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0), 0)
    try:
        values, points = _subsets(mesh, first)
    except InputError:
        return nothing
    if not len(values):
        return nothing
    camera, lens, second_lens = first.camera, first.camera.aimed, second.camera.aimed
    rig = points @ camera.rotation.T + camera.translation_mm
    ray = rig - lens.centre_mm
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    mid = rig.shape[1] // 2
    slope = np.einsum("ncd,nd->nc", second_lens.jacobian(rig[:, mid]), ray[:, mid])  # px of the second image per mm
    per_mm = np.maximum(np.linalg.norm(slope, axis=1), 1e-9)
    at = _searched(values, first.image, second.image, rig, ray, second_lens, per_mm, search_px)
    moved = rig + (at / per_mm)[:, None, None] * ray
    places = second_lens.project(moved.reshape(-1, 3)).reshape(*moved.shape[:2], 2)
    fine = scipy.ndimage.gaussian_filter(np.asarray(second.image, dtype=float), BLUR_PX)
    shift, correlation = _matched(values, fine, places)
    target, depth = places[:, mid] + shift, at / per_mm
    for _ in range(4):  # nearest point of the ray, in the second image
        nearest = rig[:, mid] + depth[:, None] * ray[:, mid]
        slope = np.einsum("ncd,nd->nc", second_lens.jacobian(nearest), ray[:, mid])
        off = target - second_lens.project(nearest)
        depth = depth + (slope * off).sum(axis=1) / np.maximum((slope**2).sum(axis=1), 1e-18)
    nearest = rig[:, mid] + depth[:, None] * ray[:, mid]
    epipolar = np.linalg.norm(target - second_lens.project(nearest), axis=1)
    good = (correlation > MIN_CORRELATION) & (epipolar < MAX_EPIPOLAR_PX) & (np.linalg.norm(shift, axis=1)
                                                                             < MAX_SHIFT_PX)
    normals = _normals(points)
    across = np.einsum("nd,nd->n", normals, ray[:, mid] @ camera.rotation)
    normals *= -np.sign(across)[:, None]
    return SurfacePoints(nearest[good], points[good, mid], normals[good], (np.abs(across) / per_mm)[good],
                         epipolar[good], len(values))


def _subsets(mesh: Mesh, view: Seen) -> tuple[np.ndarray, np.ndarray]:
    """Grey values (n, m) and mesh points (n, m, 3) of subsets that lie wholly on the surface."""
    ny, nx = view.image.shape
    cells = mesh.surface_cells(view.surface)
    nodes = np.unique(np.concatenate([block.connectivity.ravel() for block in cells]))
    px = view.camera.project(mesh.nodes[nodes])
    low = np.clip(np.floor(px.min(axis=0)), 0, [nx - 1, ny - 1]).astype(int)
    high = np.clip(np.ceil(px.max(axis=0)), 0, [nx - 1, ny - 1]).astype(int)
    step = max(2 * HALF_PX + 1, int(np.sqrt(float(np.prod(high - low + 1)) / MAX_SUBSETS)))
    columns, rows = (np.arange(low[k] + HALF_PX, high[k] - HALF_PX + 1, step) for k in (0, 1))
    grid = np.arange(-HALF_PX, HALF_PX + 1)
    row = (rows[:, None, None, None] + grid[None, None, :, None]) + 0 * (columns[None, :, None, None] + grid)
    column = (columns[None, :, None, None] + grid[None, None, None, :]) + 0 * row
    row, column = (a.reshape(-1, len(grid) ** 2) for a in (row, column))
    mask = np.zeros((ny, nx), dtype=bool)
    mask[row, column] = True
    pixel_map = build_ray_map(mesh, cells, view.camera, (ny, nx), mask, view.surface)
    number = np.full((ny, nx), -1)
    number[pixel_map.iy, pixel_map.ix] = np.arange(pixel_map.n_pixels)
    complete = (number[row, column] >= 0).all(axis=1)
    row, column = row[complete], column[complete]
    points = pixel_map.interpolate(mesh.nodes)
    points = points if points.shape[1] == 3 else np.column_stack([points, np.zeros(len(points))])
    smooth = scipy.ndimage.gaussian_filter(np.asarray(view.image, dtype=float), BLUR_PX)
    return smooth[row, column], points[number[row, column]]


def _searched(values, image, other_image, rig, ray, second_lens, per_mm, search_px) -> np.ndarray:
    """Distance along the rays, in px of the second image, of the best correlation of blurred images  # (n,)"""
    n_side = 2 * HALF_PX + 1
    thin = np.arange(n_side**2).reshape(n_side, n_side)[::THINNED, ::THINNED].ravel()
    blurred = scipy.ndimage.gaussian_filter(np.asarray(other_image, dtype=float), SEARCH_BLUR_PX)
    patches = scipy.ndimage.gaussian_filter(values.reshape(-1, n_side, n_side), (0.0, 1.9, 1.9))
    patches = _normalised(patches.reshape(len(values), -1)[:, thin])
    best, at = np.full(len(rig), -np.inf), np.zeros(len(rig))
    for k in np.arange(-search_px, search_px + 0.5 * SEARCH_STEP_PX, SEARCH_STEP_PX):
        moved = rig[:, thin] + (k / per_mm)[:, None, None] * ray[:, thin]
        try:
            places = second_lens.project(moved.reshape(-1, 3)).reshape(*moved.shape[:2], 2)
        except InputError:  # behind the camera
            continue
        samples = scipy.ndimage.map_coordinates(blurred, [places[..., 1], places[..., 0]], order=1, mode="nearest")
        correlation = (patches * _normalised(samples)).sum(axis=1)
        at, best = np.where(correlation > best, k, at), np.maximum(correlation, best)
    return at


def _matched(values: np.ndarray, image: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shift (n, 2) px of subsets in the second image by Gauss-Newton with gain and offset, and the correlation (n,)."""
    spline = scipy.ndimage.spline_filter(image, order=3, mode="mirror")

    def sampled(at):
        return scipy.ndimage.map_coordinates(spline, [at[..., 1], at[..., 0]], order=3, mode="mirror", prefilter=False)

    shift = np.zeros((len(values), 2))
    ny, nx = image.shape
    for _ in range(N_REFINEMENTS):
        at = places + shift[:, None, :]
        grey = sampled(at)
        slopes = [sampled(at + move) - sampled(at - move) for move in np.array([[0.5, 0.0], [0.0, 0.5]])]
        columns = np.stack([grey, *slopes, np.ones_like(grey)], axis=2)
        normal = np.einsum("nma,nmb->nab", columns, columns)
        normal += 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(4)
        gain, by_column, by_row, _ = np.linalg.solve(normal, np.einsum("nma,nm->na", columns, values)[..., None])[
            ..., 0].T
        step = np.column_stack([by_column, by_row]) / np.where(np.abs(gain) > 0.1, gain, np.inf)[:, None]
        shift = shift + np.clip(step, -1.0, 1.0)
    at = places + shift[:, None, :]
    inside = ((at >= 0.0) & (at <= [nx - 1.0, ny - 1.0])).all(axis=(1, 2))
    return shift, np.where(inside, (_normalised(values) * _normalised(sampled(at))).sum(axis=1), -1.0)


def _normalised(values: np.ndarray) -> np.ndarray:
    away = values - values.mean(axis=1, keepdims=True)
    return away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)


def _normals(points: np.ndarray) -> np.ndarray:
    """Unit normals of the planes through groups of points  # (n, m, 3) -> (n, 3)"""
    away = points - points.mean(axis=1, keepdims=True)
    return np.linalg.eigh(np.einsum("nma,nmb->nab", away, away))[1][:, :, 0]
