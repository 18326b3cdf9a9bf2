"""`idic compare`: several finished runs side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from idic.cli.commands import _wide_console, app
from idic.cli.outcomes import outcome


@app.command()
def compare(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN RUN...", help="Folders written by idic identify.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for compare.html, compare.csv, compare.json [default: table only]")
    ] = None,
) -> None:
    """Show parameters, residuals and models of several runs side by side."""
    with outcome():
        from idic.run.reporting.compare import compare_runs, headlines, write_comparison
        from idic.report.tables_page import comparison_tables

        content = compare_runs(runs)
        console = _wide_console()
        for line in headlines(content):
            console.print(line, highlight=False)
        for table in comparison_tables(content):
            shown = Table(box=None, header_style="bold", title=table.title, title_justify="left")
            for k, name in enumerate(table.header):
                shown.add_column(name, justify="right" if k else "left")
            for row in table.rows:
                shown.add_row(*(f"[bold]{cell.text}[/bold]" if cell.far else cell.text for cell in row))
            console.print(shown)
        if out is not None:
            typer.echo(f"page     {write_comparison(content, out)}")
