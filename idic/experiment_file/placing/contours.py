"""Contours in a reference image: the rim of a hole, a straight edge of the specimen.

Both separate an even area (the hole, the background) from the speckle. From the even area outwards, along every
direction, the contour is where the grey value has gone half of the way to the speckle behind it. Where a dot of the
speckle has the grey value of the even area this lies too far out; a random-sample fit of an ellipse or a straight line
leaves these points out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from idic.errors import InputError

STEP_PX = 0.5            # of the samples along a direction
CROSSING_SHARE = 0.3     # of the contrast of the speckle: more is another area
MIN_CONTRAST = 8.0       # of the speckle over the scatter of the even area
PLATEAU_PX = 2.5         # behind a crossing: the grey value there is that of the speckle
INLIER_PX = 0.75
N_TRIALS, PLAIN = 200, 0.7  # at most; share of the points that ends them
MIN_INLIERS, MIN_INLIER_SHARE = 20, 0.3
MIN_HOLE_RADIUS_PX = 6.0
MIN_AXIS_RATIO = 0.3     # of the ellipse
MAX_GAP_DEG = 100.0      # of the rim without a point
EDGE_REACH = 0.12, 10.0, 40.0  # of the length of an edge, at least, at most (px): so far is looked to either side
MIN_IN_IMAGE = 0.8       # of an edge, with what is looked at beside it
EVEN = 0.5               # scatter of the even side of an edge over that of the other side


@dataclass(frozen=True, eq=False)
class Contour:
    """Points (n, 2) px of a contour, the middle (2,) px, and all points where the even area ends (m, 2) px."""

    px: np.ndarray
    middle: np.ndarray
    every: np.ndarray


def hole_contour(image: np.ndarray, at_px: np.ndarray) -> Contour:
    """The rim of the hole that a pixel lies in.

    Raises
    ------
    InputError
        The pixel lies in no even area with an elliptic rim.
    """
    middle, reach = np.array(at_px, dtype=float), 0.5 * max(image.shape)
    ny, nx = image.shape
    if not (1.0 <= middle[0] <= nx - 2.0 and 1.0 <= middle[1] <= ny - 2.0):
        raise _no_hole(at_px, f"a place outside the image of {nx} x {ny} px")
    n = 120
    for _ in range(3):
        angles = 2.0 * np.pi * np.arange(n) / n
        ray = np.column_stack([np.cos(angles), np.sin(angles)])
        length = np.arange(0.0, reach, STEP_PX)
        profiles = _sampled(image, middle + length[None, :, None] * ray[:, None, :])
        core = profiles[:, length <= 3.0]
        first = _crossings(profiles, *_even(core, image))
        if np.isfinite(first).sum() < MIN_INLIERS:
            raise _no_hole(at_px, "no rim around it: the grey value hardly changes")
        points = middle + (STEP_PX * first)[:, None] * ray
        conic, inlier = _ellipse(points[np.isfinite(first)])
        if conic is None:
            raise _no_hole(at_px, "a rim that is no ellipse")
        middle, axes = _centre_and_axes(conic)
        if not np.isfinite(axes).all():
            raise _no_hole(at_px, "a rim that is no ellipse")
        reach, n = min(0.5 * max(image.shape), 1.6 * axes[0] + 10.0), int(np.clip(2.0 * np.pi * axes[0], 60, 720))
    at = angles[np.isfinite(first)][inlier]
    gap = np.degrees(np.diff(np.append(at, at[0] + 2.0 * np.pi)).max()) if len(at) else 360.0
    if axes[1] < MIN_HOLE_RADIUS_PX or axes[1] < MIN_AXIS_RATIO * axes[0] or gap > MAX_GAP_DEG:
        raise _no_hole(at_px, f"an even area of half axes {axes[0]:.1f} and {axes[1]:.1f} px, its rim seen at "
                              f"{len(at)} of {len(angles)} directions")
    points = points[np.isfinite(first)]
    return Contour(points[inlier], middle, points)


def edge_contour(image: np.ndarray, ends_px: np.ndarray) -> Contour:
    """The straight edge of the specimen that runs near the line between two pixels.

    Raises
    ------
    InputError
        There is no straight line between speckle and an even background.
    """
    ends = np.asarray(ends_px, dtype=float)
    length = float(np.linalg.norm(ends[1] - ends[0]))
    along = (ends[1] - ends[0]) / max(length, 1e-9)
    share, least, most = EDGE_REACH
    stations = np.arange(0.05 * length, 0.95 * length)
    normal = np.array([-along[1], along[0]])
    reach = float(np.clip(share * length, least, most))
    while True:
        across = np.arange(-reach, reach + STEP_PX, STEP_PX)
        places = ends[0] + stations[:, None, None] * along + across[None, :, None] * normal
        profiles = _sampled(image, places)
        inside = np.isfinite(profiles).all(axis=1)
        if inside.sum() > MIN_IN_IMAGE * len(inside) or reach <= least:
            break
        reach *= 0.8
    if inside.sum() < MIN_INLIERS:
        raise _no_edge(ends, "a line outside the image, or shorter than 20 px")
    profiles, places = profiles[inside], places[inside]
    outer = np.abs(across) > 0.5 * reach
    low, high = (np.nanstd(profiles[:, outer & side]) for side in (across < 0.0, across > 0.0))
    if min(low, high) > EVEN * max(low, high):
        raise _no_edge(ends, f"grey values that scatter by {low:.0f} and {high:.0f} on its two sides")
    if high < low:  # from the even side on
        profiles, places, across = profiles[:, ::-1], places[:, ::-1], across[::-1]
    even = profiles[:, np.arange(len(across)) < 0.25 * len(across)]
    first = _crossings(profiles, *_even(even, profiles))
    crossed = np.isfinite(first)
    if crossed.sum() < MIN_INLIERS:
        raise _no_edge(ends, "no change of the grey value across it")
    points = places[crossed, 0] + (STEP_PX * first[crossed])[:, None] * np.sign(across[-1] - across[0]) * normal
    inlier = _line(points)
    if inlier.sum() < max(MIN_INLIERS, MIN_INLIER_SHARE * len(stations)):
        raise _no_edge(ends, f"a straight line through {int(inlier.sum())} of {len(stations)} points")
    return Contour(points[inlier], points[inlier].mean(axis=0), points)


def on_circle(points: np.ndarray) -> np.ndarray:
    """Which points lie on the circle through most of them  # (n, 2) px, of a plane -> (n,)"""
    rng, best, score = np.random.default_rng(0), np.zeros(len(points), dtype=bool), -np.inf
    chosen = np.array([rng.choice(len(points), 3, replace=False) for _ in range(N_TRIALS)])
    for three in points[chosen]:
        system = np.column_stack([2.0 * three, np.ones(3)])
        if abs(np.linalg.det(system)) < 1e-9:
            continue
        x, y, constant = np.linalg.solve(system, (three**2).sum(axis=1))
        off = np.hypot(*(points - [x, y]).T) - np.sqrt(max(constant + x * x + y * y, 0.0))
        inlier = np.abs(off) < INLIER_PX
        if (trial_score := inlier.sum() - (off < -INLIER_PX).sum()) > score:  # as of an ellipse
            best, score = inlier, trial_score
    return best


