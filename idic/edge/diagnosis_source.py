"""A finished RUN as a diagnosis sees it: its accepted point, and its experiment with edits.

Images stay where the identification put them (`run.zarr`); nothing is identified again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from idic.edge.camera_groups import with_stored_images, with_stored_noise
from idic.edge.config import load_experiment
from idic.edge.identification import load_state, take_up
from idic.edge.runner import SerialRunner
from idic.edge.system_store import load_evaluation
from idic.edge.tasks import BASE, DESCRIPTION, RunContext, group_name, open_run
from idic.edge.toml_file import locate, read_toml, with_overrides
from idic.edge.zarr_arrays import read_array
from idic.errors import InputError
from idic.experiment import Experiment
from idic.identify.in_memory import Identification


@dataclass(frozen=True)
class Source:
    """Where a diagnosis gets its experiments from; plain data, so that it travels to a worker.

    run : the RUN folder; edits : overrides of experiment.toml that belong to the present null model
    """

    run: str
    edits: Mapping[str, object]

    @property
    def context(self) -> RunContext:
        return open_run(self.run)

    def document(self) -> dict:
        """Tables of experiment.toml with the run's overrides and the present edits."""
        settings = self.context.settings
        raw = with_overrides(read_toml(locate(settings["experiment"])), settings["overrides"])
        return with_overrides(raw, self.edits)

    def load(self, edits: Mapping[str, object] | None = None) -> Experiment:
        """The experiment with further edits and the run's images, noise and excluded frames."""
        settings = self.context.settings
        overrides = {**settings["overrides"], **self.edits, **(edits or {})}
        experiment = load_experiment(settings["experiment"], overrides)
        experiment = with_stored_noise(with_stored_images(self.context.store, experiment), settings)
        return replace(experiment, excluded=tuple(settings["excluded"]))

    def with_edits(self, edits: Mapping[str, object]) -> Source:
        return replace(self, edits={**self.edits, **edits})


def open_source(run: str | Path) -> tuple[Source, Identification]:
    """A RUN and where its identification ended.

    Raises
    ------
    InputError
        If there is no finished identification, or one that this diagnosis cannot start from.
    """
    run = Path(run)
    if not (run / DESCRIPTION).exists():
        raise InputError("there is no identification to diagnose", file=run, expected="a RUN folder of idic identify",
                         found="none", remedy="run  idic identify EXPERIMENT --out RUN  first")
    session = take_up(run, SerialRunner(), "direct")
    state = load_state(session)
    if state is None or state.accepted is None:
        raise InputError("the identification has no accepted point", file=run, expected="a finished identification",
                         found="none that was accepted", remedy="see RUN/report.html for what went wrong")
    context = session.context
    _check(context.experiment, run)
    number = state.accepted_evaluation
    point = load_evaluation(context.store, number, context.names)
    local = read_array(context.store.group(group_name(number, "start")), "local")
    steps = np.array(read_array(context.store.group(group_name(number, BASE)), "steps"), float)
    return Source(str(run), {}), Identification(context.experiment, context.forward, state, point, local, steps,
                                                context.weights)


def _check(experiment: Experiment, run: Path) -> None:
    if experiment.options.weighting != "noise":
        raise InputError("a diagnosis weighs by noise", file=run, key="[options] weighting", expected='"noise"',
                         found=repr(experiment.options.weighting), remedy='identify with weighting = "noise"')

