"""Noise between the reference image and frames that were mapped back on its material, tile by tile."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import scipy

from idic.images.quality.noise_covariance import (
    MARGIN_PX, MIN_GOOD_TILES, NoiseCovariance, TileNoise, pooled, tile_corners, tile_noise,
)


@dataclass(frozen=True, eq=False)
class TilesOnMaterial:
    """Tiles of the reference image.

    corners : (n, 2) first pixels; side : px
    """

    corners: np.ndarray
    side: int

    @classmethod
    def within(cls, region: np.ndarray) -> TilesOnMaterial | None:
        """The tiles of a specimen (ny, nx) bool; None where they are too few."""
        corners, side = tile_corners(scipy.ndimage.binary_erosion(region, iterations=MARGIN_PX))
        return None if len(corners) < MIN_GOOD_TILES else cls(corners, side)

    def noise(self, reference_gv: np.ndarray, frames: Iterable[tuple[np.ndarray, np.ndarray]],
              lowpass_px: float) -> NoiseCovariance | None:
        """Covariance of the noise of one image; None where too few tiles tell it.

        frames : per frame its grey values on the material of the reference image (ny, nx), NaN where it was not
        followed, and white noise of variance 1 that went through the same interpolation
        """
        return pooled([self._of_frame(reference_gv, moved_gv, white, lowpass_px) for moved_gv, white in frames])

    def _of_frame(self, reference_gv: np.ndarray, moved_gv: np.ndarray, white: np.ndarray,
                  lowpass_px: float) -> list[TileNoise]:
        tiles = []
        for row, column in self.corners:
            window = slice(row, row + self.side), slice(column, column + self.side)
            wide = tuple(slice(part.start - MARGIN_PX, part.stop + MARGIN_PX) for part in window)
            if np.isfinite(moved_gv[wide]).all():
                tiles.append(_of_one_image(tile_noise(reference_gv[wide], moved_gv[wide], white[window], lowpass_px)))
        return tiles


def _of_one_image(tile: TileNoise) -> TileNoise:
    """Interpolation takes variance from one of the two images: as much as from the white noise."""
    n_free = tile.square.size - tile.basis.shape[2]
    through = tile.white_lags[len(tile.white_lags) // 2, len(tile.white_lags) // 2] / n_free
    return replace(tile, variance=tile.variance / through)
