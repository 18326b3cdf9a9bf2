"""Input that contradicts the images: still frames from elsewhere, a mesh that would fit better with an axis mirrored,
and ends that move differently than in the log."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from idic.correlation import is_section
from idic.measure import coarse_motion
from idic.experiment_file import corners_px, seen_nodes, seen_region, visible_cells
from idic.images import Camera, CameraMotion
from idic.model import Column, Constant, Experiment, Recording
from idic.report.evidence.plausible import MAX_PLAIN_SHARE, MIN_VISIBLE, without_pattern

MAX_CHANGE_SHARE = 0.5  # of the contrast: a difference that large is a motion of speckles, or another specimen
MAX_STILL_FRAMES = 6  # that are compared
MAX_SHARE_OF_MIRRORED = 0.4  # of the plain part of the ROI that a mirrored mesh would leave
MIN_LOGGED_PX = 1.5  # motion between two ends by the log: a smaller one cannot be told from slip and camera motion
CLEAR_PX = 4.0  # such a motion is compared; later the strain may be far from even
MAX_OTHERWISE = 0.35  # distance of the seen motion from another reading of the log, over the logged motion
MIN_STRETCH, MAX_STRETCH = 0.3, 2.5  # motion between the ends, seen over logged


def misplaced_still_frames(recording: Recording, roi: np.ndarray) -> Iterator[str]:
    """Declared still frames whose pattern is elsewhere than in the first of them.

    `idic.images.quality.drift` reports shifts below half a pixel and removes them from the noise.
    """
    images = list(_still_images(recording))
    if len(images) < 2:
        return
    first, f = images[0]
    contrast = float(f[roi].std())
    for label, image in images[1:]:
        if float((image[roi] - f[roi]).std()) > MAX_CHANGE_SHARE * contrast:
            yield (f"still frame {label} shows another place than {first}: the specimen has moved by a speckle or "
                   "more, so their difference is not noise. Leave it out of still_frames, or give noise_std_gv")


def _still_images(recording: Recording) -> Iterator[tuple[str, np.ndarray]]:
    stack = recording.still_stack
    if stack is not None:
        for k in range(min(stack.n_frames, MAX_STILL_FRAMES)):
            yield recording.still_labels[k], np.asarray(stack.frame(k), dtype=float)
        return
    for k in recording.still_frames[:MAX_STILL_FRAMES]:
        yield recording.labels[k], np.asarray(recording.stack.frame(k), dtype=float)


def mirrored_axes(experiment: Experiment, reference: np.ndarray, roi: np.ndarray) -> Iterator[str]:
    """An axis whose mirror image would put the mesh on the pattern, where a part of the ROI has none."""
    camera, noise = experiment.model.camera, experiment.recording.noise.std_gv
    if not isinstance(camera, Camera) or is_section(experiment.model) or experiment.recording.quantity != "grey":
        return
    plain_share = float(without_pattern(reference, roi, noise).mean())
    if plain_share <= MAX_PLAIN_SHARE:
        return
    for name, flip in (("columns", np.diag([-1.0, 1.0])), ("rows", np.diag([1.0, -1.0]))):
        region = _region(replace(experiment, model=replace(experiment.model,
                                                           camera=replace(camera, matrix=flip @ camera.matrix))))
        share = 1.0 if region is None else float(without_pattern(reference, region, noise).mean())
        if share < MAX_SHARE_OF_MIRRORED * plain_share:
            yield (f"mirrored along the {name} of the image, {share:.0%} of the ROI would be without pattern; now it "
                   f"is {plain_share:.0%}. A sign in axes may be wrong: look at the picture")


def ends_that_move_otherwise(experiment: Experiment, reference: np.ndarray) -> Iterator[str]:
    """Ends whose motion in the images has another sign, another place or another size than in the log.

    The affine motion of the surface between the reference and the first frame whose logged motion is clear is compared
    with the log at the driven and at the held end.
    """
    model, recording = experiment.model, experiment.recording
    camera = model.camera
    moving = getattr(camera, "motion", None)
    if recording.quantity != "grey" or recording.points is not None or is_section(model) or (
            isinstance(moving, CameraMotion) and any("_at[" in name for name in moving.names)):
        return
    driven = [condition for condition in model.prescribed if isinstance(condition.drive, Column)]
    counted = [k for k in range(model.n_frames) if k not in recording.excluded]
    points, _ = seen_nodes(model.mesh, model.kind, model.surface)
    for condition in driven if len(driven) == 1 and len(counted) > 1 else ():
        fixed_end = next((candidate for candidate in model.prescribed if candidate.component == condition.component
                     and isinstance(candidate.drive, Constant) and candidate.drive.value == 0.0), None)
        if fixed_end is None or condition.component == "z":
            return
        ends = [points[model.mesh.node_sets[nodes]] for nodes in (condition.nodes, fixed_end.nodes)]
        steps = np.zeros((model.n_frames, points.shape[1]))
        steps[:, "xyz".index(condition.component)] = condition.drive.values
        moved = np.array([(camera.project(ends[0] + step) - camera.project(ends[0])).mean(axis=0) for step in steps])
        sizes = np.hypot(*moved.T)
        frame = next((k for k in counted if sizes[k] >= CLEAR_PX), max(counted, key=lambda k: sizes[k]))
        logged, size = moved[frame], float(sizes[frame])
        if not size >= MIN_LOGGED_PX:  # no number, too
            return
        at = [camera.project(end).mean(axis=0) for end in ends]
        image_motion = coarse_motion(reference, recording.picture(frame), camera.project(points), np.array(at))
        if image_motion is not None:
            yield from _otherwise(image_motion @ logged / size**2, size, condition, fixed_end.nodes,
                                  recording.labels[frame])


def _otherwise(shares: np.ndarray, size: float, condition, fixed_set: str, label: str) -> Iterator[str]:
    """shares : (2,) motion of the driven and of the fixed end along the logged motion, over its size"""
    comparison = (f"{condition.drive.column} moves {condition.nodes} by {size:.1f} px until {label} and {fixed_set} "
                  f"stays; in the image {condition.nodes} moves by {shares[0] * size:.1f} px along this direction, "
                  f"{fixed_set} by {shares[1] * size:.1f} px")
    for ends, meaning in (((-1.0, 0.0), f"the sign of {condition.drive.column} or of an entry of axes is wrong"),
                          ((0.0, -1.0), "the ends are exchanged, or an axis is mirrored: look at the sets in the "
                                        "picture and at axes"),
                          ((0.0, 1.0), "the ends are exchanged: the grip that moved is not the one in the model")):
        if np.abs(shares - ends).max() < MAX_OTHERWISE:
            yield f"{comparison}: {meaning}"
            return
    stretch = float(shares[0] - shares[1])
    if not MIN_STRETCH < stretch < MAX_STRETCH:
        yield (f"{comparison}: {stretch:.2g} of the logged motion between them. pixel_size_mm, mesh_unit or the unit "
               f"of {condition.drive.column} may be wrong, or the grip slips")


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
