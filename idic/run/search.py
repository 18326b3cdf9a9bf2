"""The search for start values in a RUN: every coarse fit is a task; ``run.zarr/search`` keeps the finished fits.

``RUN/search.json`` lists every fit with its misfit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from idic.identification import CoarseFit, FoundStart, StartTrial, first_free, search, wants_search
from idic.model import Measured, Model
from idic.run.prepared.context import open_run
from idic.run.prepared.prepare import read_free_motion, run_free_dic
from idic.run.prepared.session import Session
from idic.run.store.arrays import Damaged, read_array, write_array
from idic.run.store.checkpoint import to_hex
from idic.run.store.result_file import write_json

SEARCH_FILE, SCHEMA = "search.json", "idic.search/1"


@dataclass(frozen=True)
class TrialJob:
    """One coarse fit of a RUN."""

    run: str
    number: int
    trial: StartTrial


def start_values(session: Session) -> Mapping[str, float] | None:
    """Values to begin at, internal units; None where the experiment's own start is to be taken."""
    context = session.context
    if not wants_search(context.experiment):
        return None
    if context.experiment.recording.quantity != "height" and context.store.finished("dic") is None:
        job = (session.run, context.settings["experiment"], context.settings["overrides"], 0)
        session.runner.map(run_free_dic, [job], ["free-dic"], retries=1)
    number = [0]

    def fit_all(trials: Sequence[StartTrial]) -> list[CoarseFit]:
        jobs = [TrialJob(session.run, number[0] + k, trial) for k, trial in enumerate(trials)]
        number[0] += len(jobs)
        return session.runner.map(fit_trial, jobs, [f"search-{job.number:02d}" for job in jobs], retries=1,
                                  progress=lambda count, total: session.progress("search", count, total))

    session.say("searching for start values")
    start = search(context.experiment, fit_all, session.say)
    write_json(context.store.run / SEARCH_FILE, _summary(context.experiment.model, start))
    return start.values if start.moved else None


def fit_trial(job: TrialJob) -> CoarseFit:
    """Make a coarse fit; a finished one of exactly this trial is kept (a task)."""
    context = open_run(job.run)
    experiment, trial = context.experiment, job.trial
    names = list(experiment.model.parameters)
    name = f"search/{job.number:02d}"
    ident = {"values": {key: to_hex(value) for key, value in sorted(trial.values.items())},
             "evaluations": trial.evaluations, "simplified": trial.simplified, "free": list(first_free(experiment)),
             "edges": "measured" if any(isinstance(p.drive, Measured) for p in experiment.model.prescribed)
             else "given"}
    finished = _kept(context.store.finished(name, ident), names)
    if finished is not None:
        return finished
    u_px = read_free_motion(context.store) if context.store.finished("dic") is not None else None
    fit = CoarseFit.of(replace(experiment, recording=replace(experiment.recording, stack=None)), u_px, trial.values,
                       trial.evaluations, trial.simplified)
    with context.store.building(name, ident) as folder:
        write_array(folder, "values", np.array([fit.values[key] for key in names]))
        write_array(folder, "facts", np.array([fit.phi, fit.points, fit.evaluations, fit.part], float))
    return fit


def _kept(folder: Path | None, names: Sequence[str]) -> CoarseFit | None:
    """A finished fit; None where there is none, or a damaged one."""
    if folder is None:
        return None
    try:
        phi, points, evaluations, part = read_array(folder, "facts")
        values = read_array(folder, "values").tolist()
    except Damaged:
        return None
    return CoarseFit(dict(zip(names, values, strict=True)), float(phi), int(points), int(evaluations), float(part))


def _summary(model: Model, start: FoundStart) -> dict:
    in_user_units = lambda values: {name: values[name] / model.parameters[name].factor  # noqa: E731
                                    for name in model.parameters.free}
    return {"schema": SCHEMA, "begins_at": in_user_units(start.values),
            "tried": [{"label": label, "misfit": fit.misfit if np.isfinite(fit.phi) else None,
                       "simulated_part": fit.part, "evaluations": fit.evaluations, "values": in_user_units(fit.values)}
                      for label, fit in start.tried]}
