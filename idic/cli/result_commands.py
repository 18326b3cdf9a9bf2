"""Commands on finished runs: `report`, `clean`, `fields`, `compare`, `systematic`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table
from rich.text import Text

from idic.cli.app import FileStore, MemoryLimit, Run, Scheduler, Workers, app, terminal, wide_console
from idic.cli.command import user_path
from idic.cli.outcomes import outcome

REPORT_STAGES = ("tables and ParaView files", "figures", "page")
SYSTEMATIC_STAGES = ("discretisation, boundary and camera", "report")  # as they are announced


@app.command()
def report(run: Run) -> None:
    """Write the HTML report, the figures and the tables of a run again, and files for ParaView."""
    with outcome(run=run):
        from idic.cli.progress import progress_view
        from idic.run import drawing_beside

        with drawing_beside() as second:
            second.start()  # it imports while this process does
            from idic.run import write_report

            with progress_view(terminal(stderr=True), run, REPORT_STAGES) as view:
                page = write_report(run, view.stage, paraview=True, second=second)
        typer.echo(f"{user_path(page)} written")


@app.command()
def clean(
    run: Run,
    results_only: Annotated[bool, typer.Option(
        "--results-only",
        help="Also remove images, motions and state: no --resume, report or diagnosis afterwards.")] = False,
) -> None:
    """Remove what `idic report` makes again; pages, tables and results stay."""
    with outcome(run=run):
        from idic.run import clean_run

        typer.echo(f"{clean_run(run, results_only) / 1e6:.1f} MB freed; "
                   + ("pages, tables and results are kept" if results_only
                      else f"idic report {user_path(run)} makes figures and ParaView files again"))


@app.command()
def fields(
    run: Run,
    out: Annotated[Path | None, typer.Option(help="Folder for the files [default: RUN/fields]")] = None,
    file_format: Annotated[str, typer.Option("--format", help="csv, vtu (ParaView), xdmf or zarr")] = "csv",
    strain: Annotated[str, typer.Option(help="green_lagrange, hencky or small")] = "green_lagrange",
    angle: Annotated[float,
                     typer.Option(help="Degrees by which the x axis of components is turned counter-clockwise")] = 0.0,
) -> None:
    """Write displacement, strain, stress and state of a run as files, simulated and measured."""
    with outcome(run=run):
        from idic.run import export_fields

        written = export_fields(run, out or run / "fields", file_format, strain, angle)
        typer.echo(f"{user_path(written)} written")


@app.command()
def compare(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN RUN...", help="Folders written by idic identify.")],
    out: Annotated[Path | None, typer.Option(
        help="Folder for compare.html, compare.csv, compare.json [default: table on the screen only]")] = None,
) -> None:
    """Show parameters and residuals of several runs side by side."""
    with outcome():
        from idic.report import comparison_headlines, comparison_tables
        from idic.run import compare_runs, write_comparison

        content = compare_runs(runs)
        console = wide_console()
        for line in comparison_headlines(content):
            console.print(line, highlight=False)
        for table in comparison_tables(content):
            screen_table = Table(box=None, header_style="bold", title=table.title, title_justify="left")
            for k, name in enumerate(table.header):
                screen_table.add_column(name, justify="right" if k else "left")
            for row in table.rows:
                screen_table.add_row(*(Text(cell.text, style="bold" if cell.is_bold else "") for cell in row))
            console.print(screen_table)
        if out is not None:
            typer.echo(f"page     {user_path(write_comparison(content, out))}")


@app.command()
def systematic(
    run: Run,
    bias: Annotated[bool, typer.Option(help="Discretisation bias: one step on a finer mesh.")] = True,
    spread: Annotated[bool, typer.Option(
        help="Systematic spread: identifications with other treatments of boundary and camera.")] = True,
    workers: Workers = None,
    scheduler: Scheduler = None,
    memory_limit: MemoryLimit = None,
    store: FileStore = None,
) -> None:
    """Estimate the errors that the error bars do not count.

    Discretisation, boundary and camera. The report is written again.
    """
    with outcome(run=run):
        from idic.cli.progress import progress_view
        from idic.cli.tables import laid_out
        from idic.report import systematic_table, treatments_table
        from idic.run import Console, Workplace, systematic as assess, write_report

        with progress_view(terminal(stderr=True), run, SYSTEMATIC_STAGES) as view:
            result = assess(run, bias, spread, workplace=Workplace(workers, scheduler, memory_limit, store),
                            console=Console(view.stage, view.tasks, remark=view.said))
            view.stage("report")
            page = write_report(run)
        console = terminal()
        console.print(laid_out(systematic_table(result)))
        if spread:
            treatments = treatments_table(result)
            console.print(treatments if isinstance(treatments, str) else laid_out(treatments))
        for text in (*result["notes"], *(f"{e['name']}: {e['reason']}" for e in result["not_identifiable"])):
            console.print(text, highlight=False, markup=False)
        console.print(f"report   {user_path(page)}", highlight=False)
