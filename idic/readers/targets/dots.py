"""Grids of round dots: blobs of alike ellipses, their grid, and the centroid of each to a hundredth of a pixel.

The centroid is the mean position weighted by darkness against a plane fitted to the ring around the dot: uneven light
does not move it. Three dots with a hollow centre (markers) tell the orientation, and which part of the target is seen.
"""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial import cKDTree

from idic.readers.targets.lattice import grid_index
from idic.readers.targets.view import TargetView

MIN_AREA_PX = 20            # of a dot: five pixels across, below that a centroid depends on the pixel grid
MIN_AXIS_RATIO = 0.25       # of the ellipse: a target tilted by 75 degrees
MAX_AREA_MISFIT = 0.12      # of a contour against its ellipse
MAX_AREA_RATIO = 3.0        # of a dot against the median of all
BLOCKS = (1 / 4, 1 / 12, 1 / 40)  # of the image's height: neighbourhoods of the threshold; small ones hollow large dots
CONTRAST_STEP = 0.12        # of the range of grey values, between a dot and the mean of its neighbourhood
MIN_DOTS = 12
MIN_BACKGROUND = 0.5        # of the contrast: below, the background does not show how the light falls off
HOLLOW = 0.5                # of the contrast: a centre brighter than this is a marker's


def find_dots(image: np.ndarray) -> TargetView | None:
    """The dot grid of an image, dark dots or bright ones; None where there is none.

    Parameters
    ----------
    image : array (ny, nx)
    """
    low, high = np.percentile(image, (0.5, 99.5))
    if not high > low:
        return None
    grey = np.clip((image.astype(np.float32) - low) * (255.0 / (high - low)), 0, 255).astype(np.uint8)
    best, best_grid = None, None
    for block in BLOCKS:  # the largest first: a small one finds rings around dots of the other kind
        for dark in (True, False):
            ellipses = _ellipses(grey if dark else 255 - grey, block)
            chosen, index = grid_index(ellipses[:, :2], _rounding(ellipses))
            if len(chosen) >= MIN_DOTS and (best is None or len(chosen) > 1.05 * best):
                best, best_grid = len(chosen), (ellipses[chosen], index, dark)
    if best_grid is None:
        return None
    ellipses, index, dark = best_grid
    points, areas, hollow = _centroids(image.astype(float) * (-1.0 if dark else 1.0), ellipses)
    good = np.isfinite(points).all(axis=1)
    index, points, areas, hollow = index[good], points[good], areas[good], hollow[good]
    if len(index) < MIN_DOTS:
        return None
    turned = _by_markers(index, hollow)
    return TargetView(index if turned is None else turned, points, np.where(hollow, np.nan, areas), turned is not None)


