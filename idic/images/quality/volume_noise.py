"""Noise of reconstructed scans and change of their grey values, from two scans of one state.

The noise of a reconstruction is correlated from voxel to voxel, so that sums against the gradient of the texture, the
only quantities of a correlation, have other noise than with independent noise of the same voxels. The difference of two
scans of one state shows it, after a change of brightness, a slow field and a motion by a part of a voxel (odd
derivatives of the mean; even ones cancel) are fitted out of small cubes by least squares. No scan is interpolated.
Rings and other errors that both scans share are not in it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy

from idic.images.gaussian_lowpass import lowpass_weights

MAX_LAG_PX = 4  # of the covariance; windows of reconstructions smooth over 2 to 3 voxels
MARGIN_PX = 3  # half the widest stencil
MIN_CUBES = 4  # fewer tell nothing
MAX_CUBE_VARIANCE_RATIO = 1.5  # of a cube's over the median; above, something but noise is in it
MIN_LAG_STANDARD_ERRORS = 3.0  # of a lag's correlation; below, it is chance
MAX_DIRECTION_RATIO = 1.3  # of the variance in one component of the gradient over that in all three
_STENCILS = tuple(np.array([-1.0, *[0.0] * (2 * n - 1), 1.0]) / (2 * n) for n in (1, 2, 3))
Read = Callable[[slice, slice, slice], np.ndarray]


@dataclass(frozen=True, eq=False)
class VolumeNoise:
    """Noise of one scan with its correlation between neighbours.

    std_gv : of a voxel (GV)
    correlation : (2 L + 1, 2 L + 1, 2 L + 1) between voxels so many planes, rows and columns apart, 1 in the middle
    sum_std_gv : standard deviation of independent voxel noise that would give sums against the gradient of the
    low-passed scan the same scatter (GV)
    relative_uncertainty : of sum_std_gv
    cubes : number of cubes that were used
    """

    std_gv: float
    correlation: np.ndarray
    sum_std_gv: float
    relative_uncertainty: float
    cubes: int


@dataclass(frozen=True, eq=False)
class GreyChange:
    """Grey values of a second scan for those of a first: gain times them plus offset plus a slow field.

    slow_gv : coefficients (GV) of the field in x, y, z, x², y², z², xy, xz, yz less the mean of each, with x, y and z
    from -1 to 1 over the cubes
    """

    gain: float
    offset_gv: float
    slow_gv: np.ndarray

    @property
    def largest_slow_gv(self) -> float:
        """Bound of the slow field over the cubes (GV)."""
        return float(np.abs(self.slow_gv).sum())


def cube_corners(low: Sequence[int], high: Sequence[int], side: int, max_cubes: int = 48) -> np.ndarray:
    """First voxels of cubes that lie in a box with their margins, evenly chosen  # (n, 3) plane, row, column

    low, high : (3,) first voxel of the box along planes, rows and columns, and the one behind its last
    """
    starts = [np.arange(a + MARGIN_PX, b - side - MARGIN_PX + 1, side) for a, b in zip(low, high, strict=True)]
    corners = np.array(list(product(*starts)), dtype=int).reshape(-1, 3)
    return corners[np.unique(np.linspace(0, len(corners) - 1, min(max_cubes, len(corners))).astype(int))]


def whole_shift(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Motion from one block to another to the nearest voxel, by the peak of their correlation  # (3,)"""
    spectra = [scipy.fft.rfftn(block - np.mean(block, dtype=float)) for block in (first, second)]
    peak = scipy.fft.irfftn(spectra[1] * spectra[0].conj(), s=first.shape)
    place = np.array(np.unravel_index(np.argmax(peak), peak.shape))
    return np.where(place > np.array(first.shape) // 2, place - first.shape, place)


def volume_noise(first: Read, second: Read, corners: np.ndarray, side: int, lowpass_px: float = 0.0,
                 shift: Sequence[int] = (0, 0, 0)) -> VolumeNoise | None:
    """Noise of one of two scans of one state; None where too few cubes are usable, or the scans are copies.

    Parameters
    ----------
    first, second : callable (z, y, x slices) -> array
        Blocks of the scans, such as `VolumeEntry.block`.
    corners : (n, 3)
        Cubes in the first scan, see `cube_corners`.
    side : int
        Of a cube, in voxels; 16 or more.
    lowpass_px : float
        Low-pass of the scans before correlation; the covariance is that before it.
    shift : (3,)
        Motion of the specimen to the nearest voxel, see `whole_shift`.
    """
    sums = [entry for corner in corners
            if (entry := _cube_noise(*_cubes(first, second, corner, side, shift), lowpass_px)) is not None]
    variances = np.array([entry.variance for entry in sums])
    if len(sums) < MIN_CUBES or not np.median(variances) > 0.0:
        return None
    good = [entry for entry in sums if entry.variance <= MAX_CUBE_VARIANCE_RATIO * np.median(variances)]
    if len(good) < MIN_CUBES:
        return None
    n_voxels = len(good) * side**3
    lags = np.sum([entry.lags for entry in good], axis=0)
    middle = (MAX_LAG_PX,) * 3
    correlation = 0.5 * (lags + lags[::-1, ::-1, ::-1]) / lags[middle]
    correlation[np.abs(correlation) < MIN_LAG_STANDARD_ERRORS * np.sqrt(2.0 / n_voxels)] = 0.0
    weighted = sum(entry.weighted for entry in good) / sum(entry.weight for entry in good)
    gain = _gain_of_sums(correlation, np.sum([entry.pattern for entry in good], axis=0))
    uncertainty = float(np.sqrt(0.5 * (correlation**2).sum() / n_voxels))
    return VolumeNoise(float(np.sqrt(np.mean([entry.variance for entry in good]))), correlation,
                       float(np.sqrt(max(weighted * gain, 0.0))), uncertainty, len(good))


def grey_change(first: Read, second: Read, corners: np.ndarray, side: int, shift: Sequence[int] = (0, 0, 0)
                ) -> GreyChange:
    """The change of the grey values from one scan to another of nearly the same state. Arguments as in `volume_noise`.

    The difference is compared with the mean of both, whose noise is not correlated with it.
    """
    places = corners + 0.5 * (side - 1)
    centre = 0.5 * (places.max(axis=0) + places.min(axis=0))
    half = np.maximum(0.5 * np.ptp(places, axis=0) + 0.5 * side, 1.0)
    moments = []
    for corner in corners:
        axes = [(corner[a] + np.arange(side) - centre[a]) / half[a] for a in range(3)]
        moments.append(np.mean(_slow_terms(axes), axis=1))
    means = np.mean(moments, axis=0)
    matrix, right = np.zeros((11, 11)), np.zeros(11)
    for corner in corners:
        a, b = _cubes(first, second, corner, side, shift)
        mean, difference = 0.5 * (a + b), (b - a)[_INNER].ravel()
        axes = [(corner[k] + np.arange(side) - centre[k]) / half[k] for k in range(3)]
        columns = np.stack([mean[_INNER].ravel(), np.ones(side**3), *(_slow_terms(axes) - means[:, None])])
        motion, _ = np.linalg.qr(np.stack([_slope(mean, _STENCILS[0], axis)[_INNER].ravel() for axis in range(3)]).T)
        columns = columns - (columns @ motion) @ motion.T
        matrix += columns @ columns.T
        right += columns @ difference
    slope, constant, *slow = np.linalg.lstsq(matrix, right, rcond=None)[0]
    scale = 1.0 / (1.0 - 0.5 * slope)
    return GreyChange(float((1.0 + 0.5 * slope) * scale), float(constant * scale), scale * np.array(slow))


_INNER = (slice(MARGIN_PX, -MARGIN_PX),) * 3


@dataclass(frozen=True, eq=False)
class _CubeNoise:
    """Sums over one cube.

    variance : of one scan; lags : products of the difference with its neighbours; weighted : squares of the difference,
    weighted by that of the gradient; weight : sum of the weights; pattern : (3, ...) products of the gradient likewise
    """

    variance: float
    lags: np.ndarray
    weighted: float
    weight: float
    pattern: np.ndarray


def _cubes(first: Read, second: Read, corner: np.ndarray, side: int, shift: Sequence[int]
           ) -> tuple[np.ndarray, np.ndarray]:
    """A cube with its margin in both scans  # (side + 2 m, …) each"""
    blocks = []
    for read, offset in ((first, np.zeros(3, int)), (second, np.asarray(shift, int))):
        low = corner + offset - MARGIN_PX
        blocks.append(np.asarray(read(*(slice(max(int(k), 0), int(k) + side + 2 * MARGIN_PX) for k in low)), float))
    return blocks[0], blocks[1]


def _cube_noise(a: np.ndarray, b: np.ndarray, lowpass_px: float) -> _CubeNoise | None:
    """None where a cube leaves one of the scans, or holds no texture."""
    if a.shape != b.shape or len(set(a.shape)) != 1:
        return None
    mean = 0.5 * (a + b)
    side = len(a) - 2 * MARGIN_PX
    z, y, x = np.meshgrid(*(np.linspace(-1.0, 1.0, side),) * 3, indexing="ij")
    columns = [np.ones_like(x), x, y, z, mean[_INNER]]
    for axis in range(3):
        slopes = [_slope(mean, stencil, axis)[_INNER] for stencil in _STENCILS]
        columns += [*slopes, x * slopes[0], y * slopes[0], z * slopes[0]]
        columns += [_slope(_second(mean, across), _STENCILS[0], axis)[_INNER] for across in range(3) if across != axis]
    basis, _ = np.linalg.qr(np.stack([column.ravel() for column in columns], axis=1))
    difference = (a - b)[_INNER].ravel()
    difference = (difference - basis @ (basis.T @ difference)).reshape(x.shape) / np.sqrt(2.0)
    lost = x.size / (x.size - basis.shape[1])
    gradient = [_lowpassed(_slope(mean, _STENCILS[0], axis), lowpass_px)[_INNER] for axis in range(3)]
    square = np.sum([part**2 for part in gradient], axis=0)
    if not np.any(square > 0.0):
        return None
    return _CubeNoise(float((difference**2).mean()) * lost, _lagged(difference),
                      float((square * difference**2).sum()) * lost, float(square.sum()),
                      np.stack([_lagged(part) for part in gradient]))


def _slow_terms(axes: Sequence[np.ndarray]) -> np.ndarray:
    """Terms of the slow field in a cube  # places along planes, rows and columns (side,) each -> (9, side³)"""
    z, y, x = (part.ravel() for part in np.meshgrid(*axes, indexing="ij"))
    return np.stack([x, y, z, x * x, y * y, z * z, x * y, x * z, y * z])


def _slope(block: np.ndarray, stencil: np.ndarray, axis: int) -> np.ndarray:
    return scipy.ndimage.correlate1d(block, stencil, axis=axis, mode="nearest")


def _second(block: np.ndarray, axis: int) -> np.ndarray:
    return scipy.ndimage.correlate1d(block, np.array([1.0, -2.0, 1.0]), axis=axis, mode="nearest")


def _lowpassed(block: np.ndarray, lowpass_px: float) -> np.ndarray:
    """Twice low-passed: the filter acts on the noise, or once more on the gradient."""
    if lowpass_px <= 0.0:
        return block
    weights = np.convolve(lowpass_weights(lowpass_px), lowpass_weights(lowpass_px))
    for axis in range(3):
        block = scipy.ndimage.correlate1d(block, weights, axis=axis, mode="nearest")
    return block


def _lagged(values: np.ndarray) -> np.ndarray:
    """Mean products with neighbours at all lags up to `MAX_LAG_PX`  # (2 L + 1, 2 L + 1, 2 L + 1)"""
    shape = [n + MAX_LAG_PX for n in values.shape]
    sums = scipy.fft.irfftn(np.abs(scipy.fft.rfftn(values, shape)) ** 2, shape)
    lags = np.arange(-MAX_LAG_PX, MAX_LAG_PX + 1)
    overlap = [n - np.abs(lags) for n in values.shape]
    return sums[np.ix_(lags, lags, lags)] / np.einsum("i,j,k->ijk", *overlap)


def _gain_of_sums(correlation: np.ndarray, pattern: np.ndarray) -> float:
    """Variance of sums against the gradient over that of independent noise: of all components together, or of the one
    that noise in layers or rings disturbs most  # pattern : (3, …) products of the components"""
    middle = (MAX_LAG_PX,) * 3
    gains = [float((correlation * part).sum() / part[middle]) for part in pattern if part[middle] > 0.0]
    total = pattern.sum(axis=0)
    gain = float((correlation * total).sum() / total[middle])
    return max(gains) if max(gains) > MAX_DIRECTION_RATIO * gain else gain
