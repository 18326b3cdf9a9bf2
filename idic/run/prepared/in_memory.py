"""What an identification needs before its first simulation, in memory: noise, a free FE-DIC, starting values.

`idic.run.prepared.prepare` and `idic.run.search` do the same with the files of a RUN.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from idic.identification import (
    coarse_fit, is_two_step, measured_noise, measured_start, motion_in_space, needs_free_dic, needs_motion_in_space,
    regularisation_of, search, wants_search, without_edges,
)
from idic.measure import DicStack, boundary_start, dic_stack, with_boundary_start
from idic.model import Experiment, Noise, build_drives
from idic.run.prepared.prepare import check_before_writing


@dataclass(frozen=True, eq=False)
class Prepared:
    """An experiment that can be identified.

    experiment : with its noise, the excluded frames and the modes of virtual boundaries; local : (n_frames, m) mm,
    start of the frame-local unknowns; free : the free FE-DIC of each camera for which one was made; begin : start
    values that a search found, internal units
    """

    experiment: Experiment
    local: np.ndarray
    free: Mapping[str, DicStack] = field(default_factory=dict)
    begin: Mapping[str, float] | None = None

    @property
    def start(self) -> Experiment:
        """The experiment where the search has left it."""
        if self.begin is None:
            return self.experiment
        return replace(self.experiment, parameters=self.experiment.parameters.with_values(self.begin))

    @property
    def motion(self) -> dict[str, np.ndarray] | None:
        """The first of two steps: per camera (n_frames, n_nodes, 2) px; None where the method is integrated."""
        return {name: free.u_px for name, free in self.free.items()} if is_two_step(self.experiment) else None


def prepare_in_memory(experiment: Experiment, say: Callable[[str], None] = lambda text: None) -> Prepared:
    """Check the experiment and measure what it leaves open, as a run does before its first simulation.

    say : called with a line per trial of a search

    Raises
    ------
    InputError
        If the experiment makes no model, or does not hold what an identification needs.
    """
    check_before_writing(experiment)
    views, free = experiment.views, {}
    if needs_free_dic(experiment):
        free[views[0].camera_name] = dic_stack(views[0], regularisation_of(experiment))
    for view in views[1:]:
        if view.noise.std_gv is None or is_two_step(experiment):
            free[view.camera_name] = dic_stack(view, regularisation_of(experiment))
    found, local = free.get(views[0].camera_name), np.zeros((experiment.n_frames, build_drives(experiment).n_local))
    excluded, seen = list(experiment.excluded), experiment
    if found is not None:
        excluded += [k for k, status in enumerate(found.status) if status == "unexplained" and k not in excluded]
        in_space = motion_in_space(experiment) if needs_motion_in_space(experiment) else None
        lost = np.array([status == "lost" for status in found.status])
        excluded += [k for k in without_edges(experiment, lost, in_space) if k not in excluded]
        local = measured_start(experiment, found.u_px, excluded, in_space)
        seen = with_boundary_start(seen, boundary_start(experiment, found.u_px, excluded, in_space))
    noises = [_noise(view, free, tuple(excluded)) for view in views]
    cameras = tuple(replace(camera, noise=noise) for camera, noise in zip(seen.cameras, noises[1:], strict=True))
    seen = replace(seen, noise=noises[0], cameras=cameras, excluded=tuple(sorted(excluded)))
    return _searched(Prepared(seen, local, free), say)


def _noise(view: Experiment, free: Mapping[str, DicStack], excluded: tuple[int, ...]) -> Noise:
    """The noise of a camera: given, else of its free FE-DIC; and its covariance where consecutive images show one."""
    noise = view.noise
    if noise.std_gv is None:
        noise = replace(noise, std_gv=float(free[view.camera_name].noise_gv), source="residual_of_free_dic")
    return measured_noise(replace(view, noise=noise, excluded=excluded))


def _searched(prepared: Prepared, say: Callable[[str], None]) -> Prepared:
    """With start values from far, where a law needs them."""
    experiment = prepared.experiment
    if not wants_search(experiment):
        return prepared
    name, free, u_px = experiment.views[0].camera_name, dict(prepared.free), None
    if experiment.quantity != "height":
        if name not in free:
            free[name] = dic_stack(experiment, regularisation_of(experiment))
        u_px = free[name].u_px
    bare = replace(experiment, stack=None)
    found = search(experiment, lambda trials: [coarse_fit(bare, u_px, trial.values, trial.evaluations, trial.simplified)
                                               for trial in trials], say)
    return replace(prepared, free=free, begin=found.values if found.moved else None)
