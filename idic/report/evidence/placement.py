"""Input that contradicts the images: still frames from elsewhere, and a mesh that would fit better with an axis
mirrored."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from idic.correlation.view import is_section
from idic.experiment_file.model_checks import corners_px, seen_nodes, seen_region, visible_cells
from idic.images.camera import Camera
from idic.model.experiment import Experiment
from idic.report.evidence.plausible import MAX_PLAIN_SHARE, MIN_VISIBLE, without_pattern

MAX_CHANGE_SHARE = 0.5  # of the contrast: a difference that large is a motion of speckles, or another specimen
MAX_STILL_FRAMES = 6  # that are compared
MAX_SHARE_OF_MIRRORED = 0.4  # of the plain part of the ROI that a mirrored mesh would leave


def misplaced_still_frames(experiment: Experiment, roi: np.ndarray) -> Iterator[str]:
    """Declared still frames whose pattern is elsewhere than in the first of them.

    Shifts below half a pixel are told, and taken out of the noise, by `idic.images.quality.drift`.
    """
    images = list(_still_images(experiment))
    if len(images) < 2:
        return
    first, f = images[0]
    contrast = float(f[roi].std())
    for label, image in images[1:]:
        if float((image[roi] - f[roi]).std()) > MAX_CHANGE_SHARE * contrast:
            yield (f"still frame {label} shows another place than {first}: the specimen has moved by a speckle or "
                   f"more, so their "
                   "difference is no noise. Leave it out of still_frames, or give noise_std_gv")


def _still_images(experiment: Experiment) -> Iterator[tuple[str, np.ndarray]]:
    stack = experiment.extras.get("still_stack")
    if stack is not None:
        for k in range(min(stack.n_frames, MAX_STILL_FRAMES)):
            yield stack.labels[k], np.asarray(stack.frame(k), dtype=float)
        return
    for k in experiment.extras.get("still_frames", ())[:MAX_STILL_FRAMES]:
        yield experiment.labels[k], np.asarray(experiment.stack.frame(k), dtype=float)


def mirrored_axes(experiment: Experiment, reference: np.ndarray, roi: np.ndarray) -> Iterator[str]:
    """An axis whose mirror image would put the mesh on the pattern, where a part of the ROI has none."""
    camera, noise = experiment.camera, experiment.noise.std_gv
    if not isinstance(camera, Camera) or is_section(experiment) or experiment.quantity != "grey":
        return
    here = float(without_pattern(reference, roi, noise).mean())
    if here <= MAX_PLAIN_SHARE:
        return
    for name, flip in (("columns", np.diag([-1.0, 1.0])), ("rows", np.diag([1.0, -1.0]))):
        region = _region(replace(experiment, camera=replace(camera, matrix=flip @ camera.matrix)))
        share = 1.0 if region is None else float(without_pattern(reference, region, noise).mean())
        if share < MAX_SHARE_OF_MIRRORED * here:
            yield (f"mirrored along the {name} of the image, {share:.0%} of the ROI would be without pattern; now it "
                   f"is {here:.0%}. A sign in axes may be wrong: look at the picture")


def _region(experiment: Experiment) -> np.ndarray | None:
    """The ROI, None where less than half of the mesh is in the image  # (ny, nx) bool"""
    shape = experiment.image_shape
    view = (experiment.kind, experiment.surface, experiment.camera)
    points, cells = seen_nodes(experiment.mesh, *view[:2])
    visible = visible_cells(experiment.mesh, *view, shape)
    if visible.mean() < MIN_VISIBLE:
        return None
    return seen_region(corners_px(points, cells, *view), visible, shape, experiment.mask)
