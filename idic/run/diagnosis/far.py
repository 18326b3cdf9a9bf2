"""A RUN whose images are out of register with its model, as a diagnosis on the measured motion sees it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from idic.diagnose import (
    Diagnosis, OutOfRegister, by_motion, image_chi2, may_be_out_of_register, out_of_register, with_edge_modes,
)
from idic.identification import Identification, identify
from idic.measure import BoundaryStart, with_boundary_start
from idic.model import Experiment
from idic.run.diagnosis.source import Source
from idic.run.prepared.prepare import read_free_dic, read_free_motion, run_free_dic
from idic.run.store.run_store import RunStore
from idic.run.workers.runner import TaskRunner

GROUP = "dic"
MAX_IMAGE_EVALUATIONS = 6  # of the enriched model on the images: enough to see whether it comes into register


@dataclass(frozen=True)
class MotionSource(Source):
    """A source whose experiments hold the motion that the free FE-DIC of the RUN measured, in the place of images."""

    def load(self, edits: Mapping[str, Any] | None = None) -> Experiment:
        """See `Source.load`."""
        return by_motion(super().load(edits), read_free_motion(RunStore(self.run)), _unexplained(self))

    def images(self) -> Experiment:
        """The experiment with its images, virtual edges as they begin."""
        experiment, u_px = super().load(), read_free_motion(RunStore(self.run))
        return with_boundary_start(experiment, BoundaryStart.of(experiment, u_px, experiment.recording.excluded))


def on_measured_motion(source: Source, identification: Identification, runner: TaskRunner,
                       stage: Callable[[str], None]) -> tuple[Source, Identification, OutOfRegister] | None:
    """The identified model fitted to the measured motion, and its source; None where the images are in register."""
    if not may_be_out_of_register(identification):
        return None
    u_px = _measured(source, runner, stage)
    register = out_of_register(identification, u_px, _unexplained(source))
    if register is None:
        return None
    stage("fit of the identified model to the measured motion: the images are out of register")
    edits = with_edge_modes(source.document(), identification.experiment, u_px)
    motion_source = MotionSource(source.run, {**source.edits, **edits})
    experiment = motion_source.load()
    values = {name: value for name, value in identification.parameters.as_values().items()
              if name in experiment.model.parameters}
    starts = experiment.model.parameters.with_values(values)
    fit = identify(replace(experiment, model=replace(experiment.model, parameters=starts), stages=()))
    return motion_source, fit, register


def judged_by_images(diagnosis: Diagnosis, register: OutOfRegister, stage: Callable[[str], None]) -> OutOfRegister:
    """The enriched model on the images: fitted from its end on the measured motion, for a few evaluations."""
    source, final = diagnosis.source, diagnosis.state.final
    if final is None or not final.fit.usable or not isinstance(source, MotionSource):
        return register
    stage("fit of the enriched model to the images")
    experiment = source.images()
    options = replace(experiment.options, max_iterations=MAX_IMAGE_EVALUATIONS)
    starts = experiment.model.parameters.with_values(
        {name: value for name, value in final.fit.values.items() if name in experiment.model.parameters})
    image_fit = identify(replace(experiment, model=replace(experiment.model, parameters=starts), options=options,
                                 stages=()))
    return register if image_fit.point is None else replace(register, enriched_chi2=image_chi2(image_fit))


def _unexplained(source: Source) -> list[int]:
    """Frames that their own free FE-DIC does not describe."""
    return np.flatnonzero(read_free_dic(RunStore(source.run))["unexplained"]).tolist()


def _measured(source: Source, runner: TaskRunner, stage: Callable[[str], None]) -> np.ndarray:
    """Nodal motion by the free FE-DIC of the RUN, which is made where it was not needed before  # (n_frames, n_nodes,
    2) px"""
    store = RunStore(source.run)
    if store.finished(GROUP) is None:
        stage("free FE-DIC of all frames")
        settings = source.context.settings
        runner.map(run_free_dic, [(source.run, settings["experiment"], settings["overrides"], 0)], ["free-dic"],
                   retries=1)
    return read_free_motion(store)