def _ellipses(grey, block):
    """Alike ellipses: centre, half axes, angle in degrees  # (n, 5) px"""
    size = 2 * int(block * grey.shape[0] / 2) + 3
    binary = cv2.adaptiveThreshold(grey, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, size,
                                   255 * CONTRAST_STEP)
    contours, hierarchy = cv2.findContours(binary, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    fits = []
    for contour, (_, _, _, parent) in zip(contours, [] if hierarchy is None else hierarchy[0], strict=True):
        area = cv2.contourArea(contour)
        if parent >= 0 or len(contour) < 8 or area < MIN_AREA_PX:  # with a parent: the border of a hole
            continue
        (x, y), (a, b), angle = cv2.fitEllipse(contour)
        if not (b > 0 and MIN_AXIS_RATIO < a / b <= 1.0):
            continue
        if abs(area / (np.pi / 4 * a * b) - 1.0) > MAX_AREA_MISFIT + 1 / np.sqrt(area):
            continue
        fits.append((x, y, a / 2, b / 2, angle))
    ellipses = np.array(fits).reshape(-1, 5)
    if len(ellipses) == 0:
        return ellipses
    areas = ellipses[:, 2] * ellipses[:, 3]
    alike = np.abs(np.log(areas / np.median(areas))) < np.log(MAX_AREA_RATIO)
    return _outermost(ellipses[alike])


def _rounding(ellipses):
    """Maps that make each dot a circle of radius 1: there the grid is square, whatever the tilt  # (n, 2, 2)"""
    angle = np.radians(ellipses[:, 4])
    cosine, sine = np.cos(angle), np.sin(angle)
    axes = np.stack([cosine, sine, -sine, cosine], axis=-1).reshape(-1, 2, 2)
    return axes / ellipses[:, 2:4, None]


def _outermost(ellipses):
    """Without the inner contour of a ring."""
    order = np.argsort(-ellipses[:, 2] * ellipses[:, 3])
    outer: list[int] = []
    for i in order:
        if not any(np.hypot(*(ellipses[i, :2] - ellipses[j, :2])) < ellipses[j, 2] for j in outer):
            outer.append(int(i))
    return ellipses[sorted(outer)]


def _centroids(bright, ellipses):
    """Centroids (n, 2), areas (n,) in px², hollow centres (n,), by the weight of each pixel between ring and dot."""
    points, areas = np.full((len(ellipses), 2), np.nan), np.full(len(ellipses), np.nan)
    hollow = np.zeros(len(ellipses), dtype=bool)
    gaps = _gaps(ellipses)
    for n, (x, y, a, b, angle) in enumerate(ellipses):
        reach = min(1.5 * b + 4.0, gaps[n] / 2 + b)
        x0, y0 = int(x - reach), int(y - reach)
        x1, y1 = int(x + reach) + 2, int(y + reach) + 2
        if x0 < 0 or y0 < 0 or x1 > bright.shape[1] or y1 > bright.shape[0]:
            continue  # at the border of the image
        patch = bright[y0:y1, x0:x1]
        column, row = np.meshgrid(np.arange(x0, x1) - x, np.arange(y0, y1) - y)
        cosine, sine = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        u, v = column * cosine + row * sine, row * cosine - column * sine
        margin = max(1.5, min(3.0, gaps[n] / 4))
        inner = (u / (a + margin)) ** 2 + (v / (b + margin)) ** 2 <= 1.0
        ring = ~inner & ((u / (a + 2.5 * margin)) ** 2 + (v / (b + 2.5 * margin)) ** 2 <= 1.0)
        core = (u / max(a - 1.5, 0.5 * a)) ** 2 + (v / max(b - 1.5, 0.5 * b)) ** 2 <= 1.0
        if ring.sum() < 6 or not core.any():
            continue
        basis = np.column_stack([np.ones(ring.sum()), column[ring], row[ring]])
        plane = np.linalg.lstsq(basis, patch[ring], rcond=None)[0]
        above = patch - plane[0] - plane[1] * column - plane[2] * row
        contrast = np.percentile(above[core], 80)
        if abs(plane[0]) > MIN_BACKGROUND * contrast:  # light that falls off dims dot and background alike
            above = above / (1.0 + (plane[1] * column + plane[2] * row) / plane[0])
        if not contrast > 0:
            continue
        hollow[n] = above[(np.abs(u) < max(0.3 * a, 0.8)) & (np.abs(v) < max(0.3 * b, 0.8))].mean() < HOLLOW * contrast
        weight = above[inner]
        points[n] = x + (weight * column[inner]).sum() / weight.sum(), y + (weight * row[inner]).sum() / weight.sum()
        areas[n] = weight.sum() / contrast
    return points, areas, hollow


def _gaps(ellipses):
    """Free distance to the next dot."""
    distance, neighbours = cKDTree(ellipses[:, :2]).query(ellipses[:, :2], k=2)
    return np.maximum(distance[:, 1] - ellipses[:, 3] - ellipses[neighbours[:, 1], 3], 1.0)


def _by_markers(index, hollow):
    """Index turned and counted from the markers, the same in every image; None without markers that tell a
    direction."""
    if not 3 <= hollow.sum() <= max(3, len(index) // 10):
        return None
    turns = [np.array(m) for m in (((1, 0), (0, 1)), ((0, 1), (-1, 0)), ((-1, 0), (0, -1)), ((0, -1), (1, 0)))]
    shapes = []
    for turn in turns:
        markers = index[hollow] @ turn.T
        markers = markers[np.lexsort(markers.T[::-1])]
        shapes.append((tuple((markers - markers[0]).ravel()), tuple(markers[0])))
    first = min(range(4), key=lambda n: shapes[n][0])
    if sum(shape == shapes[first][0] for shape, _ in shapes) > 1:
        return None
    return index @ turns[first].T - np.array(shapes[first][1])
