"""Frames in which the specimen stands still: before the load, between loads, after unloading.

Three sources: the experiment file (``still_frames``), the log (every reading back at its value in the reference frame),
and the images (the specimen's own motion, nearly absent). Rigid motion does not count: a specimen that has come back to
another place is as free of load as before.

The image criterion takes the leading motion of the whole test, the first right singular vector of all frames' motions
without their rigid parts. A frame is unloaded where the test's own motion has less than a hundredth of its largest
amplitude and the rest is small. A permanent strain has a share of the leading motion, so that a frame after yielding
does not pass.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from idic.correlation import camera_at, view_of
from idic.images import StabilisedStack, Stack
from idic.model import Column, Experiment, Model, Recording

MAX_LEVEL_SHARE = 0.01  # of the largest amplitude of the test's leading motion, or of the range of a reading
MAX_OTHER_SHARE = 0.05  # of the largest motion without its rigid part (rms), within the two bounds that follow
MIN_OTHER_PX, MAX_OTHER_PX = 0.05, 0.1
MIN_READING_CHANGE = 1e-12  # of the largest reading: a column that never changes tells nothing
MIN_NODES = 8  # that every frame sees: with fewer a rigid motion is most of what they could show


@dataclass(frozen=True)
class StillFrames:
    """Frames at rest.

    Attributes
    ----------
    frames : tuple of int
        Frame numbers of the recording, reference frames among them only where others are at rest too.
    source : "declared" | "log" | "images" | "declared and images" | ""
    unloaded : tuple of int
        Those after the first loaded frame.
    separate : bool
        Whether the declared ones are separate images (``Recording.still_stack``), no frames of the test.
    """

    frames: tuple[int, ...] = ()
    source: str = ""
    unloaded: tuple[int, ...] = ()
    separate: bool = False

    @property
    def found(self) -> bool:
        """Whether there is any image at rest besides the reference image."""
        return bool(self.frames) or self.separate


def find_still_frames(experiment: Experiment, motion_px: np.ndarray | None = None,
                      nodes: np.ndarray | None = None) -> StillFrames:
    """Frames at rest by the experiment file, the log and the images.

    Parameters
    ----------
    motion_px : array (n_frames, m, 2), optional
        Displacement in the image, NaN where unknown: of a free FE-DIC, or of the identified model. Without it the log
        decides alone.
    nodes : array of m node indices, optional
        The nodes that `motion_px` is given at; default all.
    """
    recording = experiment.recording
    declared = recording.still_frames
    by_log = _rest_by_log(experiment.model)
    source, at_rest = "log", by_log
    if motion_px is not None:
        by_images = _rest_by_images(nodes_in_image(experiment)[slice(None) if nodes is None else nodes],
                                    np.asarray(motion_px, float))
        source = "images"
        at_rest = by_images if by_log is None or by_images is None else by_images & by_log
    numbers = set() if at_rest is None else set(np.flatnonzero(at_rest).tolist())
    numbers -= set(recording.excluded) - set(declared) - set(recording.averaged)
    frames = tuple(sorted(numbers | set(declared)))
    references = set(recording.averaged) | {experiment.model.reference}
    detected = set(frames) - references - set(declared)
    separate = recording.still_stack is not None
    if not set(frames) - {experiment.model.reference}:
        return StillFrames(source="declared" if separate else "", separate=separate)
    declaration = "declared" if declared or separate else ""
    return StillFrames(frames,
                       " and ".join(part for part in (declaration, source if detected else "") if part) or source,
                       tuple(k for k in frames if _is_after_load(k, at_rest, experiment.model)), separate)


def declared_stack(recording: Recording) -> Stack:
    """The separate images at rest, with the grey values that the test is compared in."""
    stack, stabiliser = recording.still_stack, recording.noise.stabiliser
    return stack if stabiliser is None else StabilisedStack(stack, stabiliser)


def _is_after_load(frame: int, at_rest: np.ndarray | None, model: Model) -> bool:
    """Whether the specimen was under load between the reference frame and this one."""
    return at_rest is not None and frame > model.reference and not at_rest[model.reference:frame].all()


def _rest_by_log(model: Model) -> np.ndarray | None:
    """Frames whose readings are all back at those of the reference frame; None without a reading  # (n_frames,)"""
    at_rest = None
    for values in _readings(model):
        change = np.abs(values - values[model.reference])
        largest = change.max(initial=0.0)
        if not largest > MIN_READING_CHANGE * max(np.abs(values).max(initial=0.0), 1e-300):
            continue
        back = change <= MAX_LEVEL_SHARE * largest
        at_rest = back if at_rest is None else at_rest & back
    return at_rest


def _readings(model: Model) -> Iterator[np.ndarray]:
    """Every logged column that the model uses  # (n_frames,)"""
    for channel in model.channels:
        yield np.asarray(channel.values, dtype=float)
    for drive in (*(entry.drive for entry in model.prescribed), *(load.drive for load in model.loads)):
        if isinstance(drive, Column):
            yield np.asarray(drive.values, dtype=float)


def _rest_by_images(at: np.ndarray, motion: np.ndarray) -> np.ndarray | None:
    """Frames without the test's own motion; None where no frame has any  # at (m, 2) px -> (n_frames,)"""
    measured, nodes = nodes_seen_throughout(motion)
    if nodes.sum() < MIN_NODES:
        return None
    warp = np.zeros((len(motion), 2 * int(nodes.sum())))
    warp[measured] = without_rigid(motion[measured][:, nodes].reshape(int(measured.sum()), -1), at[nodes])
    rms = np.sqrt(np.mean(warp**2, axis=1))
    largest = rms.max(initial=0.0)
    if largest < MIN_OTHER_PX:
        return None
    level = np.abs(warp @ np.linalg.svd(warp, full_matrices=False)[2][0])
    bound = np.clip(MAX_OTHER_SHARE * largest, MIN_OTHER_PX, MAX_OTHER_PX)
    return measured & (level <= MAX_LEVEL_SHARE * level.max()) & (rms <= bound)


def nodes_in_image(experiment: Experiment) -> np.ndarray:
    """Nodes of the mesh in the reference image  # (n_nodes, 2) px"""
    camera = camera_at(experiment, experiment.model.parameters)
    return camera.project(view_of(experiment, camera).points(experiment.model.mesh.nodes))


def nodes_seen_throughout(motion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frames with a measured motion (n_frames,) bool, and nodes that all of them see (n_nodes,) bool."""
    is_measured = np.isfinite(motion).all(axis=2)
    part = is_measured.mean(axis=1)
    measured_frames = part > 0.5 * part.max(initial=0.0)
    return measured_frames, is_measured[measured_frames].all(axis=0)


def without_rigid(motions: np.ndarray, at: np.ndarray, more_directions: np.ndarray | None = None) -> np.ndarray:
    """Motions without translation and small rotation, and without more directions where given.

    Parameters
    ----------
    motions : (m, 2 n) px, column and row of every node in turn
    at : (n, 2) px
    more_directions : (k, 2 n), optional

    Returns
    -------
    (m, 2 n)
    """
    centred = at - at.mean(axis=0)
    rigid = np.zeros((3, len(at), 2))
    rigid[0, :, 0] = rigid[1, :, 1] = 1.0
    rigid[2] = np.column_stack([-centred[:, 1], centred[:, 0]])
    directions = rigid.reshape(3, -1) if more_directions is None else np.vstack([rigid.reshape(3, -1), more_directions])
    base = np.linalg.qr(directions.T)[0]
    return motions - (motions @ base) @ base.T
