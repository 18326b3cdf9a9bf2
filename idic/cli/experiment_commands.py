"""Commands on an experiment before its identification: `init`, `check`, `design`, `simulate`, `example`, `laws`."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from idic.cli.app import (AllowExternal, Bits, Experiment, Overrides, Seed, Workers, app, read_overrides, terminal,
                          wide_console)
from idic.cli.command import user_path
from idic.cli.outcomes import outcome
from idic.errors import InputError
from idic.inside import folder_inside, write_inside


@app.command()
def init(
    folder: Annotated[Path,
                      typer.Argument(metavar="FOLDER", help="Folder with images or scans, mesh and log if "
                                                             "there are; or a folder of each specimen.")],
) -> None:
    """Write a commented experiment.toml for a folder of images."""
    with outcome():
        from idic.draw import speckled_area, texture_of
        from idic.experiment_file import initial_experiment

        written, lines = initial_experiment(folder, lambda image: speckled_area(image, texture_of(image)))
        for line in lines:
            typer.echo(line)
        for file in sorted(written.glob("*/experiment.toml")) if written.is_dir() else [written]:
            for line in _first_look(file):
                typer.echo(line)
            typer.echo(f"{user_path(file)} written; complete the lines marked FILL IN, then run: idic check "
                       f"{shlex.quote(user_path(file.parent))}")


def _first_look(written: Path) -> list[str]:
    """The warnings of `idic check`, and of volumes its picture, where the file can be loaded before anything is filled
    in."""
    from idic.experiment_file import load_experiment
    from idic.report import check as check_experiment

    try:
        loaded = load_experiment(written)
        has_picture = loaded.recording.quantity == "volume"
        inspection = check_experiment(loaded, draw=has_picture)
        lines = [f"warning      {text}" for text in inspection.warnings]
        if has_picture:
            folder = folder_inside(loaded.folder, "check")
            lines.append(f"picture      {user_path(write_inside(folder, 'mesh.png', inspection.overlay.png))}")
        return lines
    except InputError:
        return []  # its lines marked FILL IN are needed


@app.command()
def check(
    experiment: Experiment,
    out: Annotated[Path | None, typer.Option(
        metavar="FILE", help="Picture of the mesh on the image [default: EXPERIMENT/check/mesh.png]")] = None,
    picture: Annotated[bool, typer.Option(help="--no-picture: no drawing, nothing is written.")] = True,
    overrides: Overrides = None,
) -> None:
    """Read and validate everything, draw the mesh on the image."""
    with outcome():
        from idic.experiment_file import load_experiment
        from idic.report import check as check_experiment

        loaded = load_experiment(experiment, read_overrides(overrides))
        inspection = check_experiment(loaded, draw=picture)
        for line in inspection.lines():
            typer.echo(line)
        if not picture:
            return
        main = out or Path(loaded.folder) / "check" / "mesh.png"
        try:
            folder_inside(*((main.parent,) if out else (loaded.folder, main.parent.name)))
        except (OSError, InputError) as problem:  # a read-only experiment folder is no fault of the experiment
            if out is not None:
                raise
            reason = problem.strerror if isinstance(problem, OSError) else problem.found
            typer.echo(f"picture      not written ({user_path(main.parent)}: {reason}); --out FILE: another place")
            return
        for camera in (inspection, *inspection.cameras):
            name = main.name if camera is inspection else f"{main.stem}_{camera.name}{main.suffix}"
            path = write_inside(main.parent, name, camera.overlay.png)
            typer.echo(f"picture      {user_path(path)}")


@app.command()
def design(
    experiments: Annotated[list[Path], typer.Argument(
        metavar="EXPERIMENT...", help="Planned tests: experiment folders with a table [design], or finished tests.")],
    out: Annotated[Path, typer.Option(help="Folder for design.html, design.json, design.csv.")] = Path("idic-design"),
    noise_gv: Annotated[float | None, typer.Option(
        min=0, metavar="GV", help="Image noise in grey values [default: that of the experiment]")] = None,
    confusable: Annotated[float, typer.Option(
        help="Correlation coefficient above which two parameters count as hard to separate.")] = 0.95,
    separate: Annotated[Path | None, typer.Option(
        metavar="RUN", help="A diagnosed run: rank the plans by how well they tell its candidates apart.")] = None,
    workers: Workers = None,
    overrides: Overrides = None,
    allow_external: AllowExternal = None,
) -> None:
    """Predict the error bars of a test before it is made. Compares plans."""
    with outcome():
        from idic.cli.progress import progress_view
        from idic.cli.tables import show
        from idic.report import design_lines
        from idic.run import PAGE_FILE, write_design

        stages = ("simulations and sensitivities",
                  *(["candidates in the plans, and the search for the best course"] if separate else []),
                  "figures and page")
        with progress_view(terminal(stderr=True), out, stages) as view:
            content = write_design(experiments, out, read_overrides(overrides), noise_gv, confusable, workers,
                                   view.stage,
                                   lambda count, total: view.tasks("plans", count, total), separate)
        show(wide_console(), design_lines(content))
        typer.echo(f"page     {user_path(out / PAGE_FILE)}")


@app.command()
def example(
    name: Annotated[str,
                    typer.Argument(metavar="NAME", help="demo | stereo | volume; with the studies also bulge | "
                                   "polycarbonate | polycarbonate-plans | volume-calculix", show_default=False)],
    out: Annotated[Path, typer.Option(help="New or empty folder for the experiment.")],
    reduced: Annotated[bool, typer.Option("--reduced", help="Smaller images and mesh.")] = False,
    noise: Annotated[float | None, typer.Option(
        metavar="RATIO", help="Standard deviation of the noise over that of the pattern.")] = None,
    bits: Bits = 8,
    seed: Seed = 0,
    foreign: Annotated[bool, typer.Option(
        "--foreign", help="bulge, polycarbonate: the truth is simulated on a finer mesh than the model's.")] = False,
) -> None:
    """Write an experiment folder with known truth."""
    with outcome():
        from idic.virtual_tests import write_example

        written = write_example(name, out, reduced, noise, bits, seed, foreign)
        command = f"design {user_path(out)}/* --out DIR" if written.is_dir() else f"identify {user_path(out)} --out RUN"
        typer.echo(f"{user_path(written)} written; now: idic {command}")


@app.command()
def simulate(
    experiment: Experiment,
    out: Annotated[Path, typer.Option(help="New or empty folder for the virtual experiment.")],
    noise_gv: Annotated[float | None, typer.Option(
        min=0, metavar="GV", help="Noise in grey values [default: that of the experiment]")] = None,
    bits: Bits = 8,
    seed: Seed = 0,
    overrides: Overrides = None,
    allow_external: AllowExternal = None,
) -> None:
    """Render the images and loads that the model predicts."""
    with outcome():
        from idic.virtual_tests import simulate as simulate_experiment

        written = simulate_experiment(experiment, out, read_overrides(overrides), bits, noise_gv, seed)
        typer.echo(f"{user_path(written)} written; now: idic identify {user_path(out)} --out RUN")


@app.command()
def laws(
    law: Annotated[str | None, typer.Argument(metavar="[LAW]", help="Only this law, with its equation.",
                                                 show_default=False)] = None,
    plot: Annotated[Path | None, typer.Option(
        metavar="FILE", help="Draws the stress-strain curve of LAW and its sensitivities.")] = None,
    export: Annotated[Path | None, typer.Option(
        metavar="RUN",
        help="Writes the laws that RUN has identified: a table for experiment.toml, and material cards of "
                            "Abaqus and CalculiX.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder of --export [default: laws in RUN].")] = None,
) -> None:
    """List the constitutive laws and their parameters, or export identified ones."""
    with outcome():
        from idic.cli.tables import laws_table
        from idic.laws import all_laws, get_law

        if export is not None:
            from idic.run import export_laws

            for written in export_laws(export, out or export / "laws"):
                typer.echo("\n".join(f"{user_path(file)} written" for file in written.files))
                for program, missing in written.missing.items():
                    typer.echo("".join(f"{program}: NOT IN THE CARD: {term}\n" for term in missing), nl=False, err=True)
            return
        if plot is not None:
            if law is None:
                raise InputError("a plot needs a law", key="--plot", expected="idic laws LAW --plot FILE",
                                 remedy="name one of the laws that `idic laws` lists")  # fmt: skip
            from idic.report import plot_law

            plot_law(law, plot)
            typer.echo(f"{user_path(plot)} written")
            return
        specs = [get_law(name) for name in ([law] if law else all_laws())]
        wide_console().print(laws_table(specs))
        typer.echo(f"law      {specs[0].reference}" if law else "`idic laws LAW` gives the equation and its source")
