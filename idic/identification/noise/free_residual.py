"""Noise of a camera from what a free FE-DIC leaves: where consecutive images differ by more than a tile search follows.

Frames with large steps (rubber, few images of a long test) show no noise in the difference of neighbours. The free
FE-DIC follows them, and the frame on the material points less the reference image holds the noise of both. Frame and
white noise go through the same interpolation, so that what it smooths is not taken for correlation (docs/method.md,
section 11).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.correlation import ReferenceImage
from idic.measure import Regularisation, dic_stack
from idic.images import NoiseCovariance, TilesOnMaterial, prefilter
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
    tiles = TilesOnMaterial.within(region)
    chosen = [k for k in range(view.model.reference + 1, view.model.n_frames)
              if k not in view.recording.excluded][:MAX_FRAMES]
    if tiles is None or not chosen:
        return None
    unused_frames = set(range(view.model.n_frames)) - {view.model.reference, *chosen}
    excluded = tuple(sorted(unused_frames | set(view.recording.excluded)))
    motion = dic_stack(replace(view, recording=replace(view.recording, excluded=excluded)),
                       Regularisation.smooth())
    followed = [k for k in chosen if motion.status[k] == "ok"]
    rng, still = np.random.default_rng(0), _raw(view.recording, view.model.reference)
    frames = (_on_material(view, reference, frame, motion.u_px[frame], rng) for frame in followed)
    return tiles.noise(still, frames, view.options.lowpass_px)


def _raw(recording: Recording, frame: int) -> np.ndarray:
    return np.asarray(recording.stack.frame(frame), float)


def _on_material(view: Experiment, reference: ReferenceImage, frame: int, u_px: np.ndarray,
                 rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """One frame on the material points of the reference image, and white noise that went the same way; NaN where the
    material is not followed  # (ny, nx) each"""
    image_gv = _raw(view.recording, frame)
    pixels, shape = reference.pixel_map, image_gv.shape
    places = pixels.points() + pixels.interpolate(u_px)

    def on_material(image: np.ndarray) -> np.ndarray:
        values = np.full(len(places), np.nan)
        inside = ((places >= 0.0) & (places <= np.array(shape[::-1]) - 1.0)).all(axis=1)  # NaN is not
        values[inside] = prefilter(image, reference.degree).evaluate(places[inside])
        return pixels.to_image(values)

    moved = on_material(image_gv)
    white = (rng.standard_normal(shape) - on_material(rng.standard_normal(shape))) / np.sqrt(2.0)
    return moved, white
