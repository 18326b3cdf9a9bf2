"""Local test of the image residual: is χ² raised in a part of the specimen, whatever its mean?

χ² per pixel of every element is averaged over the element and its neighbours, over the whole recording and over parts
of it in time. The cube root of such a mean is nearly normal; its scatter under noise is taken from the elements
themselves: from those below the median, which a cluster does not reach. Correlated noise widens it like any other, as
it needs no assumption of independent pixels. The largest departure counts with the number of independent neighbourhoods
(Bonferroni).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from scipy import sparse

from idic.correlation import N_NODES, PixelMap, ResidualMap

MAX_FAMILYWISE_P = 1e-5  # of noise; with 1000 neighbourhoods 5.6 standard deviations, of a scatter that is estimated
MIN_CLUSTER_EXCESS = 0.1  # of the median χ²: a displacement error of a few hundredths of a pixel
MIN_PIXEL_SHARE = 0.3  # of the median element's pixels: elements at the rim with fewer scatter too much
MIN_ELEMENTS = 30  # fewer do not tell their own scatter
STD_PER_LOWER_QUARTILE = 1.4826  # standard deviation over median less lower quartile, normal deviates
N_PARTS = 4  # parts of the recording that are tested each


@dataclass(frozen=True, eq=False)
class ElementSums:
    """Sums over some frames: r² over its variance under noise, and pixels, of every element  # (n_elements,) each"""

    chi2: np.ndarray
    pixels: np.ndarray

    def __add__(self, addend: ElementSums) -> ElementSums:
        return ElementSums(self.chi2 + addend.chi2, self.pixels + addend.pixels)

    @classmethod
    def of(cls, pixel_map: PixelMap, residual: ResidualMap, noise_std: float) -> ElementSums:
        """χ² and pixels of every element in one frame."""
        variance = noise_std**2 * (residual.still_gain / residual.n_images + residual.noise_gain)
        squares = np.where(residual.valid, residual.r.astype(float) ** 2 / variance, 0.0)
        start = pixel_map.start[:-1]
        return cls(np.add.reduceat(squares, start), np.add.reduceat(residual.valid.astype(float), start))


@dataclass(frozen=True)
class LocalResidual:
    """The neighbourhood with the largest departure.

    Attributes
    ----------
    is_cluster : bool
        Whether it is significant and large enough to matter.
    chi2, typical_chi2 : float
        χ² per pixel there, and the median over the elements.
    z, p_value : float
        Departure in standard deviations; family-wise probability of noise.
    column, row : float
        Its place in the reference image, px.
    elements : int
        How many elements belong to significant neighbourhoods.
    share : float
        The same as a share of the elements seen.
    part : int or None
        The quarter of the recording that shows it best, 0 to 3; None: the whole of it.
    """

    is_cluster: bool
    chi2: float
    typical_chi2: float
    z: float
    p_value: float
    column: float
    row: float
    elements: int
    share: float
    part: int | None

    @classmethod
    def of(cls, pixel_map: PixelMap, sums: Sequence[ElementSums]) -> LocalResidual | None:
        """The largest local χ² of a recording; None where too few elements are seen.

        sums : of consecutive runs of frames
        """
        if not sums:
            return None
        adjacency = neighbourhoods(pixel_map)
        recording_sums = sums[0]
        for frame_sums in sums[1:]:
            recording_sums = recording_sums + frame_sums
        groups: list[tuple[int | None, ElementSums]] = [(None, recording_sums)]
        if len(sums) >= N_PARTS:
            for part, chosen in enumerate(np.array_split(np.arange(len(sums)), N_PARTS)):
                total = sums[chosen[0]]
                for k in chosen[1:]:
                    total = total + sums[k]
                groups.append((part, total))
        tests = [(part, test) for part, group in groups if (test := _departures(adjacency, group)) is not None]
        if not tests:
            return None
        tried = sum(test.independent for _, test in tests)
        part, departures = max(tests, key=lambda entry: float(entry[1].z.max()))
        significant, worst = departures.significant(tried), int(np.argmax(departures.z))
        pixels = slice(pixel_map.start[worst], pixel_map.start[worst + 1])
        column, row = pixel_map.ix[pixels].mean(), pixel_map.iy[pixels].mean()
        return cls(bool(significant.any()), float(departures.mean[worst]), departures.typical,
                   float(departures.z[worst]),
                   float(min(1.0, tried * scipy.special.ndtr(-departures.z[worst]))), float(column), float(row),
                   int(significant.sum()), float(significant.sum() / departures.usable.sum()), part)


def neighbourhoods(pixel_map: PixelMap) -> sparse.csr_array:
    """Elements that share a node with each element, itself among them  # (n_elements, n_elements) of 0 and 1"""
    n = pixel_map.n_elements
    used = np.arange(pixel_map.conn.shape[1]) < N_NODES[pixel_map.kind][:, None]
    rows = np.repeat(np.arange(n), used.sum(axis=1))
    incidence = sparse.csr_array((np.ones(len(rows)), (rows, pixel_map.conn[used])), shape=(n, pixel_map.n_nodes))
    adjacency = (incidence @ incidence.T).tocsr()
    adjacency.data[:] = 1.0
    return adjacency


@dataclass(frozen=True, eq=False)
class _Departures:
    """z and mean χ² of every neighbourhood, median χ², usable elements, number of independent neighbourhoods."""

    z: np.ndarray
    mean: np.ndarray
    typical: float
    usable: np.ndarray
    independent: float

    def significant(self, tried: float) -> np.ndarray:
        """Neighbourhoods that are significant among so many, and raised enough to matter  # (n_elements,) bool"""
        return (tried * scipy.special.ndtr(-self.z) < MAX_FAMILYWISE_P) & (
            self.mean > (1.0 + MIN_CLUSTER_EXCESS) * self.typical)


def _departures(adjacency: sparse.csr_array, sums: ElementSums) -> _Departures | None:
    """None where too few elements are seen to tell the scatter."""
    usable = sums.pixels >= MIN_PIXEL_SHARE * np.median(sums.pixels)
    if usable.sum() < MIN_ELEMENTS:
        return None
    pixels = adjacency @ np.where(usable, sums.pixels, 0.0)
    mean = adjacency @ np.where(usable, sums.chi2, 0.0) / np.maximum(pixels, 1.0)
    typical = float(np.median(mean[usable]))
    root = np.sqrt(pixels / np.median(pixels[usable]))  # standard deviations fall with the root of the pixels
    scaled = (np.cbrt(mean) - np.cbrt(typical)) * root  # nearly normal (Wilson & Hilferty 1931)
    std = STD_PER_LOWER_QUARTILE * float(np.median(scaled[usable]) - np.quantile(scaled[usable], 0.25))
    if not std > 0.0:
        return None
    size = float(np.mean(adjacency.sum(axis=1)))
    return _Departures(np.where(usable, scaled / std, -np.inf), mean, typical, usable, max(usable.sum() / size, 1.0))
