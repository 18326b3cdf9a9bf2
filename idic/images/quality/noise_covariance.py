"""Noise that is correlated between neighbours: its covariance, from consecutive images in which the specimen moves.

Demosaicing, compression and in-camera filters smooth the noise. Sums against the gradient of the pattern, the only
quantities of a correlation, then have more noise than with white noise of the same pixels. The difference of two
consecutive images shows the noise after everything else is removed: in small tiles, aligned to the pixel, a change of
brightness, the remaining motion (odd derivatives of the mean image; even ones cancel) and its gradient are fitted and
subtracted by least squares. No image is interpolated, so the noise is that of the camera (docs/method.md, section 11).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from idic.images.gaussian_lowpass import lowpass, lowpass_weights
from idic.images.stack import Stack

TILES_PX = (24, 16, 12)  # sides of a tile: the largest of which enough lie on the specimen
MAX_LAG_PX = 4  # of the covariance; noise of demosaicing and of compression is correlated over 2 to 3 px
MAX_TILES = 48  # of one pair
MAX_PAIRS = 6
MIN_GOOD_TILES = 8  # tile differences; fewer tell nothing
ENOUGH_TILES = 16  # of one pair; a narrow specimen holds fewer of a large side
MIN_LAG_STANDARD_ERRORS = 3.0  # of a lag's correlation; below, it is chance
MAX_SEARCH_PX = 4  # of a tile around the motion of its neighbourhood
BEST_PAIRS_PART = 1 / 2  # of the pairs, those with the least scatter
MAX_DIRECTION_RATIO = 1.3  # of the variance in one component of the gradient over that in both; noise in lines has more
MAX_TILE_VARIANCE_RATIO = 1.5  # of a tile's over the median; above, something but noise is in it
FIRST = np.array([-1.0, 0.0, 1.0]) / 2.0
WIDE = np.array([-1.0, 0.0, 0.0, 0.0, 1.0]) / 4.0
WIDER = np.array([-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]) / 6.0
MAX_CALIBRATED_TILES = 48  # whose loss by the fit is computed
CALIBRATION_ROUNDS = 6  # of the fixed point, which takes a fifth of the rest each time
MARGIN_PX = 3  # half the widest stencil


@dataclass(frozen=True, eq=False)
class NoiseCovariance:
    """Noise of one image with its correlation between neighbours.

    std_gv : of a pixel (GV)
    correlation : (2 L + 1, 2 L + 1) between pixels so many rows and columns apart, 1 in the middle
    sum_std_gv : standard deviation of independent pixel noise that would give sums against the gradient of the
    low-passed image the same scatter (GV)
    relative_uncertainty : of sum_std_gv
    tiles : tile differences that were used
    """

    std_gv: float
    correlation: np.ndarray
    sum_std_gv: float
    relative_uncertainty: float
    tiles: int

    @classmethod
    def of(cls, stack: Stack, frames: Sequence[int], region: np.ndarray,
           lowpass_px: float) -> NoiseCovariance | None:
        """Covariance of the noise from consecutive images of a series; None where too few tiles are usable.

        Parameters
        ----------
        frames : image numbers in the order of recording
        region : (ny, nx) bool, the specimen in the first of them
        lowpass_px : low-pass of the images before correlation; the covariance is that before it
        """
        corners, side = tile_corners(region)
        pairs = _chosen_pairs(len(frames))
        if len(corners) == 0 or not pairs:
            return None
        moved = corners.copy()  # where the material of each tile is
        noise_of_pairs: list[list[TileNoise]] = []
        image, image_number = np.asarray(stack.frame(frames[0]), np.float32), 0
        for first in sorted(pairs):
            if first != image_number:
                newer_image = np.asarray(stack.frame(frames[first]), np.float32)
                moved, image, image_number = moved + _motion(image, newer_image, moved, side), newer_image, first
            next_image = np.asarray(stack.frame(frames[first + 1]), np.float32)
            step = _motion(image, next_image, moved, side)
            noise_of_pairs.append(_pair_noise(image, next_image, moved, step, side, lowpass_px))
            moved, image, image_number = moved + step, next_image, first + 1
        return pooled(noise_of_pairs)


@dataclass(frozen=True)
class TileNoise:
    """Sums over one tile difference, and over white noise of variance 1 that went through the same fit."""

    variance: float  # of one image
    lags: np.ndarray  # (2 L + 1, 2 L + 1) products of the difference with its neighbours
    white_lags: np.ndarray
    weighted: float  # squares of the difference, weighted by that of the gradient
    white_weighted: float
    pattern: np.ndarray  # (2, 2 L + 1, 2 L + 1) products of the gradient with its neighbours, along rows and columns
    basis: np.ndarray  # (t, t, k) orthonormal columns that were fitted out
    square: np.ndarray  # (t, t) of the gradient

    @property
    def in_sums(self) -> float:
        """Variance where the gradient is large."""
        return self.weighted / max(self.white_weighted, 1e-300)


def _chosen_pairs(n: int) -> list[int]:
    if n < 2:
        return []
    return sorted({int(k) for k in np.linspace(0, n - 2, min(MAX_PAIRS, n - 1)).round()})


def tile_corners(region: np.ndarray) -> tuple[np.ndarray, int]:
    """First pixels of the tiles that lie wholly on the specimen, and their side: the largest with enough of them.

    Returns
    -------
    array (n, 2) row, column, none where no tile fits; side (px)
    """
    total = np.pad(np.cumsum(np.cumsum(region, axis=0, dtype=np.int64), axis=1), ((1, 0), (1, 0)))
    best, best_side = np.zeros((0, 2), int), TILES_PX[0]
    for side in TILES_PX:
        corners = _corners(total, side)
        if len(corners) > len(best):
            best, best_side = corners, side
        if len(best) >= ENOUGH_TILES:
            break
    return best[np.unique(np.linspace(0, len(best) - 1, min(MAX_TILES, len(best))).astype(int))], best_side


def _corners(total: np.ndarray, side: int) -> np.ndarray:
    """All tiles of a side; total : (ny + 1, nx + 1) pixels of the specimen above and to the left  # (n, 2)"""
    ny, nx = np.array(total.shape) - 1
    rows, columns = (g.ravel() for g in np.meshgrid(
        np.arange(MARGIN_PX, ny - side - MARGIN_PX, side // 2),
        np.arange(MARGIN_PX, nx - side - MARGIN_PX, side // 2), indexing="ij"))
    inside = (total[rows + side, columns + side] - total[rows, columns + side]
              - total[rows + side, columns] + total[rows, columns]) == side**2
    return np.stack([rows[inside], columns[inside]], axis=1)


def _motion(first: np.ndarray, second: np.ndarray, corners: np.ndarray, side: int) -> np.ndarray:
    """Motion of the tiles to the nearest pixel: of the whole picture first, then of each tile  # (n, 2)"""
    picture_step = _whole_motion(first, second)
    steps = np.zeros_like(corners)
    for i, (row, column) in enumerate(corners):
        tile = _cut(first, row, column, side, 0)
        wide = _cut(second, row + picture_step[0], column + picture_step[1], side, MAX_SEARCH_PX)
        if tile is None or wide is None:
            continue
        windows = np.lib.stride_tricks.sliding_window_view(wide, tile.shape)
        centred = tile - tile.mean()
        means = windows.mean(axis=(2, 3))
        product = np.einsum("abij,ij->ab", windows, centred)
        power = np.einsum("abij,abij->ab", windows, windows) - tile.size * means**2
        best = np.argmax(product / np.sqrt(np.maximum(power, 1e-12)))
        steps[i] = np.array(np.unravel_index(best, product.shape)) - MAX_SEARCH_PX + picture_step
    return steps


def _whole_motion(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Shift of the picture to the nearest pixel, by the peak of its correlation  # (2,)"""
    spectra = [np.fft.rfft2(image - image.mean()) for image in (first, second)]
    peak = np.fft.irfft2(spectra[1] * spectra[0].conj(), s=first.shape)
    place = np.array(np.unravel_index(np.argmax(peak), peak.shape))
    return np.where(place > np.array(first.shape) // 2, place - first.shape, place)


def _cut(image: np.ndarray, row: int, column: int, side: int, margin: int) -> np.ndarray | None:
    low_row, low_column = row - margin, column - margin
    size = side + 2 * margin
    if low_row < 0 or low_column < 0 or low_row + size > image.shape[0] or low_column + size > image.shape[1]:
        return None
    return image[low_row:low_row + size, low_column:low_column + size].astype(float)


def _pair_noise(first: np.ndarray, second: np.ndarray, corners: np.ndarray, steps: np.ndarray, side: int,
                lowpass_px: float) -> list[TileNoise]:
    tiles, rng = [], np.random.default_rng(0)  # the same white noise for every pair: it calibrates the fit
    for (row, column), step in zip(corners, steps, strict=True):
        a = _cut(first, row, column, side, MARGIN_PX)
        b = _cut(second, row + step[0], column + step[1], side, MARGIN_PX)
        white = rng.standard_normal((side, side))
        if a is not None and b is not None:
            tiles.append(tile_noise(a, b, white, lowpass_px))
    return tiles


def tile_noise(a: np.ndarray, b: np.ndarray, white: np.ndarray, lowpass_px: float) -> TileNoise:
    """a, b : (t + 2 m, t + 2 m) two tiles with a margin; white : (t, t) standard normal."""
    mean, inner = (a + b) / 2.0, (slice(MARGIN_PX, -MARGIN_PX),) * 2
    y, x = np.meshgrid(*(np.linspace(-1.0, 1.0, len(white)),) * 2, indexing="ij")
    columns = [np.ones_like(x), mean[inner]]
    for axis in (0, 1):
        slope = _derivative(mean, FIRST, axis)[inner]
        columns += [slope, x * slope, y * slope, _derivative(mean, WIDE, axis)[inner],
                    _derivative(mean, WIDER, axis)[inner]]
    for slope_axis, curvature_axis in ((0, 1), (1, 0)):  # third derivatives across
        columns.append(_derivative(_second(mean, slope_axis), FIRST, curvature_axis)[inner])
    basis, _ = np.linalg.qr(np.stack([c.ravel() for c in columns], axis=1))
    difference = (a - b)[inner].ravel()
    difference = (difference - basis @ (basis.T @ difference)).reshape(x.shape) / np.sqrt(2.0)
    through = (white.ravel() - basis @ (basis.T @ white.ravel())).reshape(x.shape)
    n_dof = x.size - basis.shape[1]
    weights = [lowpass(lowpass(_derivative(mean, FIRST, axis), lowpass_px), lowpass_px)[inner].astype(float)
               for axis in (0, 1)]  # the low-pass acts on the noise, or once more on the gradient
    square = weights[0] ** 2 + weights[1] ** 2
    return TileNoise(float((difference**2).sum()) / n_dof, _lagged(difference), _lagged(through),
                      float((square * difference**2).sum()), float((square * through**2).sum()),
                      np.stack([_lagged(weight) for weight in weights]), basis.reshape(*x.shape, -1), square)


def _derivative(image: np.ndarray, stencil: np.ndarray, axis: int) -> np.ndarray:
    return scipy.ndimage.correlate1d(image, stencil, axis=axis, mode="nearest")


def _second(image: np.ndarray, axis: int) -> np.ndarray:
    return scipy.ndimage.correlate1d(image, np.array([1.0, -2.0, 1.0]), axis=axis, mode="nearest")


def _lagged(values: np.ndarray, factors: np.ndarray | None = None) -> np.ndarray:
    """Sums of products with the others (none: itself) at all lags up to `MAX_LAG_PX`  # (2 L + 1, 2 L + 1)

    values, factors : (t, t), or (t, t, k), summed over k
    """
    size = len(values) + MAX_LAG_PX
    spectrum = scipy.fft.rfft2(values, (size, size), axes=(0, 1))
    factor_spectrum = spectrum if factors is None else scipy.fft.rfft2(factors, (size, size), axes=(0, 1))
    products = spectrum.conj() * factor_spectrum
    sums = scipy.fft.irfft2(products if products.ndim == 2 else products.sum(axis=2), (size, size))
    at = np.arange(-MAX_LAG_PX, MAX_LAG_PX + 1)
    return sums[np.ix_(at, at)]


def _good(tiles: Sequence[TileNoise]) -> list[TileNoise]:
    """The tiles of a pair in which there is nothing but noise; none where these are too few, or one image is a copy."""
    if len(tiles) < MIN_GOOD_TILES:
        return []
    limit = MAX_TILE_VARIANCE_RATIO * float(np.median([tile.variance for tile in tiles]))
    if limit == 0.0:
        return []
    good = [tile for tile in tiles if tile.variance <= limit]
    return good if len(good) >= max(MIN_GOOD_TILES, len(tiles) // 2) else []


def pooled(pairs: Sequence[Sequence[TileNoise]]) -> NoiseCovariance | None:
    """The pairs that show the least: in the others the specimen moved by more than the fit takes out."""
    usable_pairs = sorted((good for tiles in pairs if (good := _good(tiles))),
                          key=lambda tiles: float(np.mean([tile.in_sums for tile in tiles])))
    good = [tile for tiles in usable_pairs[:max(1, int(np.ceil(BEST_PAIRS_PART * len(usable_pairs))))]
            for tile in tiles]
    if not good:
        return None
    independent = len(good) * (len(good[0].square) // 2)**2  # pixels: tiles overlap
    lags, white = (np.sum([getattr(tile, name) for tile in good], axis=0) for name in ("lags", "white_lags"))
    correlation = _correlation(lags, white, independent)
    variance = float(np.mean([tile.variance for tile in good]))
    weighted = sum(tile.weighted for tile in good) / sum(tile.white_weighted for tile in good)
    if np.count_nonzero(correlation) > 1:
        variance, weighted, correlation = _before_fit(good, lags)
        correlation = _without_chance(correlation, independent)
    gain = _gain_of_sums(correlation, [tile.pattern for tile in good])
    uncertainty = np.sqrt(0.5 * float((correlation**2).sum()) / independent)
    return NoiseCovariance(float(np.sqrt(variance)), correlation, float(np.sqrt(max(weighted * gain, 0.0))),
                           float(uncertainty), len(good))


def _gain_of_sums(correlation: np.ndarray, patterns: Sequence[np.ndarray]) -> float:
    """Variance of sums against the gradient over that of independent noise.

    Of both components of the gradient together; of noise along rows or columns that of the component it disturbs most.

    patterns : of the tiles, (2, 2 L + 1, 2 L + 1) each
    """
    gradient_sums, *single = (np.sum([pattern[part].sum(axis=0) for pattern in patterns], axis=0)
                              for part in (slice(2), slice(1), slice(1, 2)))
    gain, *gains = (float((correlation * sums).sum() / sums[MAX_LAG_PX, MAX_LAG_PX])
                    for sums in (gradient_sums, *single))
    return max(gains) if max(gains) > MAX_DIRECTION_RATIO * gain else gain


def _correlation(lags: np.ndarray, white: np.ndarray, independent: int) -> np.ndarray:
    """What the fit takes from white noise is given back; lags that chance explains count as zero."""
    middle = MAX_LAG_PX, MAX_LAG_PX
    correlation = lags / lags[middle] - white / white[middle]
    correlation = 0.5 * (correlation + correlation[::-1, ::-1])
    correlation[middle] = 1.0
    return _without_chance(correlation, independent)


def _without_chance(correlation: np.ndarray, independent: int) -> np.ndarray:
    chance = np.abs(correlation) < MIN_LAG_STANDARD_ERRORS * np.sqrt(2.0 / independent)
    return np.where(chance, 0.0, correlation)


def _before_fit(tiles: Sequence[TileNoise], lags: np.ndarray) -> tuple[float, float, np.ndarray]:
    """What the fit takes from correlated noise is given back: it takes most of what is as smooth as the pattern.

    Fixed point of the covariance whose expected sums after the fit are those found; of as many tiles as tell it.

    Returns
    -------
    variance, weighted variance : of a pixel, and where the gradient is large (GV^2); correlation : (2 L + 1, 2 L + 1)
    """
    sample = tiles[::max(1, len(tiles) // MAX_CALIBRATED_TILES)]
    middle = MAX_LAG_PX, MAX_LAG_PX
    overlap = len(sample[0].square) - np.abs(np.arange(-MAX_LAG_PX, MAX_LAG_PX + 1))
    pixels = np.outer(overlap, overlap) * len(sample)
    measured_sums = 0.5 * (lags + lags[::-1, ::-1]) * (len(sample) / len(tiles))
    covariance = measured_sums / pixels
    for _ in range(CALIBRATION_ROUNDS):
        expected = np.sum([_lags_after_fit(tile.basis, covariance)[0] for tile in sample], axis=0)
        covariance = covariance + (measured_sums - expected) / pixels
    pixel_variances = [_lags_after_fit(tile.basis, covariance / covariance[middle])[1] for tile in sample]
    weighted = (sum(tile.weighted for tile in sample)
                / sum(float((tile.square * variances).sum())
                      for tile, variances in zip(sample, pixel_variances, strict=True)))
    return float(covariance[middle]), float(weighted), covariance / covariance[middle]


def _lags_after_fit(basis: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Expected products at all lags, and variances of the pixels, of noise from which the columns are fitted out.

    basis : (t, t, k) orthonormal; covariance : (2 L + 1, 2 L + 1) of the noise, symmetric

    Returns
    -------
    lags : (2 L + 1, 2 L + 1), variances : (t, t)
    """
    t, reach = len(basis), len(covariance) // 2
    wide = np.pad(basis, ((reach, reach), (reach, reach), (0, 0)))
    coloured_basis = np.zeros_like(basis)
    for i, j in zip(*np.nonzero(covariance), strict=True):
        coloured_basis += covariance[i, j] * wide[i:i + t, j:j + t]
    gram = np.tensordot(basis, coloured_basis, axes=((0, 1), (0, 1)))
    basis_gram = np.tensordot(basis, gram, axes=(2, 0))
    overlap = t - np.abs(np.arange(-reach, reach + 1))
    removed = _lagged(basis, coloured_basis)
    lags = covariance * np.outer(overlap, overlap) - removed - removed[::-1, ::-1] + _lagged(basis, basis_gram)
    variances = covariance[reach, reach] - 2.0 * (basis * coloured_basis).sum(axis=2) + (basis * basis_gram).sum(axis=2)
    return lags, variances


def pixel_gain(correlation: np.ndarray, lowpass_px: float) -> float:
    """Variance of a low-passed pixel over that with independent noise of the same standard deviation."""
    reach = len(correlation) // 2
    weights = np.array(lowpass_weights(lowpass_px))
    passed = np.correlate(np.pad(weights, reach), np.pad(weights, reach), "same")
    middle = len(passed) // 2
    autocorrelation = passed[middle - reach:middle + reach + 1]
    return float((correlation * np.outer(autocorrelation, autocorrelation)).sum() / autocorrelation[reach] ** 2)


def sum_gain(image: np.ndarray, correlation: np.ndarray) -> float:
    """Variance of a sum of the noise against an image, over that of independent noise.

    image : (ny, nx), zero where nothing is summed
    """
    power = float((image.astype(float) ** 2).sum())
    around = scipy.ndimage.convolve(image.astype(float), correlation, mode="constant")
    return float((image * around).sum()) / max(power, 1e-300)


def coloured(white: np.ndarray, correlation: np.ndarray) -> np.ndarray:
    """Standard normal noise (ny, nx) with this correlation between neighbours  # (ny, nx)"""
    from scipy.signal import oaconvolve  # a second to import, and an identification does not need it

    size = 4 * len(correlation)
    spectrum = np.fft.fft2(np.fft.ifftshift(_centred(np.asarray(correlation, float), size))).real
    root = np.fft.fftshift(np.fft.ifft2(np.sqrt(np.maximum(spectrum, 0.0))).real)
    middle, reach = size // 2, len(correlation)
    kernel = root[middle - reach:middle + reach + 1, middle - reach:middle + reach + 1]
    kernel = kernel / np.sqrt((kernel**2).sum())
    return oaconvolve(np.pad(white, reach, mode="wrap"), kernel, mode="valid").astype(white.dtype)


def _centred(small: np.ndarray, size: int) -> np.ndarray:
    padded, first = np.zeros((size, size)), size // 2 - len(small) // 2
    padded[first:first + len(small), first:first + len(small)] = small
    return padded
