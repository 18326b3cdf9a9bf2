"""What an identification needs before its first simulation, in memory: noise, a free FE-DIC, starting values.

`idic.run.prepared.prepare` and `idic.run.search` do the same with the files of a RUN.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from idic.identification import (
    CoarseFit, motion_in_space, needs_free_dic, needs_motion_in_space, regularisation_of, search, wants_search,
)
from idic.measure import DicStack, dic_stack, with_boundary_start
from idic.model import Experiment
from idic.run.prepared.measured_beginning import (
    FreeMotion, beginning_of, camera_noises, cameras_to_measure, motion_of_volumes,
)
from idic.run.prepared.prepare import check_before_writing


@dataclass(frozen=True, eq=False)
class Prepared:
    """An experiment that can be identified.

    experiment : with its noise, the excluded frames and the modes of virtual boundaries; local : (n_frames, m) mm,
    start of the frame-local unknowns; free_dics : the free FE-DIC of each camera for which one was made; begin : start
    values that a search found, internal units
    """

    experiment: Experiment
    local: np.ndarray
    free_dics: Mapping[str, DicStack] = field(default_factory=dict)
    begin: Mapping[str, float] | None = None

    @property
    def start(self) -> Experiment:
        """The experiment where the search has left it."""
        if self.begin is None:
            return self.experiment
        return self.experiment.with_parameters(self.experiment.model.parameters.with_values(self.begin))

    @property
    def motion(self) -> dict[str, np.ndarray] | None:
        """The first of two steps: per camera (n_frames, n_nodes, 2) px; None where the method is integrated."""
        if not self.experiment.options.is_two_step:
            return None
        return {name: dic.u_px for name, dic in self.free_dics.items()}


def prepare_in_memory(experiment: Experiment, say: Callable[[str], None] = lambda text: None) -> Prepared:
    """Check the experiment and measure what it leaves open, as a run does before its first simulation.

    say : called with a line per trial of a search

    Raises
    ------
    InputError
        If the experiment makes no model, or does not hold what an identification needs.
    """
    check_before_writing(experiment)
    views, free_dics = experiment.views, {}
    for number in [*([0] if needs_free_dic(experiment) else []), *cameras_to_measure(experiment)]:
        free_dics[views[number].recording.camera_name] = dic_stack(views[number], regularisation_of(experiment.options))
    motion = None
    if needs_free_dic(experiment):
        main = free_dics[views[0].recording.camera_name]
        unexplained, lost = (np.array([status == name for status in main.status]) for name in ("unexplained", "lost"))
        motion = FreeMotion(main.u_px, unexplained, lost,
                            in_space=motion_in_space(experiment) if needs_motion_in_space(experiment) else None)
    if experiment.recording.quantity == "volume" and needs_motion_in_space(experiment):
        motion = motion_of_volumes(motion_in_space(experiment))
    beginning = beginning_of(experiment, motion)
    measured = with_boundary_start(experiment, beginning.boundary)
    noises = camera_noises(experiment, {number: free_dics[view.recording.camera_name].noise_gv for number,
                                        view in enumerate(views)
                                        if view.recording.camera_name in free_dics}, beginning.excluded)
    cameras = tuple(replace(camera, noise=noise) for camera, noise in zip(measured.cameras, noises[1:], strict=True))
    measured = replace(measured, recording=replace(measured.recording, noise=noises[0],
                                                   excluded=tuple(sorted(beginning.excluded))), cameras=cameras)
    return _searched(Prepared(measured, beginning.local, free_dics), say)


def _searched(prepared: Prepared, say: Callable[[str], None]) -> Prepared:
    """With start values from far, where a law needs them."""
    experiment = prepared.experiment
    if not wants_search(experiment):
        return prepared
    name, free_dics, u_px = experiment.views[0].recording.camera_name, dict(prepared.free_dics), None
    if experiment.recording.quantity != "height":
        if name not in free_dics:
            free_dics[name] = dic_stack(experiment, regularisation_of(experiment.options))
        u_px = free_dics[name].u_px
    bare = replace(experiment, recording=replace(experiment.recording, stack=None))
    start = search(experiment, lambda trials: [
        CoarseFit.of(bare, u_px, trial.values, trial.evaluations, trial.simplified) for trial in trials], say)
    return replace(prepared, free_dics=free_dics, begin=start.values if start.moved else None)
