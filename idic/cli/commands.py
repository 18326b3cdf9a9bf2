"""The commands of `idic`. Each reads its arguments, calls one function of a lower layer, and shows what came back."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from idic.cli.outcomes import DONE, INTERRUPTED, NOT_CONVERGED, outcome
from idic.cli.permission import AllowExternal, LawFiles
from idic.errors import InputError
from idic.workers.dask_settings import use_one_thread

app = typer.Typer(
    name="idic",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    epilog="Start with:  idic demo",
)


class Sensitivity(StrEnum):
    direct = "direct"
    perturbed = "perturbed"
    auto = "auto"


class Method(StrEnum):
    integrated = "integrated"
    two_step = "two-step"
    two_step_unweighted = "two-step-unweighted"


Experiment = Annotated[Path, typer.Argument(help="Experiment folder (or its experiment.toml).", show_default=False)]
Workers = Annotated[int | None, typer.Option(min=0, help="Worker processes; default one per core, 0: none.")]
MemoryLimit = Annotated[
    str | None, typer.Option(help="Memory of each worker process, e.g. 2GB [default: its share of the machine].")
]
Scheduler = Annotated[str | None, typer.Option(help="Address of an existing Dask scheduler.")]
SensitivityOption = Annotated[
    Sensitivity, typer.Option(help="Direct differentiation, or one perturbed run per parameter.")
]
Bits = Annotated[int, typer.Option(help="Grey depth: 8, 12 or 16.")]
Seed = Annotated[int, typer.Option(min=0, help="Seed of speckle and noise.")]
Overrides = Annotated[
    list[str] | None, typer.Option("--set", help="key=value, over what experiment.toml says. May be repeated.")
]


def main() -> None:
    """Entry point of the command ``idic``."""
    use_one_thread()
    app()


def _show_version(wanted: bool) -> None:
    if wanted:
        import idic

        typer.echo(f"idic {idic.__version__}")
        raise typer.Exit(DONE)


@app.callback()
def common(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit.")
    ] = False,
    laws: LawFiles = None,
) -> None:
    """Time-resolved integrated digital image correlation: images and force in, constitutive parameters out."""


@app.command()
def init(folder: Annotated[Path, typer.Argument(help="Folder with images, and perhaps a mesh and a log.")]) -> None:
    """Write a commented experiment.toml for a folder of images."""
    with outcome():
        from idic.experiment_file.init import write_initial_experiment

        typer.echo(f"{write_initial_experiment(folder)} written; fill it in, then run: idic check {folder}")


@app.command()
def check(
    experiment: Experiment,
    out: Annotated[
        Path | None, typer.Option(help="Picture of the mesh on the image [default: EXPERIMENT/check/mesh.png]")
    ] = None,
    picture: Annotated[bool, typer.Option(help="--no-picture: no drawing, nothing is written.")] = True,
    overrides: Overrides = None,
) -> None:
    """Read and validate everything, draw the mesh on the image."""
    with outcome():
        from idic.run.reporting.check import check as check_experiment
        from idic.experiment_file.load import load_experiment

        loaded = load_experiment(experiment, read_overrides(overrides))
        found = check_experiment(loaded, draw=picture)
        for line in found.lines():
            typer.echo(line)
        if not picture:
            return
        main = out or Path(loaded.folder) / "check" / "mesh.png"
        try:
            main.parent.mkdir(parents=True, exist_ok=True)
        except OSError as problem:  # data that may only be read are no fault of theirs
            if out is not None:
                raise
            typer.echo(f"picture      none ({main.parent}: {problem.strerror}); --out FILE draws it elsewhere")
            return
        for camera in (found, *found.cameras):
            path = main if camera is found else main.with_name(f"{main.stem}_{camera.name}{main.suffix}")
            path.write_bytes(camera.overlay.png)
            typer.echo(f"picture      {path}")


@app.command()
def design(
    experiments: Annotated[
        list[Path], typer.Argument(metavar="EXPERIMENT...", help="Planned tests; [design] says what is not there yet.")
    ],
    out: Annotated[Path, typer.Option(help="Folder for design.html, design.json, design.csv.")] = Path("idic-design"),
    noise_gv: Annotated[
        float | None, typer.Option(min=0, help="Image noise in grey values [default: the experiment's]")
    ] = None,
    confusable: Annotated[float, typer.Option(help="Correlation above which parameters count as confusable.")] = 0.95,
    workers: Workers = None,
    overrides: Overrides = None,
    allow_external: AllowExternal = None,
) -> None:
    """Say before a test what it will determine; compare plans."""
    with outcome():
        from idic.cli.design_tables import show_design
        from idic.run.design.write import PAGE_FILE, write_design

        content = write_design(experiments, out, read_overrides(overrides), noise_gv, confusable, workers)
        show_design(_wide_console(), content)
        typer.echo(f"page     {out / PAGE_FILE}")


@app.command()
def example(
    name: Annotated[str, typer.Argument(help="demo, polycarbonate, bulge, ...", show_default=False)],
    out: Annotated[Path, typer.Option(help="Folder to write; it must not hold anything yet.")],
    reduced: Annotated[bool, typer.Option("--reduced", help="Smaller and faster.")] = False,
    noise: Annotated[float | None, typer.Option(help="Noise / contrast (standard deviations).")] = None,
    bits: Bits = 8,
    seed: Seed = 0,
    foreign: Annotated[bool, typer.Option("--foreign", help="bulge, polycarbonate: truth on a finer mesh.")] = False,
) -> None:
    """Write a complete experiment folder with known truth."""
    with outcome():
        from idic.virtual_tests.examples import write_example

        written = write_example(name, out, reduced, noise, bits, seed, foreign)
        command = f"design {out}/* --out DIR" if written.is_dir() else f"identify {out} --out RUN"
        typer.echo(f"{written} written; now: idic {command}")


@app.command()
def simulate(
    experiment: Experiment,
    out: Annotated[Path, typer.Option(help="Folder for the virtual experiment; it must not hold anything yet.")],
    noise_gv: Annotated[
        float | None, typer.Option(min=0, help="Noise in grey values [default: the experiment's]")
    ] = None,
    bits: Bits = 8,
    seed: Seed = 0,
    overrides: Overrides = None,
    allow_external: AllowExternal = None,
) -> None:
    """Render the images and loads that the model predicts."""
    with outcome():
        from idic.virtual_tests.simulate import simulate as simulate_experiment

        written = simulate_experiment(experiment, out, read_overrides(overrides), bits, noise_gv, seed)
        typer.echo(f"{written} written; now: idic identify {out} --out RUN")


@app.command()
def identify(
    experiments: Annotated[
        list[Path], typer.Argument(metavar="EXPERIMENT...", help="Experiment folders; several share their materials.")
    ],
    out: Annotated[Path, typer.Option(help="RUN folder for everything that comes out.")],
    resume: Annotated[bool, typer.Option("--resume", help="Go on with an interrupted RUN.")] = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
    memory_limit: MemoryLimit = None,
    sensitivity: SensitivityOption = Sensitivity.auto,
    method: Annotated[
        Method | None, typer.Option(help="Compare images, or the motion that a free FE-DIC measures first.")
    ] = None,
    overrides: Overrides = None,
    allow_external: AllowExternal = None,
) -> None:
    """Identify parameters from images and forces."""
    with outcome(run=out, resume=True):
        if method is not None:
            overrides = [*(overrides or ()), f"options.method={method.value.replace('-', '_')}"]
        result = _identify(experiments, out, resume, workers, scheduler, sensitivity, overrides, memory_limit)
        _show_result(result, out)
        raise typer.Exit(exit_code(result["status"]))


@app.command()
def study(
    name: Annotated[str, typer.Argument(help="bulge | convergence | coverage | polycarbonate | two-step", show_default=False)],
    out: Annotated[Path, typer.Option(help="Folder for study.zarr, study.html, figures.")],
    reduced: Annotated[bool, typer.Option("--reduced", help="Small images and meshes throughout: minutes.")] = False,
    only: Annotated[
        list[str] | None, typer.Option(help="Only this group of cases, or this case. May be repeated.")
    ] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    memory_limit: MemoryLimit = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with an earlier study in the folder.")] = False,
) -> None:
    """Study the method on virtual tests with known truth: a published bulge test; whether the error bars hold."""
    with outcome(run=out, resume=True):
        from rich.console import Console

        from idic.cli.progress import progress_view
        from idic.workers.prefect_server import start_server

        with start_server(), progress_view(Console(stderr=True, soft_wrap=True), out) as view:
            from idic_flows.study import StudyConsole, run_study

            callbacks = StudyConsole(view.stage, view.tasks, view.said, view.dashboards)
            page = run_study(name, out, "reduced" if reduced else "full", only, workers, scheduler, resume, callbacks,
                             memory_limit)
        typer.echo(f"{page} written")


@app.command()
def report(run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder written by idic identify.")]) -> None:
    """Write the HTML report and the tables of a run."""
    with outcome(run=run):
        from idic.run.reporting.write import write_report

        typer.echo(f"{write_report(run)} written")


@app.command()
def laws(
    law: Annotated[str | None, typer.Argument(help="Only this one.", show_default=False)] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw LAW at a material point into this file.")] = None,
) -> None:
    """List the constitutive laws and their parameters."""
    with outcome():
        from idic.cli.tables import laws_table
        from idic.materials import all_laws, get_law

        if plot is not None:
            if law is None:
                raise InputError("a plot needs a law", key="--plot", expected="idic laws LAW --plot FILE",
                                 remedy="name one of the laws that `idic laws` lists")  # fmt: skip
            from idic.report.figures.law_curve import plot_law

            plot_law(law, plot)
            typer.echo(f"{plot} written")
            return
        shown = [get_law(name) for name in ([law] if law else all_laws())]
        _wide_console().print(laws_table(shown))
        typer.echo(f"law      {shown[0].reference}" if law else "`idic laws LAW` gives the equation and its source")


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder to write into.")] = Path("idic-demo"),
    workers: Workers = None,
    scheduler: Scheduler = None,
) -> None:
    """The whole main job on a small built-in experiment."""
    run = out / "run"
    with outcome(run=run):
        from idic.workers.prefect_server import start_server

        _clear_earlier_demo(out)
        typer.echo(f"writing a virtual tensile test with known parameters to {out / 'experiment'}")
        with start_server():  # now: it starts while the images are rendered
            from idic.virtual_tests.examples import write_example

            write_example("demo", out / "experiment")
            result = _identify([out / "experiment"], run, False, workers, scheduler, Sensitivity.auto, None)
        _show_result(result, run, out / "experiment" / "truth.json")
        raise typer.Exit(exit_code(result["status"]))


# helpers ------------------------------------------------------------------------------------------
def read_overrides(pairs: list[str] | None) -> dict[str, str]:
    """``["a.b=1", ...]`` as a mapping; the value is read later, as TOML where it can be."""
    overrides = {}
    for pair in pairs or ():
        key, equals, value = pair.partition("=")
        if not equals or not key.strip():
            raise InputError("not a setting", key="--set", expected="key=value", found=pair)
        overrides[key.strip()] = value.strip()
    return overrides


def exit_code(status: str) -> int:
    """The exit code that belongs to the status of a result."""
    return {"converged": DONE, "interrupted": INTERRUPTED}.get(status, NOT_CONVERGED)


def _identify(experiments, out: Path, resume, workers, scheduler, sensitivity, overrides, memory_limit=None) -> dict:
    from rich.console import Console

    from idic.cli.progress import progress_view
    from idic.workers.prefect_server import start_server

    settings = read_overrides(overrides)
    with start_server(), progress_view(Console(stderr=True, soft_wrap=True), out) as view:  # it starts while we import
        from idic_flows.identify import Console as Callbacks
        from idic_flows.identify import run_identification
        from idic.run.warm_up import import_meanwhile

        callbacks = Callbacks(view.stage, view.tasks, view.iteration, view.dashboards, view.said)
        import_meanwhile("idic.run.reporting.write")
        return run_identification(experiments, out, resume=resume, workers=workers, scheduler=scheduler,
                                  sensitivity=sensitivity.value, overrides=settings, console=callbacks,
                                  memory_limit=memory_limit)  # fmt: skip


def _show_result(result: dict, run: Path, truth_file: Path | None = None) -> None:
    import json

    from rich.console import Console

    from idic.cli.tables import remarks, result_table, summary_line
    from idic.run.reporting.write import write_report

    truth = json.loads(truth_file.read_text(encoding="utf-8")) if truth_file is not None else None
    console = Console(soft_wrap=True)
    console.print(summary_line(result), highlight=False)
    console.print(result_table(result, truth))
    for text in remarks(result):
        console.print(text, highlight=False)
    page = write_report(run)
    console.print(f"results  {run / 'result.json'}\nreport   {page}", highlight=False)


def _wide_console():
    """A console that does not break the lines of a table where nobody watches: a pipe or a file."""
    from rich.console import Console

    console = Console()
    return console if console.is_terminal else Console(width=140)


def _clear_earlier_demo(out: Path) -> None:
    """Remove what an earlier `idic demo` wrote, and nothing else."""
    import shutil

    if (out / "experiment" / "truth.json").is_file():
        shutil.rmtree(out / "experiment")
    if (out / "run" / "run.zarr").is_dir():
        shutil.rmtree(out / "run")
