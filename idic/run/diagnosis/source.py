"""A finished RUN as a diagnosis sees it: its accepted point, and its experiment with edits.

Images stay where the identification put them (`run.zarr`); nothing is identified again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from idic.errors import InputError
from idic.experiment_file import with_overrides
from idic.identification import Identification
from idic.measure import BoundaryStart, with_boundary_start
from idic.model import Experiment, Model, MotionError, Options, Parametrised
from idic.run.prepared.context import RunContext, open_run, stored_start
from idic.run.prepared.session import open_session
from idic.run.prepared.warm_start import first_order_prediction
from idic.run.store.arrays import Damaged, read_array
from idic.run.store.layout import BASE, DESCRIPTION, group_name
from idic.run.store.result_file import RESULT_FILE, read_result
from idic.run.store.state_file import load_state
from idic.run.store.system_store import load_evaluation
from idic.run.workers.runner import SerialRunner


@dataclass(frozen=True)
class Source:
    """Where a diagnosis gets its experiments from; plain data, so that it travels to a worker.

    run : the RUN folder; edits : overrides of experiment.toml that belong to the present null model; motion_error : of
    the mesh, added to every simulation
    """

    run: str
    edits: Mapping[str, Any]
    motion_error: MotionError | None = field(default=None, repr=False)

    @property
    def context(self) -> RunContext:
        return open_run(self.run)

    def document(self) -> dict:
        """Tables of experiment.toml with the run's overrides and the present edits."""
        return with_overrides(self.context.tables.raw, self.edits)

    def load(self, edits: Mapping[str, Any] | None = None) -> Experiment:
        """The experiment with further edits and the run's images, noise and excluded frames."""
        context = self.context
        experiment = context.tables.edited({**self.edits, **(edits or {})}, context.experiment).experiment()
        experiment = with_boundary_start(experiment, _of_edges(experiment.model, stored_start(context.store,
                                                                                        context.settings)))
        return replace(experiment, model=replace(experiment.model, motion_error=self.motion_error))

    def with_edits(self, edits: Mapping[str, Any]) -> Source:
        return replace(self, edits={**self.edits, **edits})

    def with_motion_error(self, error: MotionError | None) -> Source:
        return replace(self, motion_error=error)


def _of_edges(model: Model, start: BoundaryStart) -> BoundaryStart:
    """What a run has measured of its virtual edges, as far as the edited experiment still has them."""
    virtual = {f"{entry.nodes}.{entry.component}" for entry in model.prescribed
               if isinstance(entry.drive, Parametrised) and entry.drive.kind == "dic"}
    return BoundaryStart({name: value for name, value in start.values.items() if name in model.parameters},
                         {name: modes for name, modes in start.modes.items() if name in virtual})


def open_source(run: str | Path) -> tuple[Source, Identification]:
    """A RUN and where its identification ended.

    Raises
    ------
    InputError
        If there is no finished identification, or one that this diagnosis cannot start from.
    """
    run = Path(run)
    if not (run / DESCRIPTION).exists() and not (run / RESULT_FILE).exists():
        raise InputError("there is no identification to diagnose", file=run, expected="a RUN folder of idic identify",
                         found="none", remedy="run  idic identify EXPERIMENT --out RUN  first")
    if (run / RESULT_FILE).exists():
        read_result(run)  # the diagnosis writes next to it: a damaged result is reported now
    session = open_session(run, SerialRunner(), "direct")
    state = load_state(run)
    if state is None or state.accepted is None:
        raise InputError("the identification has no accepted point", file=run, expected="a finished identification",
                         found="none that was accepted", remedy="see RUN/report.html for what went wrong")
    context = session.context
    _check(context.experiment.options, run)
    number = state.accepted.number
    point = load_evaluation(context.store, number, context.names)
    local = read_array(context.store.group(group_name(number, "start")), "local")
    simulation = context.store.group(group_name(number, BASE))
    steps = np.array(read_array(simulation, "steps"), float)
    return Source(str(run), {}), Identification(context.experiment, context.forward, state, point, local, steps,
                                                context.weights, stored=_stored(simulation))


def _stored(simulation: Path) -> Callable[[], Iterator[np.ndarray]] | None:
    """Displacements of the accepted point, frame by frame; None where they are damaged: marches begin from nothing."""
    read = partial(first_order_prediction, simulation, np.zeros(0))
    try:
        for _ in read():
            pass
    except Damaged:
        return None
    return read


def _check(options: Options, run: Path) -> None:
    if options.weighting != "noise":
        raise InputError("a diagnosis weighs by noise", file=run, key="[options] weighting", expected='"noise"',
                         found=repr(options.weighting), remedy='identify with weighting = "noise"')

