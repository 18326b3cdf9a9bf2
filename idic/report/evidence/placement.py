"""Input that contradicts the images: still frames from elsewhere, and a mesh that would fit better with other axes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from idic.experiment_file import corners_px, seen_nodes, seen_region, visible_cells
from idic.images import Camera
from idic.model import Experiment, Recording, Remedies
from idic.report.evidence.causes.axes import NAMES, TURNS
from idic.report.evidence.causes.lines import other_axes
from idic.report.evidence.plausible import MAX_PLAIN_SHARE, MIN_VISIBLE, without_pattern

MAX_CHANGE_SHARE = 0.5  # of the contrast: a difference that large is a motion of speckles, or another specimen
MAX_STILL_FRAMES = 6  # that are compared
MAX_SHARE_OF_MIRRORED = 0.4  # of the plain part of the ROI that a mirrored mesh would leave


def misplaced_still_frames(experiment: Experiment, roi: np.ndarray) -> Iterator[str]:
    """Declared still frames whose pattern is elsewhere than in the first of them.

    `idic.images.quality.drift` reports shifts below half a pixel and removes them from the noise.
    """
    images = list(_still_images(experiment.recording))
    if len(images) < 2:
        return
    first, f = images[0]
    contrast = float(f[roi].std())
    for label, image in images[1:]:
        if float((image[roi] - f[roi]).std()) > MAX_CHANGE_SHARE * contrast:
            yield (f"still frame {label} shows another place than {first}: the specimen has moved by a speckle or "
                   "more, so their difference is not noise: "
                   + Remedies(experiment).possible("leave it out of still_frames", "give noise_std_gv"))


def _still_images(recording: Recording) -> Iterator[tuple[str, np.ndarray]]:
    stack = recording.still_stack
    if stack is not None:
        for k in range(min(stack.n_frames, MAX_STILL_FRAMES)):
            yield recording.still_labels[k], np.asarray(stack.frame(k), dtype=float)
        return
    for k in recording.still_frames[:MAX_STILL_FRAMES]:
        yield recording.labels[k], np.asarray(recording.stack.frame(k), dtype=float)


def mirrored_axes(experiment: Experiment, reference: np.ndarray, plain_share: float,
                  width: float | None) -> Iterator[str]:
    """Axes, mirrored or turned, that would put the mesh on the pattern, where this share of the ROI has none."""
    camera, noise = experiment.model.camera, experiment.recording.noise.std_gv
    if not isinstance(camera, Camera) or experiment.model.is_section or experiment.recording.quantity != "grey":
        return
    if plain_share <= MAX_PLAIN_SHARE:
        return
    best, meaning, change = MAX_SHARE_OF_MIRRORED * plain_share, "", TURNS[0]
    for name, turn in zip(NAMES, TURNS, strict=True):
        region = _region(replace(experiment, model=replace(experiment.model,
                                                           camera=replace(camera, matrix=turn @ camera.matrix))))
        share = 1.0 if region is None else float(without_pattern(reference, region, noise, width).mean())
        if share < best:
            best, meaning, change = share, name, turn
    if meaning:
        written = "".join(f": {line.text()}" for line in other_axes(experiment, change))
        cause = Remedies(experiment).possible("An entry of axes may be wrong", otherwise="The camera may be turned")
        yield (f"{meaning} of the image, {100.0 * best:.0f} % of the ROI would be without pattern; now it is "
               f"{100.0 * plain_share:.0f} %. {cause}: look at the picture{written}")


def _region(experiment: Experiment) -> np.ndarray | None:
    """The ROI, None where less than half of the mesh is in the image  # (ny, nx) bool"""
    model = experiment.model
    shape = experiment.recording.image_shape
    view = (model.kind, model.surface, model.camera)
    points, cells = seen_nodes(model.mesh, *view[:2])
    visible = visible_cells(model.mesh, *view, shape)
    if visible.mean() < MIN_VISIBLE:
        return None
    return seen_region(corners_px(points, cells, *view), visible, shape, experiment.recording.mask)
