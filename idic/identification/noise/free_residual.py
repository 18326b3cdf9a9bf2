"""Noise of a camera from what a free FE-DIC leaves: where consecutive images differ by more than a tile search follows.

Frames with large steps (rubber, few images of a long test) show no noise in the difference of neighbours. The free
FE-DIC follows them, and the frame on the material points less the reference image holds the noise of both. Frame and
white noise go through the same interpolation, so that what it smooths is not taken for correlation (docs/method.md,
section 11).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from idic.correlation import ReferenceImage
from idic.measure import Regularisation, dic_stack
from idic.images import (
    MARGIN_PX, MIN_GOOD_TILES, NoiseCovariance, TileNoise, evaluate, pooled, prefilter, tile_corners, tile_noise,
)
from idic.model import Experiment, Recording

MAX_FRAMES = 3  # that are followed, the first ones after the reference


def free_residual_noise(view: Experiment, reference: ReferenceImage, region: np.ndarray) -> NoiseCovariance | None:
    """Covariance of the noise of one camera; None where no frame is followed or too few tiles tell it.

    Parameters
    ----------
    view : one camera with grey images
    reference : its reference image, with the pixels of the mesh
    region : (ny, nx) bool, the specimen in it
    """
    corners, side = tile_corners(scipy.ndimage.binary_erosion(region, iterations=MARGIN_PX))
    chosen = [k for k in range(view.model.reference + 1, view.model.n_frames)
              if k not in view.recording.excluded][:MAX_FRAMES]
    if len(corners) < MIN_GOOD_TILES or not chosen:
        return None
    unused_frames = set(range(view.model.n_frames)) - {view.model.reference, *chosen}
    excluded = tuple(sorted(unused_frames | set(view.recording.excluded)))
    motion = dic_stack(replace(view, recording=replace(view.recording, excluded=excluded)),
                       Regularisation.smooth())
    followed = [k for k in chosen if motion.status[k] == "ok"]
    rng, still = np.random.default_rng(0), _raw(view.recording, view.model.reference)
    return pooled([_tiles(view, reference, frame, motion.u_px[frame], still, corners, side, rng) for frame in followed])


def _raw(recording: Recording, frame: int) -> np.ndarray:
    return np.asarray(recording.stack.frame(frame), float)


def _tiles(view: Experiment, reference: ReferenceImage, frame: int, u_px: np.ndarray, still: np.ndarray,
           corners: np.ndarray, side: int, rng: np.random.Generator) -> list[TileNoise]:
    """One frame against the reference image; tiles whose material is not followed are left out."""
    pixels, shape = reference.pixel_map, still.shape
    places = pixels.points() + pixels.interpolate(u_px)

    def on_material(image: np.ndarray) -> np.ndarray:
        values = np.full(len(places), np.nan)
        inside = ((places >= 0.0) & (places <= np.array(shape[::-1]) - 1.0)).all(axis=1)  # NaN is not
        values[inside] = evaluate(prefilter(image, reference.degree), places[inside])
        return pixels.to_image(values)

    moved = on_material(_raw(view.recording, frame))
    white = (rng.standard_normal(shape) - on_material(rng.standard_normal(shape))) / np.sqrt(2.0)
    tiles = []
    for row, column in corners:
        window = slice(row, row + side), slice(column, column + side)
        wide = tuple(slice(part.start - MARGIN_PX, part.stop + MARGIN_PX) for part in window)
        if np.isfinite(moved[wide]).all():
            tiles.append(_of_one_image(tile_noise(still[wide], moved[wide], white[window], view.options.lowpass_px)))
    return tiles


def _of_one_image(tile: TileNoise) -> TileNoise:
    """Interpolation takes variance from one of the two images: as much as from the white noise."""
    n_free = tile.square.size - tile.basis.shape[2]
    through = tile.white_lags[len(tile.white_lags) // 2, len(tile.white_lags) // 2] / n_free
    return replace(tile, variance=tile.variance / through)
