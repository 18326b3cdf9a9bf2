"""Commands of the studies, which `pip install ./studies` adds: `study`, `trial`, `gallery`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Annotated

import typer

from idic.cli.app import MemoryLimit, RefusedStore, Scheduler, Seed, Workers, app, terminal
from idic.cli.command import user_path
from idic.cli.outcomes import outcome
from idic.studies import studies_module


@app.command()
def study(
    name: Annotated[str, typer.Argument(metavar="NAME",
                                        help="bulge | convergence | coverage | misfit | polycarbonate | two-step",
                                        show_default=False)],
    out: Annotated[Path, typer.Option(help="Folder for study.zarr, study.html, figures.")],
    reduced: Annotated[bool, typer.Option("--reduced", help="Small images and meshes: minutes.")] = False,
    only: Annotated[list[str] | None, typer.Option(
        metavar="GROUP", help="Only this group of cases, or this case. May be repeated.")] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    memory_limit: MemoryLimit = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue an earlier study in the folder.")] = False,
    store: RefusedStore = None,
) -> None:
    """Validate the method on virtual tests with known truth (pip install ./studies)."""
    with outcome(run=out, resume=True):
        from idic.run import refuse_store

        refuse_store(store, "study")
        flow = studies_module("flows.study", "idic study")
        with _study_console(flow, out) as console:
            page = flow.run_study(name, out, "reduced" if reduced else "full", only, workers, scheduler, resume,
                                  console, memory_limit)
        typer.echo(f"{user_path(page)} written")


@app.command()
def trial(
    out: Annotated[Path, typer.Option(help="Folder for register, sealed truths, answers, trial.html.")],
    only: Annotated[list[str] | None, typer.Option(
        metavar="GROUP",
        help="singles | clean | outside | pairs | indistinguishable, or the beginning of a trial's name. "
        "May be repeated.")] = None,
    sketch: Annotated[bool, typer.Option("--sketch", help="One trial of each kind, at one strength.")] = False,
    worlds: Annotated[bool, typer.Option("--worlds", help="Drawn specimens, images, programmes and noise; all kinds of "
                                         "effects, from a committed tool only.")] = False,
    known_kinds: Annotated[bool, typer.Option(
        "--known", help="With --worlds: only kinds that development may see.")] = False,
    photographs: Annotated[Path | None, typer.Option(
        metavar="FOLDER", help="30 trials on real surfaces with real noise, from the recordings in FOLDER.")] = None,
    seed: Seed = 1,
    workers: Workers = None,
    scheduler: Scheduler = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue an earlier trial in the folder.")] = False,
    store: RefusedStore = None,
) -> None:
    """Test the diagnosis blind, on virtual tests with sealed truths. CalculiX solves half of the single effects
    (pip install ./studies)."""
    with outcome(run=out, resume=True):
        from idic.errors import InputError
        from idic.run import refuse_store

        refuse_store(store, "trial")
        if photographs and (worlds or known_kinds or sketch):
            raise InputError("two kinds of trials", key="--photographs", expected="--photographs alone",
                             found="it beside --worlds, --known or --sketch", remedy="leave one of them out")
        flow, pool = (studies_module(name, "idic trial") for name in ("flows.blind_trial", "trial.pool"))
        with _study_console(flow, out, ("sealing truths", "trials", "evaluating answers")) as console:
            size = ("pictures" if photographs else ("worlds-known" if known_kinds else "worlds") if worlds
                    else "sketch" if sketch else "full")
            page = flow.run_blind_trial(out, size, seed, only, workers, scheduler, resume, console, photographs)
        typer.echo(pool.target_table(pool.records_of([out])))
        typer.echo(f"{user_path(page)} written")


@app.command()
def gallery(
    out: Annotated[Path, typer.Option(help="Folder for index.html and a folder per experiment.")],
    only: Annotated[list[str] | None, typer.Option(
        metavar="NAME", help="Only this experiment. May be repeated.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue an earlier gallery.")] = False,
) -> None:
    """Make six small experiments with their finished reports (pip install ./studies)."""
    with outcome(run=out, resume=True):
        cases = studies_module("cases.gallery", "idic gallery")
        page = cases.make_gallery(out, only, resume, lambda text: typer.echo(text, err=True))
        typer.echo(f"{user_path(page)} written")


@contextmanager
def _study_console(flow: ModuleType, out: Path, stages: Sequence[str] = ()) -> Iterator:
    """A Prefect server, and the progress of a study on the screen."""
    from idic.cli.progress import progress_view
    from idic.run import PrefectServer

    with PrefectServer.start(), progress_view(terminal(stderr=True), out, stages) as view:
        yield flow.StudyConsole(view.stage, view.tasks, view.said, view.dashboards)
