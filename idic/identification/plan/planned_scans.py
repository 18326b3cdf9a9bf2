"""Scans of a test that is still to be made: a virtual texture fills space, or the scan that is there stands for all."""

from __future__ import annotations

import numpy as np
import scipy

PERIOD_PX = 96  # after which the texture repeats along each axis: some 10^4 grains, a contrast to 1 %


class PlannedScans:
    """A virtual texture, shown for every scan to come. It follows the `VolumeStack` protocol.

    shape : (nz, ny, nx); tile : (n, n, n) grey values, which repeat
    """

    def __init__(self, shape: tuple[int, int, int], tile: np.ndarray, n_frames: int):
        self.shape, self._tile, self._n_frames = shape, tile, n_frames

    @property
    def n_frames(self) -> int:
        return self._n_frames

    def block(self, k: int, z: slice, y: slice, x: slice) -> np.ndarray:
        """A block of the texture  # (slices, rows, columns) float32"""
        places = [np.arange(*part.indices(n)) % PERIOD_PX for part, n in zip((z, y, x), self.shape, strict=True)]
        return self._tile[np.ix_(*places)]


def texture_tile(sigma_px: float, contrast_gv: float, mean_gv: float, seed: int) -> np.ndarray:
    """Grey values of this standard deviation with the autocorrelation exp(-d²/(4 sigma²))  # (n, n, n) float32"""
    noise = np.random.default_rng(seed).standard_normal((PERIOD_PX,) * 3, dtype=np.float32)
    texture = scipy.ndimage.gaussian_filter(noise, sigma_px, mode="wrap")
    return mean_gv + contrast_gv / texture.std() * (texture - texture.mean())
