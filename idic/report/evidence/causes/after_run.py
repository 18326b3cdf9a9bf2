"""The cause of the misfit of a finished identification: measured and simulated motion of every camera, through the
table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from idic.correlation import FieldReference
from idic.measure import AffineMotions, Seen
from idic.model import Experiment
from idic.report.evidence.causes.before_run import motions_of
from idic.report.evidence.causes.course import MIN_DELAY, delay_of
from idic.report.evidence.causes.end_of_test import end_of_test
from idic.report.evidence.causes.ends import counted_frames, loads_of
from idic.report.evidence.causes.evidence import MIN_SHARE, Cause, Evidence
from idic.report.evidence.causes.table import first_cause

MAX_FRAMES = 60  # that are followed
MAX_PRECISE_FRAMES = 8  # that a free FE-DIC measures where the misfit is too small for subsets
MAX_PLACES = 150  # of nodes
PRECISE_NOISE_PX = 0.01  # of the free FE-DIC of a good test


@dataclass(frozen=True)
class _View:
    """A camera's view at an accepted point; motion : frame -> (n_nodes, 2) px; dic_setup : None: no free FE-DIC"""

    experiment: Experiment
    motion: Callable[[int], np.ndarray]
    dic_setup: Seen | None


def cause_after_run(cameras: Sequence[tuple[Experiment, Callable[[int], np.ndarray], Seen | None]]) -> Cause | None:
    """The first cause that the measured motion shows; None where none explains the misfit, or nothing is measured.

    cameras : the view of each, the main one first; frame -> simulated motion of the nodes in its images, (n_nodes, 2)
    px; for a free FE-DIC of its images, None: none
    """
    views = [_View(*camera) for camera in cameras]
    evidence = [_evidence(view) for view in views]
    main = evidence[0]
    end = end_of_test(views[0].experiment, None if main is None else main.motions)
    if end is not None or main is None:
        return end
    late = _late_camera([camera_evidence for camera_evidence in evidence if camera_evidence is not None])
    return late or first_cause(main) or _of_small_misfit(views[0])


def _of_small_misfit(view: _View) -> Cause | None:
    """The cause of a misfit that a free FE-DIC resolves and subsets do not."""
    if view.dic_setup is None or isinstance(view.dic_setup.reference, FieldReference):
        return None
    frames = _spread(view.experiment, MAX_PRECISE_FRAMES)
    nodes = view.dic_setup.reference.pixel_map.visible_nodes
    nodes = nodes[np.unique(np.linspace(0, len(nodes) - 1, min(len(nodes), MAX_PLACES)).astype(int))]
    places = view.dic_setup.reference.pixel_map.nodes_px[nodes]
    motions = AffineMotions.of_places(frames, places, view.dic_setup.free_motion(frames, view.motion)[:, nodes],
                                      PRECISE_NOISE_PX)
    return first_cause(_beside(view, motions, nodes))


def _evidence(view: _View) -> Evidence | None:
    experiment = view.experiment
    reference = None
    if experiment.recording.quantity == "grey" and experiment.recording.points is None:
        reference = np.asarray(experiment.recording.stack.frame(experiment.model.reference))
    motions = motions_of(experiment, _spread(experiment, MAX_FRAMES), reference, experiment.recording.picture)
    return None if motions is None else _beside(view, motions)


def _spread(experiment: Experiment, most: int) -> list[int]:
    """Compared frames, all or evenly spread."""
    counted = counted_frames(experiment)
    picks = np.linspace(0, len(counted) - 1, min(most, len(counted)))
    return list(dict.fromkeys(counted[round(p)] for p in picks))


def _beside(view: _View, motions: AffineMotions, nodes: np.ndarray | None = None) -> Evidence:
    """The evidence of the places that were measured; nodes : their numbers, None: between the nodes"""
    model, frames = view.experiment.model, range(view.experiment.model.n_frames)
    simulated = np.nan_to_num([view.motion(k) for k in frames])
    if nodes is not None:
        expected = simulated[:, nodes]
    else:
        at = model.camera.project(model.mesh.nodes)
        expected = AffineMotions.of_places(frames, at, simulated, 0.0).at(motions.places_px)
    places = np.repeat(motions.places_px, 2, axis=0)
    directions = np.tile(np.eye(2), (len(motions.places_px), 1))
    return Evidence(view.experiment, motions, places, directions, np.nan_to_num(expected.reshape(len(expected), -1)),
                    "model", (), loads_of(view.experiment))


def _late_camera(evidence: Sequence[Evidence]) -> Cause | None:
    """A camera whose frames are of other moments than those of the main one."""
    if len(evidence) < 2:
        return None
    delays = [delay_of(camera_evidence) for camera_evidence in evidence]
    if delays[0] is None:
        return None
    for camera_evidence, late in zip(evidence[1:], delays[1:], strict=True):
        difference = 0.0 if late is None else late[0] - delays[0][0]
        if late is not None and abs(difference) >= 2.0 * MIN_DELAY and late[1] >= MIN_SHARE:
            name, main = camera_evidence.experiment.recording.camera_name, evidence[0].experiment.recording.camera_name
            way = "behind" if difference > 0 else "ahead of"
            return Cause("late_camera", late[1],
                         f"camera {name} is {abs(difference):.2g} frames {way} {main}: {camera_evidence.of(late[1])}. "
                         "Its images are of other moments: check its trigger, and leave out its first or last images "
                         "so that those of one moment pair")
    return None
