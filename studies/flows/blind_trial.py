"""The blind trial as a Prefect flow: sealing of the truths, one Dask task per trial, evaluation."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from idic.errors import InputError
from idic.run import TaskRunner, check_scheduler, open_cluster
from idic_studies.trial.plan import Campaign, Trial
from idic_studies.trial.seal import REGISTER, Folder, seal, tool_state
from idic_studies.trial.trial import TrialJob, check_solvers, run_trial
from idic_studies.trial.trial_page import write_trial_page
# before Prefect: it reads its settings from the environment
from idic_flows.settings import connected, flow_server, show_dashboards
from idic_flows.shown_runner import ShownRunner
from idic_flows.stages import run_stage
from idic_studies.flows.study import StudyConsole


def run_blind_trial(out: str | Path, size: str = "full", seed: int = 1, only: Sequence[str] | None = None,
                    workers: int | None = None, scheduler: str | None = None, resume: bool = False,
                    console: StudyConsole | None = None, photographs: str | Path | None = None) -> Path:
    """Run the unanswered trials and write ``OUT/trial.html``; returns its path.

    Parameters
    ----------
    size, seed : of the campaign, see `idic_studies.trial.plan.Campaign`
    only : groups, or beginnings of keys such as ``singles/plasticity``
    resume : continue an earlier trial in the folder
    photographs : folder of real surfaces, for the size "pictures"

    Raises
    ------
    InputError
        A folder in use, another campaign in it, an unknown group; nothing is written.
    """
    console, folder = console or StudyConsole(), Folder(Path(out))
    campaign = Campaign(size, seed, photographs=str(Path(photographs).absolute()) if photographs else "")
    chosen = campaign.select(only)
    if (folder.out / REGISTER).exists() and not resume:
        raise InputError("this trial exists already", file=folder.out, expected="a new folder, or --resume",
                         found="an earlier trial", remedy="add --resume to continue it, or choose another --out")
    check_scheduler(scheduler, out, say=console.stage)
    with flow_server() as server, open_cluster(workers, scheduler, preload=("idic_studies.trial.trial",)) as runner:
        console.stage("starting Prefect")
        with connected(server):
            show_dashboards(console.dashboards, server, runner.dashboard)
            return _trial_in_prefect(_Run(folder, campaign, chosen, ShownRunner(runner), console))


@dataclass(frozen=True)
class _Run:
    folder: Folder
    campaign: Campaign
    chosen: tuple[Trial, ...]
    runner: TaskRunner
    console: StudyConsole


def _trial_in_prefect(run: _Run) -> Path:
    """The flow; made here because importing Prefect takes seconds. Its parameters are what Prefect's pages show."""
    from prefect import flow

    @flow(name="idic-trial", flow_run_name=f"trial-{time.strftime('%H%M%S')}", validate_parameters=False,
          persist_result=False)
    def whole(trials: int, out: str, workers: int) -> Path:
        run.console.stage("sealing truths")
        numbers = run_stage("seal", seal, run.folder, run.campaign, run.chosen, tool_state())
        open_ones = run.folder.unanswered(numbers.values())
        check_solvers(run.folder, open_ones)
        run_stage("trials", _fan_out, run, open_ones)
        run.console.stage("evaluating answers")
        return run_stage("evaluate", write_trial_page, run.folder)

    return whole(len(run.chosen), str(run.folder.out), run.runner.workers)


def _fan_out(run: _Run, numbers: Sequence[str]) -> None:
    run.console.stage("trials")
    run.console.tasks("trials", 0, len(numbers))
    jobs = [TrialJob(str(run.folder.out), number) for number in numbers]
    for _ in run.runner.stream(run_trial, jobs, [f"trial-{number}" for number in numbers],
                               progress=lambda count, total: run.console.tasks("trials", count, total)):
        pass


__all__ = ["StudyConsole", "run_blind_trial"]
