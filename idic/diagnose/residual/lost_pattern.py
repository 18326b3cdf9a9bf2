"""Pixels that show another thing than the pattern: where the residual is as large as the pattern itself.

A motion error of a fraction of a speckle leaves a fraction of its contrast; a speck of dust or a place without paint
leaves all of it. So a pixel counts where the mean square of the residual around it exceeds half the variance of the
pattern there, `MIN_NOISE_STD` standard deviations of noise, and a good part of the contrast of the whole pattern.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from idic.correlation import GreyReference, ViewKind, view_of
from idic.diagnose.residual.grey_value_effects import grey_image
from idic.diagnose.residual.residual_evidence import context_of
from idic.identification import Identification

MIN_PATTERN_SHARE = 0.5  # of the pattern's variance around a pixel: a uniform grey in its place leaves all of it
MIN_NOISE_STD = 6.0  # root mean square of the residual, over its noise
MIN_CONTRAST = 0.3  # of the standard deviation of the whole pattern
AROUND_PX, PATTERN_PX = 1.0, 2.0  # standard deviations of the windows of residual and pattern
EDGE_PX = 2  # left out along the edges of the seen region: a wrong outline lets the background in
MAX_LOST_SHARE = 0.05  # of the pixels of a frame: more is no spot (light, or a model that is off by a speckle)


@dataclass(frozen=True, eq=False)
class LostPattern:
    """Where the pattern is lost.

    frames : (T,) frame numbers; lost : (T, ny, nx) bool, in the reference image; motion : (T, ny, nx, 2) px, and
    reference : (ny, nx) grey values, NaN where nothing is seen; brighter : (T, ny, nx) grey values of the frame above
    those of the reference
    """

    frames: np.ndarray
    lost: np.ndarray
    motion: np.ndarray
    brighter: np.ndarray
    reference: np.ndarray


def lost_pattern(identification: Identification) -> LostPattern | None:
    """Of one camera that sees grey values; None for others, where nothing is lost in two frames, and where too much is.
    """
    experiment = identification.experiment
    if experiment.recording.points is not None or experiment.recording.quantity != "grey" or len(experiment.views) != 1:
        return None
    context = context_of(identification, null=False)
    view = view_of(context.experiment, context.camera)
    if view.kind != ViewKind.GREY:
        return None
    reference = grey_image(context)
    pm, frames, lost, moved, brighter = reference.pixel_map, [], [], [], []
    bar = _bar(reference, experiment.recording.noise.std_gv or 0.0)
    inner = ndimage.binary_erosion(pm.to_image(np.ones(pm.n_pixels), 0.0) > 0.0, iterations=EDGE_PX)
    compared = set(context.experiment.correlated_frames(range(context.experiment.model.n_frames)))
    matrix = pm.shape_matrix().astype(np.float32)
    for frame, u in _motions(identification):
        if frame not in compared or frame == context.experiment.model.reference:
            continue
        motion = view.at(frame).motion(context.experiment.model.mesh.nodes, context.experiment.model.turned(u))
        r = reference.compare_pixels(context.experiment, frame, motion, np.zeros(0))
        residual = _without_brightness(r.r.astype(float), reference.f.astype(float), r.valid)
        is_lost = (_local_mean(pm.to_image(np.where(r.valid, residual, 0.0) ** 2, 0.0),
                               pm.to_image(r.valid.astype(float), 0.0), AROUND_PX) > bar) & inner
        if is_lost.sum() > MAX_LOST_SHARE * inner.sum():
            return None
        frames.append(frame)
        lost.append(is_lost)
        moved.append(np.stack([pm.to_image(matrix @ motion[:, k].astype(np.float32)) for k in (0, 1)], axis=-1))
        brighter.append(pm.to_image(-residual, 0.0))
    if sum(bool(mask.any()) for mask in lost) < 2:
        return None
    return LostPattern(np.array(frames), np.array(lost), np.array(moved), np.array(brighter),
                       pm.to_image(reference.f))


def _motions(identification: Identification) -> Iterator[tuple[int, np.ndarray]]:
    """Frame and displacement of the accepted point's path  # (n_nodes, dim) mm"""
    if identification.path is not None:
        yield from ((response.frame, response.u) for response in identification.path.frames)
        return
    stored = identification.stored
    motions = (state.u for state in identification.march()) if stored is None else stored()
    for number, u in enumerate(motions):
        yield number + identification.experiment.model.reference, u


def _bar(reference: GreyReference, noise_gv: float) -> np.ndarray:
    """Mean square of a residual that counts as a lost pattern  # (ny, nx) GV²"""
    pm, f = reference.pixel_map, reference.f.astype(float)
    f = f - f.mean()
    coverage = pm.to_image(np.ones(pm.n_pixels), 0.0)
    mean = _local_mean(pm.to_image(f, 0.0), coverage, PATTERN_PX)
    variance = _local_mean(pm.to_image(f**2, 0.0), coverage, PATTERN_PX) - mean**2
    least = max(2.0 * (MIN_NOISE_STD * noise_gv) ** 2, (MIN_CONTRAST * f.std()) ** 2)
    return np.maximum(MIN_PATTERN_SHARE * variance, least)


def _local_mean(image: np.ndarray, coverage: np.ndarray, std_px: float) -> np.ndarray:
    total = ndimage.gaussian_filter(coverage, std_px)
    return np.divide(ndimage.gaussian_filter(image * coverage, std_px), total, out=np.zeros_like(total),
                     where=total > 0.1)


def _without_brightness(r: np.ndarray, f: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """The residual less a gain and an offset of the frame, fitted without the pixels far off."""
    columns, good = np.column_stack([f - f.mean(), np.ones_like(f)]), valid
    for _ in range(2):
        fitted = columns @ np.linalg.lstsq(columns[good], r[good], rcond=None)[0]
        residual = r - fitted
        good = valid & (np.abs(residual) < 4.0 * 1.4826 * np.median(np.abs(residual[valid])) + 1e-9)
    return residual