def _sampled(image: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Grey values, NaN outside the image  # (..., 2) px -> (...)"""
    ny, nx = image.shape
    inside = ((places >= 0.0) & (places <= [nx - 1.0, ny - 1.0])).all(axis=-1)
    values = scipy.ndimage.map_coordinates(image, [places[..., 1], places[..., 0]], order=1, mode="nearest")
    return np.where(inside, values, np.nan)


def _even(area: np.ndarray, around: np.ndarray) -> tuple[float, float]:
    """Grey value of an even area, and the distance from it that is another area."""
    level = float(np.nanmedian(area))
    scatter = 1.4826 * float(np.nanmedian(np.abs(area - level)))
    contrast = float(np.nanpercentile(np.abs(around - level), 90))
    return level, max(CROSSING_SHARE * contrast, 0.5 * MIN_CONTRAST * scatter, 1e-9)


def _crossings(profiles: np.ndarray, level: float, threshold: float) -> np.ndarray:
    """Sample (fraction) at which each profile has gone half of the way; NaN where it does not leave the level."""
    away = np.abs(profiles - level)
    n, m = away.shape
    row, over = np.arange(n), np.nan_to_num(away) > threshold
    first = np.argmax(over, axis=1)
    valid = over[row, first]
    valid &= ~np.isnan(away).any(axis=1) | (first < np.argmax(np.isnan(away), axis=1))
    plateau = np.minimum(first[:, None] + np.arange(int(PLATEAU_PX / STEP_PX) + 1), m - 1)
    half = 0.5 * np.nan_to_num(away[row[:, None], plateau]).max(axis=1)
    k = np.argmax(np.nan_to_num(away) > half[:, None], axis=1)
    low, high = away[row, np.maximum(k - 1, 0)], away[row, k]
    valid &= (k > 0) & (high > low)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(valid, k - 1 + (half - low) / (high - low), np.nan)


def _ellipse(points: np.ndarray) -> tuple[np.ndarray | None, np.ndarray]:
    """Conic through most of the points, and which these are."""
    rng, middle = np.random.default_rng(0), points.mean(axis=0)
    size = max(float(np.abs(points - middle).max()), 1e-9)
    unit = (points - middle) / size
    best, most, score = None, np.zeros(len(points), dtype=bool), -np.inf
    for _ in range(N_TRIALS):
        conic = _conic(unit[rng.choice(len(unit), 6, replace=False)])
        if conic is None:
            continue
        off = _conic_distance(conic, unit) * size
        inlier = np.abs(off) < INLIER_PX
        if (trial_score := inlier.sum() - (off < -INLIER_PX).sum()) > score:  # dots move points outwards only
            best, most, score = conic, inlier, trial_score
        if most.sum() > PLAIN * len(unit):
            break
    for _ in range(3 if best is not None else 0):
        refit = _conic(unit[most])
        if refit is None:
            break
        best, most = refit, np.abs(_conic_distance(refit, unit)) * size < INLIER_PX
    if best is None or most.sum() < max(MIN_INLIERS, MIN_INLIER_SHARE * len(points)):
        return None, most
    back = np.array([[1.0 / size, 0.0, -middle[0] / size], [0.0, 1.0 / size, -middle[1] / size], [0.0, 0.0, 1.0]])
    return back.T @ best @ back, most


def _conic(points: np.ndarray) -> np.ndarray | None:
    """Ellipse of least squares as a symmetric matrix (3, 3): Halir and Flusser (1998); None where there is none."""
    x, y = points.T
    quadratic, linear = np.column_stack([x * x, x * y, y * y]), np.column_stack([x, y, np.ones_like(x)])
    try:
        eliminated = -np.linalg.solve(linear.T @ linear, linear.T @ quadratic)
    except np.linalg.LinAlgError:
        return None
    reduced = quadratic.T @ quadratic + quadratic.T @ linear @ eliminated
    values, vectors = np.linalg.eig(np.array([[0.0, 0.0, 0.5], [0.0, -1.0, 0.0], [0.5, 0.0, 0.0]]) @ reduced)
    vectors = np.real(vectors)
    kind = 4.0 * vectors[0] * vectors[2] - vectors[1] ** 2
    if not (kind > 0.0).any() or not np.isfinite(vectors).all():
        return None
    a, b, c = vectors[:, int(np.argmax(kind))]
    d, e, f = eliminated @ [a, b, c]
    return np.array([[a, b / 2, d / 2], [b / 2, c, e / 2], [d / 2, e / 2, f]])


def _conic_distance(conic: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distance of points to first order, negative inside of an ellipse."""
    polar = np.column_stack([points, np.ones(len(points))]) @ conic * np.sign(np.trace(conic[:2, :2]))
    value = (polar[:, :2] * points).sum(axis=1) + polar[:, 2]
    return value / np.maximum(2.0 * np.linalg.norm(polar[:, :2], axis=1), 1e-12)


def _centre_and_axes(conic: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centre (2,) and half axes (2,), the longer one first; NaN of no ellipse."""
    centre = -np.linalg.solve(conic[:2, :2], conic[:2, 2])
    level = conic[2, 2] + conic[2, :2] @ centre
    with np.errstate(invalid="ignore", divide="ignore"):
        axes = np.sqrt(-level / np.linalg.eigvalsh(conic[:2, :2]))
    return centre, np.sort(axes)[::-1]


def _line(points: np.ndarray) -> np.ndarray:
    """Which points lie on the line through most of them."""
    rng, most = np.random.default_rng(0), np.zeros(len(points), dtype=bool)
    for _ in range(N_TRIALS):
        a, b = points[rng.choice(len(points), 2, replace=False)]
        if (inlier := _off(points, a, b - a) < INLIER_PX).sum() > most.sum():
            most = inlier
        if most.sum() > PLAIN * len(points):
            break
    for _ in range(3):
        middle = points[most].mean(axis=0)
        most = _off(points, middle, np.linalg.svd(points[most] - middle)[2][0]) < INLIER_PX
    return most


def _off(points: np.ndarray, start: np.ndarray, along: np.ndarray) -> np.ndarray:
    normal = np.array([-along[1], along[0]]) / max(float(np.linalg.norm(along)), 1e-12)
    return np.abs((points - start) @ normal)


def _no_hole(at_px, observation: str) -> InputError:
    return InputError("no hole there", expected=f"a pixel within an evenly dark or bright hole, near ({at_px[0]:.0f}, "
                      f"{at_px[1]:.0f}) px", found=observation,
                      remedy="give a pixel inside the hole; of a hole with a visible wall or texture behind it, click "
                             "its centre as points_mm and points_px")


def _no_edge(ends, observation: str) -> InputError:
    (a, b), (c, d) = np.round(ends).astype(int)
    return InputError("no edge there", expected=f"a straight edge between speckle and an even background along ({a}, "
                      f"{b}) to ({c}, {d}) px", found=observation,
                      remedy="correct points_px of the edge, or leave it out and click points")
