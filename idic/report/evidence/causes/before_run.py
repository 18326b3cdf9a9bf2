"""Causes that the motion in a few frames shows before anything is simulated: for `idic check`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from idic.experiment_file import seen_nodes
from idic.measure import AffineMotions
from idic.model import Experiment
from idic.report.evidence.causes.end_of_test import end_of_test, first_of, load_drops
from idic.report.evidence.causes.ends import counted_frames, logged_ends
from idic.report.evidence.causes.force_sign import opposed_forces
from idic.report.evidence.causes.table import cause_at_ends

MAX_FRAMES = 10  # that are followed, beside those around a drop of the load: each is decoded once more
MAX_NODES = 400  # of measured places, and of nodes between which subsets are placed
MIN_RECOGNISED = 0.3  # share of the subsets; a frame with fewer does not show the specimen
ALL_FRAMES = 16  # of a short test

Picture = Callable[[int], np.ndarray]  # frame -> (ny, nx)


def causes_in_motion(experiment: Experiment, reference: np.ndarray | None = None,
                     picture: Picture | None = None) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Frames after the end of the test, and warnings: that end, ends that move otherwise than in the log, forces of the
    other sign.

    reference : (ny, nx) reference image, where there are images; picture : frame -> (ny, nx), None: decoded here
    """
    motions = sampled_motions(experiment, reference, picture or experiment.recording.picture)
    end = end_of_test(experiment, motions)
    if end is None:
        return (), tuple(_warnings(experiment, motions))
    return end.frames, (end.sentence(), *_warnings(*_before(experiment, motions, end.frames)))


def _warnings(experiment: Experiment, motions: AffineMotions | None) -> Iterator[str]:
    """What the frames before the end of the test show."""
    if motions is not None and len(motions.frames):
        evidence = logged_ends(experiment, motions)
        cause = None if evidence is None else cause_at_ends(evidence)
        if cause is not None:
            yield cause.sentence()
        if cause is not None and cause.name == "sign":
            return  # that of the force is judged by the motion
    yield from opposed_forces(experiment, motions)


def _before(experiment: Experiment, motions: AffineMotions | None,
            frames: tuple[int, ...]) -> tuple[Experiment, AffineMotions | None]:
    """Without the frames after the end of the test."""
    recording = replace(experiment.recording, excluded=tuple(sorted({*experiment.recording.excluded, *frames})))
    kept_motions = None if motions is None else motions.only([k not in frames for k in motions.frames])
    return replace(experiment, recording=recording), kept_motions


def sampled_frames(experiment: Experiment) -> list[int]:
    """The frames that are followed: all of a short test, else spread over it, and those around a drop of the load."""
    counted = counted_frames(experiment)
    if len(counted) <= ALL_FRAMES:
        return counted
    picks = np.linspace(0, len(counted) - 1, MAX_FRAMES - 1)
    frames_near = [k for drop in load_drops(experiment) for k in range(drop.first - 2, drop.first + 2)]
    return sorted({counted[round(p)] for p in picks} | {counted[1]} | ({*frames_near} & {*counted}))


def sampled_motions(experiment: Experiment, reference: np.ndarray | None, picture: Picture) -> AffineMotions | None:
    """Measured motion of `sampled_frames`, of more where the pattern is lost at the end; None where nothing is measured
    (heights, cross-sections)."""
    counted, frames = counted_frames(experiment), sampled_frames(experiment)
    motions = motions_of(experiment, frames, reference, picture)
    if motions is None or len(frames) == len(counted) or motions.agreeing[-1] >= MIN_RECOGNISED:
        return motions
    last_seen = max((k for k, share in zip(frames, motions.agreeing, strict=True) if share >= MIN_RECOGNISED),
                    default=counted[0])
    between, more = [k for k in counted if k >= last_seen], motions

    def is_lost(frame: int) -> bool:
        nonlocal more
        if frame not in more.frames:
            more = more.joined(motions_of(experiment, [frame], reference, picture))
        return more.agreeing[more.frames.index(frame)] < MIN_RECOGNISED

    first_of(between, is_lost)
    return more


def motions_of(experiment: Experiment, frames: list[int], reference: np.ndarray | None,
               picture: Picture) -> AffineMotions | None:
    """Measured motion of these frames of the main camera; None where nothing is measured."""
    model, recording = experiment.model, experiment.recording
    if recording.points is not None:
        chosen = np.unique(np.linspace(0, len(recording.points.positions_px) - 1, MAX_NODES).astype(int))
        values = np.array([np.asarray(recording.stack.frame(k), dtype=float)[:, :2] for k in frames])
        scale = recording.points.um_per_px
        noise = (recording.noise.std_gv or 0.0) / scale
        motions = values.reshape(len(frames), -1, 2) / scale
        return AffineMotions.of_places(frames, recording.points.positions_px, motions, noise).at_places(chosen)
    if recording.quantity != "grey" or model.is_section or reference is None:
        return None
    points, _ = seen_nodes(model.mesh, model.kind, model.surface)
    places = model.camera.project(points)
    places = places[np.unique(np.linspace(0, len(places) - 1, min(len(places), 10 * MAX_NODES)).astype(int))]
    return AffineMotions.of(reference, picture, frames, places)
