"""`idic trial`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from idic.cli.commands import Scheduler, Seed, Workers, app
from idic.cli.outcomes import outcome


@app.command()
def trial(
    out: Annotated[Path, typer.Option(help="Folder for register, sealed truths, answers, trial.html.")],
    only: Annotated[
        list[str] | None,
        typer.Option(help="singles | clean | outside | pairs | twins, or the beginning of a trial's name. Repeatable."),
    ] = None,
    sketch: Annotated[bool, typer.Option("--sketch", help="One trial of each kind, not three strengths.")] = False,
    seed: Seed = 1,
    workers: Workers = None,
    scheduler: Scheduler = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with an earlier trial in the folder.")] = False,
) -> None:
    """Blind trial of the diagnosis: virtual tests with sealed truths, half of them solved by CalculiX; scores."""
    with outcome(run=out, resume=True):
        from rich.console import Console

        from idic.cli.progress import progress_view
        from idic.workers.prefect_server import start_server

        with start_server(), progress_view(Console(stderr=True, soft_wrap=True), out) as view:
            from idic_flows.blind_trial import run_blind_trial
            from idic_flows.study import StudyConsole

            callbacks = StudyConsole(view.stage, view.tasks, view.said, view.dashboards)
            page = run_blind_trial(out, "sketch" if sketch else "full", seed, only, workers, scheduler, resume,
                                   callbacks)
        typer.echo(f"{page} written")
