"""What a reconstruction adds to a scan: noise that is correlated from voxel to voxel, rings, drift of the grey values.

The noise of a filtered back-projection has, in the plane of rotation, the power spectrum of its ramp filter times that
of the smoothing window (Riederer, Pelc, Chesler 1978, doi:10.1088/0031-9155/23/3/008); along the axis the detector
blurs it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class ReconstructionNoise:
    """Normal noise with the spectrum sqrt(k) exp(-(k / cutoff)² / 2) in a plane, k in 1 / voxel.

    std_gv : of a voxel; axial : weights of the planes before, at and behind, along the axis of rotation
    """

    std_gv: float
    cutoff: float = 0.25
    axial: tuple[float, float, float] = (0.25, 0.5, 0.25)

    def planes(self, rng: np.random.Generator, shape: tuple[int, int, int]) -> Iterator[np.ndarray]:
        """The noise of a scan, plane by plane  # shape (nz, ny, nx) -> (ny, nx)"""
        nz, ny, nx = shape
        spectrum = self._spectrum(ny, nx)
        weights = np.array(self.axial)
        scale = self.std_gv / (np.sqrt((weights**2).sum()) * _std_of(spectrum, nx))
        neighbours = [_filtered(rng, spectrum, ny, nx) for _ in range(2)]
        for _ in range(nz):
            neighbours.append(_filtered(rng, spectrum, ny, nx))
            yield scale * sum(weight * plane for weight, plane in zip(weights, neighbours, strict=True))
            del neighbours[0]

    def correlation(self, shape: tuple[int, int], n: int) -> np.ndarray:
        """Correlation of two voxels of a plane at distances along rows and columns  # shape (ny, nx) -> (n, n)"""
        spectrum = self._spectrum(*shape)
        covariance = np.fft.irfft2(spectrum**2, s=shape)
        return covariance[:n, :n] / covariance[0, 0]

    def _spectrum(self, ny: int, nx: int) -> np.ndarray:
        k = np.hypot(np.fft.fftfreq(ny)[:, None], np.fft.rfftfreq(nx)[None])
        return np.sqrt(k) * np.exp(-0.5 * (k / self.cutoff) ** 2)


@dataclass(frozen=True)
class IndependentNoise:
    """Normal noise of independent voxels; std_gv : of a voxel"""

    std_gv: float

    def planes(self, rng: np.random.Generator, shape: tuple[int, int, int]) -> Iterator[np.ndarray]:
        """The noise of a scan, plane by plane  # shape (nz, ny, nx) -> (ny, nx)"""
        for _ in range(shape[0]):
            yield self.std_gv * rng.standard_normal(shape[1:])


def _filtered(rng: np.random.Generator, spectrum: np.ndarray, ny: int, nx: int) -> np.ndarray:
    return np.fft.irfft2(spectrum * np.fft.rfft2(rng.standard_normal((ny, nx))), s=(ny, nx))


def _std_of(spectrum: np.ndarray, nx: int) -> float:
    """Standard deviation of filtered white noise of one."""
    double = np.full(spectrum.shape[1], 2.0)  # of a real signal: the other half of the spectrum
    double[0] = 1.0
    if nx % 2 == 0:
        double[-1] = 1.0
    return float(np.sqrt((spectrum**2 * double).sum() / (spectrum.shape[0] * nx)))


@dataclass(frozen=True, eq=False)
class Rings:
    """Rings about the axis of rotation, of single elements of the detector: the same in all scans.

    heights_gv : (nz, n) of the rings of each plane, by their radius in voxels
    """

    heights_gv: np.ndarray

    def plane(self, k: int, ny: int, nx: int) -> np.ndarray:
        """The rings of plane k  # (ny, nx)"""
        radius = np.hypot(np.arange(ny)[:, None] - (ny - 1) / 2, np.arange(nx) - (nx - 1) / 2)
        return np.interp(radius, np.arange(self.heights_gv.shape[1]), self.heights_gv[k])


def rings(rng: np.random.Generator, shape: tuple[int, int, int], height_gv: float, share: float = 0.03) -> Rings:
    """Rings of normal heights at a share of all radii, for a volume (nz, ny, nx)."""
    nz, ny, nx = shape
    n = int(np.ceil(np.hypot(ny, nx) / 2)) + 1
    return Rings(height_gv * rng.standard_normal((nz, n)) * (rng.random((nz, n)) < share))


@dataclass(frozen=True)
class GreyDrift:
    """Grey values of a scan for those of the first: gain times them plus offset plus cupping.

    cupping_gv : at the rim of the largest circle in a plane; zero on the axis of rotation
    """

    gain: float = 1.0
    offset_gv: float = 0.0
    cupping_gv: float = 0.0

    def applied(self, plane: np.ndarray) -> np.ndarray:
        """The grey values of a plane with the drift  # (ny, nx)"""
        ny, nx = plane.shape
        y, x = (2.0 * np.arange(n) / (n - 1) - 1.0 for n in (ny, nx))
        return self.gain * plane + self.offset_gv + self.cupping_gv * (y[:, None] ** 2 + x**2)
