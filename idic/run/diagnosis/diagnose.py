"""`idic diagnose` on a RUN folder: refits run and stored, and the files that a diagnosis leaves."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from threadpoolctl import threadpool_limits

from idic.diagnose import (
    Candidate, Diagnosis, Margin, Notes, SEED, Stage, diagnose as diagnose_identification, diagnose_without_spots,
    silent,
)
from idic.report import diagnosis_content, diagnosis_page
from idic.run.diagnosis.far import judged_by_images, on_measured_motion
from idic.run.diagnosis.enriched import write_enriched
from idic.run.diagnosis.crack import cracks_content
from idic.run.diagnosis.diagnosis_file import identified_parameters, write_diagnosis, write_page
from idic.run.diagnosis.refits import RefitStore, run_refits
from idic.run.diagnosis.source import open_source
from idic.run.judgement.floor import PointJob, measured_floor
from idic.run.orchestrator import DIRECT, Command, Console, Hooks, Orchestrator
from idic.run.prepared.context import experiments_of
from idic.run.store.run_lock import run_lock
from idic.run.workers.runner import TaskRunner
from idic.run.workers.workplace import IN_PROCESS, Workplace


def diagnose(run: str | Path, runner: TaskRunner, stage: Stage = silent, seed: int = SEED,
             library: Sequence[Candidate] | None = None, resume: bool = False, quick: bool = False) -> Diagnosis:
    """Diagnose the finished identification of a RUN; writes only the refits, and the camera's floor where it is
    not known yet.

    Parameters
    ----------
    stage : called with the name of every step that begins
    seed : of the noise that makes two copies of the recording
    library : candidates to test, all registered ones by default
    resume : refits that an interrupted diagnosis of this RUN has finished are not repeated
    quick : screening and refit of the most promising candidate alone

    Raises
    ------
    InputError
        If the RUN holds no finished identification.
    NotConverged
        If the identified model finds no equilibrium on a copy of the recording.
    """
    source, identification = open_source(run)
    accepted = identification.state.accepted
    stage("floor of the camera, register and spots of the images")
    floor = measured_floor(PointJob(str(run), accepted.number, accepted.values), runner)
    motion_fit = on_measured_motion(source, identification, runner, stage)
    source, identification, register = motion_fit or (source, identification, None)
    answer = diagnose_identification if motion_fit else diagnose_without_spots
    diagnosis = answer(source, identification, partial(run_refits, runner, RefitStore(run, resume)), stage, seed=seed,
                       library=library, margin=Margin(floor), quick=quick)
    return diagnosis if register is None else replace(diagnosis, register=judged_by_images(diagnosis, register, stage))


def diagnose_run(run: str | Path, *, resume: bool = False, quick: bool = False,
                 library: Sequence[Candidate] | None = None, workplace: Workplace = IN_PROCESS,
                 console: Console | None = None, orchestrator: Orchestrator = DIRECT) -> dict:
    """Diagnose a finished RUN; writes diagnosis.json, diagnosis.html, the enriched experiment.

    Parameters
    ----------
    resume, quick, library : as in `diagnose`
    workplace, console, orchestrator : as of `idic.run.identify_run`

    Returns
    -------
    The content of ``RUN/diagnosis.json``.

    Raises
    ------
    InputError
        If the RUN holds no finished identification, or another process works on it; nothing has been written then.
    """
    began, console = time.perf_counter(), console or Console()
    open_source(run)
    workplace.check(run, say=console.stage)

    def work(hooks: Hooks) -> dict:
        diagnosis = hooks.stage("diagnose", partial(diagnose, library=library, resume=resume, quick=quick), str(run),
                                hooks.runner, console.stage)
        console.stage("writing figures and the enriched experiment")
        return hooks.stage("write", write_all, str(run), diagnosis, began)

    with (run_lock(run), orchestrator.opened(), threadpool_limits(1, user_api="blas"),
          workplace.opened(run, experiments_of(run), ("idic.run.diagnosis.diagnose",), console.remark) as runner):
        command = Command("diagnose", "the diagnosis", {"run": str(run), "resume": resume, "quick": quick,
                                                        "workers": runner.workers})
        return orchestrator.conduct(command, runner, console, work)


def write_all(run: str | Path, diagnosis: Diagnosis, began: float) -> dict:
    """Write every file of a diagnosis into the RUN folder; returns the content of diagnosis.json.

    What fails beside the verdict becomes a note in it.

    began : time.perf_counter() at its start
    """
    notes = Notes(diagnosis.notes)
    verdict = diagnosis_content(diagnosis, identified_parameters(run), cracks=cracks_content(diagnosis))

    def write(enriched: Path | None = None) -> dict:
        return write_diagnosis(run, verdict, enriched, time.perf_counter() - began, notes.texts)

    write()  # the verdict first: nothing that follows may cost it
    enriched = notes.attempt("the enriched experiment", _enriched, diagnosis)
    content = write(enriched)
    page = diagnosis_page(diagnosis, content, notes)
    if page is not None:
        notes.attempt("the page", write_page, run, *page)
    return write(enriched)


def _enriched(diagnosis: Diagnosis) -> Path | None:
    """The experiment with the selected candidates, None without one."""
    if diagnosis.enriched is None:
        return None if diagnosis.spots is None else write_enriched(
            diagnosis.source, diagnosis.identification.experiment, diagnosis.identification.parameters.as_values(),
            diagnosis.spots.names)
    enriched = diagnosis.enriched
    return write_enriched(enriched.source, enriched.residual.context.experiment, enriched.fit.values,
                          diagnosis.verdict.selected)
