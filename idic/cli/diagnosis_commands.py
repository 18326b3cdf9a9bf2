"""`idic diagnose` and `idic physics`."""

from __future__ import annotations

from typing import Annotated

import typer

from idic.cli.app import (FileStore, MemoryLimit, Run, Scheduler, UsePrefect, Workers, app, is_watched,
                          orchestrator_of, terminal, wide_console)
from idic.cli.command import user_path
from idic.cli.outcomes import outcome


@app.command()
def diagnose(
    run: Run,
    workers: Workers = None,
    scheduler: Scheduler = None,
    memory_limit: MemoryLimit = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue an interrupted diagnosis.")] = False,
    quick: Annotated[bool, typer.Option("--quick", help="Refit the most promising candidate alone.")] = False,
    prefect: UsePrefect = None,
    store: FileStore = None,
) -> None:
    """Find the physics that is missing in the model; refit.

    Locate the disagreement of model and recording, select a candidate, refit with it and test it on held-out frames.
    """
    with outcome(run=run, resume=True):
        from idic.cli.progress import progress_view
        from idic.cli.tables import laid_out
        from idic.diagnose import stages
        from idic.report import candidates_table, diagnosis_lines
        from idic.run import Console, Workplace, diagnose_run, open_source

        open_source(run)  # before a server is started
        with progress_view(terminal(stderr=True), run, stages(quick)) as view:
            content = diagnose_run(run, resume=resume, quick=quick, console=Console(view.stage, remark=view.said),
                                   workplace=Workplace(workers, scheduler, memory_limit, store),
                                   orchestrator=orchestrator_of(is_watched(prefect)))
        console = terminal()
        for text in diagnosis_lines(content):
            console.print(text, highlight=False, markup=False)
        (console if console.is_terminal else wide_console()).print(laid_out(candidates_table(content)))
        console.print(f"results  {user_path(run / 'diagnosis.json')}\nreport   {user_path(run / 'diagnosis.html')}",
                      highlight=False)
        if content["model"]["experiment"]:
            console.print(f"model    {user_path(run / content['model']['experiment'])}", highlight=False)


@app.command()
def physics(
    name: Annotated[str | None, typer.Argument(help="Only this one.", show_default=False)] = None,
) -> None:
    """List the candidate physics that `idic diagnose` knows."""
    with outcome():
        from idic.cli.physics_table import physics_table
        from idic.diagnose import candidate_library
        from idic.errors import InputError

        library = {candidate.name: candidate for candidate in candidate_library()}
        if name is not None and name not in library:
            raise InputError("no such candidate", key="idic physics NAME", expected=", ".join(library),
                             found=repr(name), remedy="choose one of these")
        wide_console().print(physics_table([library[name]] if name else list(library.values())))
