"""`idic identify` and `idic demo`: an identification, its table, its report."""

from __future__ import annotations

import gc
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from idic.cli.app import (AllowExternal, FileStore, MemoryLimit, Overrides, RefusedStore, Scheduler, Sensitivity,
                          SensitivityOption, UsePrefect, Workers, app, exit_code, is_watched, orchestrator_of,
                          read_overrides, terminal)
from idic.cli.command import user_path
from idic.cli.outcomes import outcome, paused

if TYPE_CHECKING:
    from idic.run import SecondProcess

FIGURES_FOLLOW = "residual maps and result"
STAGES = ("reading images", "preparation", "identification", FIGURES_FOLLOW, "report")


class Method(StrEnum):
    integrated = "integrated"
    two_step = "two-step"
    two_step_unweighted = "two-step-unweighted"


@app.command()
def identify(
    experiments: Annotated[list[Path], typer.Argument(
        metavar="EXPERIMENT...", help="Experiment folders; several tests share materials of the same name.")],
    out: Annotated[Path, typer.Option(metavar="RUN", help="Folder for all results.")],
    resume: Annotated[bool, typer.Option("--resume", help="Continue an interrupted RUN.")] = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
    memory_limit: MemoryLimit = None,
    sensitivity: SensitivityOption = Sensitivity.auto,
    method: Annotated[Method | None, typer.Option(
        help="integrated: the law is fitted to the images; two-step: to the displacements of a free FE-DIC.")] = None,
    pause_after: Annotated[int | None, typer.Option(
        metavar="STAGE", help="Pause after this stage of the schedule; --resume continues with the next.")] = None,
    overrides: Overrides = None,
    prefect: UsePrefect = None,
    report: Annotated[bool, typer.Option(
        "--report/--no-report",
        help="--no-report: results only; idic report RUN makes the page and its figures.")] = True,
    allow_external: AllowExternal = None,
    store: FileStore = None,
) -> None:
    """Identify parameters from images and forces."""
    began = time.monotonic()
    with outcome(run=out, resume=True):
        if method is not None:
            overrides = [*(overrides or ()), f"options.method={method.value.replace('-', '_')}"]
        with _drawing_beside() as second:
            result = _identify(experiments, out, resume, workers, scheduler, sensitivity, overrides,
                               is_watched(prefect), began, second if report else None, memory_limit, pause_after,
                               store)
            _show_result(result, out, began, second if report else None)
        if "paused_after_stage" in result:
            typer.echo(paused(result["paused_after_stage"]), err=True)
        raise typer.Exit(exit_code(result["status"]))


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder for experiment and run.")] = Path("idic-demo"),
    workers: Workers = None,
    scheduler: Scheduler = None,
    prefect: UsePrefect = None,
    store: RefusedStore = None,
) -> None:
    """Identify a small built-in experiment with known truth."""
    run, began = out / "run", time.monotonic()
    with outcome(run=run):
        from idic.run import Workplace, refuse_store

        refuse_store(store, "demo")
        Workplace(workers, scheduler).check(run)  # before anything is written
        _clear_earlier_demo(out)
        typer.echo(f"writing a virtual tensile test with known parameters to {user_path(out / 'experiment')}")
        with _drawing_beside() as second:
            watched = is_watched(prefect)
            with _server(watched), _compiling_where_cold():
                from idic.virtual_tests import write_example

                write_example("demo", out / "experiment")
                result = _identify([out / "experiment"], run, False, workers, scheduler, Sensitivity.auto, None,
                                   watched, began, second)
            _show_result(result, run, began, second, out / "experiment" / "truth.json")
        raise typer.Exit(exit_code(result["status"]))


def _identify(experiments, out: Path, resume, workers, scheduler, sensitivity, overrides, prefect: bool,
              began: float, second: SecondProcess | None, memory_limit=None, pause_after: int | None = None,
              store: str | None = None) -> dict:
    """second : draws figures of the report afterwards; None: there is no report."""
    from idic.cli.progress import progress_view

    settings = read_overrides(overrides)
    console, stages = terminal(stderr=True), STAGES if second else STAGES[:-1]
    spent_s = time.monotonic() - began
    with _server(prefect), progress_view(console, out, stages, spent_s) as view:  # it starts while we import
        with _without_collection():
            from idic.run import Console as Callbacks, Workplace, identify_run, import_meanwhile

            orchestrator = orchestrator_of(prefect)
            if prefect and second:
                import_meanwhile("idic.run.reporting.write")

        def stage(text: str) -> None:
            if second and text == FIGURES_FOLLOW:
                second.start()  # beside the last stage, which leaves a core idle
            view.stage(text)

        callbacks = Callbacks(stage, view.tasks, view.iteration, view.dashboards, view.said)
        return identify_run(experiments, out, resume=resume, overrides=settings, sensitivity=sensitivity.value,
                            pause_after=pause_after, console=callbacks, orchestrator=orchestrator,
                            workplace=Workplace(workers, scheduler, memory_limit, store))


@contextmanager
def _without_collection() -> Iterator[None]:
    """While modules are loaded: they make a million objects, and looking which of them are garbage takes a tenth."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


def _server(prefect: bool) -> AbstractContextManager:
    """A Prefect server, where the command uses one."""
    if not prefect:
        return nullcontext()
    from idic.run import PrefectServer

    return PrefectServer.start()


def _drawing_beside() -> AbstractContextManager[SecondProcess]:
    from idic.run import drawing_beside

    return drawing_beside()


def _show_result(result: dict, run: Path, began: float, second: SecondProcess | None,
                 truth_file: Path | None = None) -> None:
    """Print the result; `second` as of `_identify`."""
    import json

    from idic.cli.progress import progress_view
    from idic.cli.tables import laid_out
    from idic.report import remarks, result_table, summary_line

    truth = json.loads(truth_file.read_text(encoding="utf-8")) if truth_file is not None else None
    console = terminal()
    console.print(summary_line(result), highlight=False, markup=False)
    console.print(laid_out(result_table(result, truth)))
    for text in remarks(result):
        console.print(text, highlight=False, markup=False)
    console.print(f"results  {user_path(run / 'result.json')}", highlight=False)
    if second is None:
        return
    from idic.run import write_report

    with progress_view(terminal(stderr=True), run, STAGES, time.monotonic() - began) as view:
        view.stage("report")
        page = write_report(run, second=second)
    console.print(f"report   {user_path(page)}", highlight=False)


def _compiling_where_cold() -> AbstractContextManager:
    """Where nothing is compiled yet, a second process compiles beside the first steps of the demo."""
    from idic.correlation import residual_pass
    from idic.laws import has_code_on_disk, is_kept, stress_loop
    from idic.run import compiling_meanwhile

    if is_kept(stress_loop) and has_code_on_disk(residual_pass):
        return nullcontext()
    return compiling_meanwhile("idic.virtual_tests.rehearsal")


def _clear_earlier_demo(out: Path) -> None:
    """Remove the folders of an earlier `idic demo`, and nothing else."""
    import shutil

    if (out / "experiment" / "truth.json").is_file():
        shutil.rmtree(out / "experiment")
    if (out / "run" / "run.zarr").is_dir():
        shutil.rmtree(out / "run")
