"""Start of a frame that has moved by more than a speckle: correlation of subsets by FFT, or features where the surface
has turned too; then a blur pyramid.

The start must be right within a fraction of a speckle; the full images give the result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import scipy
from scipy import sparse

from idic.correlation import PixelMap, ReferenceImage
from idic.measure.dic.frame import dic_frame
from idic.measure.dic.regularisation import Regularisation, Smoother, build_smoother
from idic.measure.far.consensus import agreed_motion
from idic.measure.far.features import match_features
from idic.fe import Block
from idic.images import prefilter
from idic.windows import smoothed

BLURS_PX = (8.0, 4.0, 2.0)  # a blur of s px converges from starts within about s px
_LENGTH_PER_BLUR = 12.0  # regularisation length over blur: a blurred image has no information on shorter waves
_MAX_SEARCH_PX = 640  # side of the binned images that subsets are searched in
_SUBSETS_PER_SIDE = 6
_SUBSET_SIDE_PX = (20, 56)  # smallest and largest, binned px
_MIN_CORRELATION = 0.4  # normalised correlation of a usable match; unrelated speckle reaches 0.2 to 0.3
_MAX_GRADIENT = 0.6  # of the affine motion


@dataclass(frozen=True, eq=False)
class Level:
    """The reference image blurred."""

    blur_px: float
    reference: ReferenceImage
    smoother: Smoother


def build_pyramid(pixel_map: PixelMap, image: np.ndarray, cells: Sequence[Block], least_length_px: float,
                  degree: int = 3) -> tuple[Level, ...]:
    """Blurred references, coarsest first, each with its own length of mechanical regularisation.

    image : (ny, nx) reference image; least_length_px : regularisation length of the full images.
    """
    smoother = build_smoother(pixel_map.nodes_px, cells, Regularisation.smooth())
    levels = []
    for blur in BLURS_PX:
        blurred = scipy.ndimage.gaussian_filter(np.asarray(image, dtype=np.float32), blur)
        length = max(_LENGTH_PER_BLUR * blur, least_length_px)
        levels.append(Level(blur, ReferenceImage.of(pixel_map, blurred, degree), replace(smoother, length_px=length)))
    return tuple(levels)


def descend(pyramid: Sequence[Level], image: np.ndarray, start_px: np.ndarray, brightness: str = "frame") -> np.ndarray:
    """Improve a start on ever sharper images  # start_px (n_nodes, 2) -> (n_nodes, 2) px

    image : (ny, nx), the frame. A level that diverges is skipped.
    """
    u = start_px
    for level in pyramid:
        blurred = scipy.ndimage.gaussian_filter(np.asarray(image, dtype=np.float32), level.blur_px)
        spline = prefilter(blurred, level.reference.degree)
        frame = dic_frame(level.reference, spline, u, level.smoother, brightness, tolerance=0.02 * level.blur_px,
                          max_iterations=8)
        moved = np.abs(frame.u_full_px - u).max()
        if frame.n_pixels and moved < 20 * level.blur_px:  # not nan either
            u = frame.u_full_px
    return u


def feature_motion(reference: ReferenceImage, smoother: Smoother, image_from: np.ndarray,
                   image_to: np.ndarray) -> np.ndarray | None:
    """Motion of the mesh from the reference image, however far and turned: by features
    that agree on a smooth one.

    Parameters
    ----------
    smoother : mechanical, of the mesh
    image_from, image_to : arrays (ny, nx), the reference image and the frame

    Returns
    -------
    array (n_nodes, 2) px, or None where too few features agree
    """
    pixel_map = reference.pixel_map
    matches = match_features(image_from, image_to, pixel_map.nodes_px[pixel_map.visible_nodes])
    number = pixel_map.to_image(np.arange(pixel_map.n_pixels, dtype=float), -1.0)
    at = np.clip(np.rint(matches.places).astype(int), 0, np.array(pixel_map.shape[::-1]) - 1)
    pixels = number[at[:, 1], at[:, 0]].astype(int)
    places = pixel_map.shape_matrix()[np.maximum(pixels, 0)]
    places = sparse.csr_array(sparse.diags_array((pixels >= 0).astype(float)) @ places)

    def penalty(length_px: float, n_matches: int) -> sparse.csc_array:
        density = n_matches / max(pixel_map.n_pixels, 1)  # unit weights per px, in the place of squared gradients
        return replace(smoother, length_px=length_px).matrix(density, np.zeros(pixel_map.n_nodes, dtype=bool))

    return agreed_motion(matches, pixel_map.nodes_px, places, penalty)


def coarse_motion(image_from: np.ndarray, image_to: np.ndarray, points_px: np.ndarray,
                  at_px: np.ndarray | None = None) -> np.ndarray | None:
    """Affine motion of the surface between two images: subsets by normalised correlation, outliers left out by vote.

    Parameters
    ----------
    image_from, image_to : arrays (ny, nx)
    points_px : array (n, 2)
        Points of the surface in `image_from`, e.g. the visible nodes: subsets are placed among them.
    at_px : array (m, 2), optional
        Where the motion is wanted; default `points_px`.

    Returns
    -------
    array (m, 2) px, or None where fewer than three subsets agree
    """
    factor = int(np.ceil(max(image_from.shape) / _MAX_SEARCH_PX))
    a, b = binned(image_from, factor), binned(image_to, factor)
    points = (points_px - (factor - 1) / 2) / factor
    side = int(np.clip(np.ptp(points, axis=0).min() / 3, *_SUBSET_SIDE_PX)) // 2 * 2
    centres = subset_centres(points, a.shape, side)
    if len(centres) == 0 or side > min(a.shape):
        return None
    shifts, scores = search_everywhere(a, b, centres, side)
    good = scores > _MIN_CORRELATION
    fit = affine_by_vote(centres[good].astype(float), shifts[good], tolerance=1.0 + 0.03 * side)
    if fit is None:
        return None
    at = points if at_px is None else (at_px - (factor - 1) / 2) / factor
    return factor * (np.column_stack([np.ones(len(at)), at]) @ fit)


def binned(image: np.ndarray, factor: int) -> np.ndarray:
    """Means over squares of `factor` px, smoothed by a pixel of theirs  # (ny, nx) -> (ny / factor, nx / factor)"""
    ny, nx = (n // factor * factor for n in image.shape)
    cut = np.asarray(image[:ny, :nx], dtype=np.float32)
    return smoothed(cut.reshape(ny // factor, factor, nx // factor, factor).mean(axis=(1, 3)), 1.0)


def subset_centres(points: np.ndarray, shape: tuple[int, ...], side: int,
                   per_side: int = _SUBSETS_PER_SIDE) -> np.ndarray:
    """Centres of subsets that lie in the image, spread over the points  # (n, 2) int (column, row)"""
    limit = np.array(shape[::-1]) - 1
    inside = points[((points >= 0) & (points <= limit)).all(axis=1)]
    if len(inside) == 0:
        return np.zeros((0, 2), dtype=int)
    low, extent = inside.min(axis=0), np.maximum(np.ptp(inside, axis=0), 1e-9)
    n = np.clip(np.ceil(2 * extent / side), 1, 2 * per_side)
    n = np.maximum(np.floor(n * min(1.0, np.sqrt(per_side**2 / n.prod()))), 1).astype(int)
    cell = np.minimum((inside - low) / extent * n, n - 1).astype(int)
    key, inverse = np.unique(cell[:, 1] * n[0] + cell[:, 0], return_inverse=True)
    count = np.bincount(inverse)
    centre = np.column_stack([np.bincount(inverse, inside[:, k]) / count for k in range(2)])
    return np.unique(np.clip(np.rint(centre), side // 2, limit + 1 - side // 2).astype(int), axis=0)


def search_everywhere(a: np.ndarray, b: np.ndarray, centres: np.ndarray, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Best shift of every subset of `a` in the whole of `b` and its correlation  # (n, 2) binned px, (n,)"""
    shape = [scipy.fft.next_fast_len(n + side, real=True) for n in b.shape]
    level = b.mean()
    spectrum = scipy.fft.rfft2(b - level, shape)
    half = side // 2
    mean = scipy.ndimage.uniform_filter(b - level, side, mode="constant")
    square = scipy.ndimage.uniform_filter((b - level) ** 2, side, mode="constant")
    spread = np.sqrt(np.maximum(square - mean**2, 0)) * side
    spread = spread[half : b.shape[0] - half + 1, half : b.shape[1] - half + 1]  # at subset positions, by first pixel
    floor = 0.1 * np.median(spread)
    shifts, scores = np.zeros((len(centres), 2)), np.zeros(len(centres))
    for k, (column, row) in enumerate(centres):
        subset = a[row - half : row + half, column - half : column + half]
        subset = subset - subset.mean()
        norm = np.sqrt((subset**2).sum())
        product = scipy.fft.irfft2(spectrum * np.conj(scipy.fft.rfft2(subset, shape)), shape)
        score = product[: spread.shape[0], : spread.shape[1]] / (norm * np.maximum(spread, floor) + 1e-12)
        i, j = np.unravel_index(np.argmax(score), score.shape)
        scores[k] = score[i, j]
        shifts[k] = j + vertex(score[i], j) - (column - half), i + vertex(score[:, j], i) - (row - half)
    return shifts, scores


def vertex(line: np.ndarray, k: int) -> float:
    """Sub-pixel offset of the largest of three neighbours by a parabola."""
    if not 0 < k < len(line) - 1:
        return 0.0
    lower, middle, upper = line[k - 1], line[k], line[k + 1]
    curvature = lower - 2 * middle + upper
    return 0.0 if curvature >= 0 else float(np.clip(0.5 * (lower - upper) / curvature, -0.5, 0.5))


def affine_by_vote(x: np.ndarray, shift: np.ndarray, tolerance: float) -> np.ndarray | None:
    """Affine shift (3, 2) that most matches agree with, refitted on those; a translation where few agree on more."""
    if len(x) < 3:
        return None
    design = np.column_stack([np.ones(len(x)), x])
    triples = np.array(list(combinations(range(len(x)), 3)))
    triples = triples[:: max(1, len(triples) // 4000)]
    area = np.linalg.det(design[triples])
    triples = triples[np.abs(area) > 0.02 * np.abs(area).max()] if np.abs(area).max() > 1e-6 else triples[:0]
    fits = np.linalg.solve(design[triples], shift[triples]) if len(triples) else np.zeros((0, 3, 2))
    fits = fits[np.abs(fits[:, 1:]).max(axis=(1, 2), initial=0.0) < _MAX_GRADIENT]
    still = np.zeros((len(x), 3, 2))
    still[:, 0] = shift  # every single match as a translation
    fits = np.concatenate([fits, still])
    error = np.linalg.norm(np.einsum("ni,kic->knc", design, fits) - shift, axis=2)  # (n_fits, n)
    votes = (error < tolerance).sum(axis=1) - 0.5 * (np.arange(len(fits)) >= len(fits) - len(x))
    best = int(np.argmax(votes))
    agree = error[best] < tolerance
    if agree.sum() < 3:
        return None
    spread = np.linalg.matrix_rank(design[agree] - design[agree].mean(axis=0), tol=5.0)
    if spread < 2 or best >= len(fits) - len(x):
        fit = np.zeros((3, 2))
        fit[0] = shift[agree].mean(axis=0)
        return fit
    return np.linalg.lstsq(design[agree], shift[agree], rcond=None)[0]
