"""`idic systematic`: what the error bars do not know of."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from idic.cli.commands import MemoryLimit, Scheduler, Workers, app
from idic.cli.outcomes import outcome


@app.command()
def systematic(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder written by idic identify.")],
    bias: Annotated[bool, typer.Option(help="Discretisation bias: one finer mesh at the identified point.")] = True,
    spread: Annotated[bool, typer.Option(help="Spread over treatments of boundary and camera.")] = True,
    workers: Workers = None,
    scheduler: Scheduler = None,
    memory_limit: MemoryLimit = None,
) -> None:
    """Estimate discretisation bias and systematic spread of a finished run, and write its report anew."""
    with outcome(run=run):
        from rich.console import Console

        from idic.cli.systematic_tables import systematic_table, treatments_table
        from idic.workers.dask_executor import check_scheduler, checked_memory_limit, open_cluster
        from idic.run.reporting.write import write_report
        from idic.run.systematic import systematic as assess

        limit = checked_memory_limit(memory_limit, workers, scheduler)
        check_scheduler(scheduler)
        with open_cluster(workers, scheduler, limit, ("idic.run.systematic",)) as runner:
            result = assess(run, runner, bias, spread, _told(time.monotonic()))
        console = Console(soft_wrap=True)
        console.print(systematic_table(result))
        if spread:
            console.print(treatments_table(result))
        for text in (*result["notes"], *(f"{e['name']}: {e['reason']}" for e in result["not_identifiable"])):
            console.print(text, highlight=False, markup=False)
        console.print(f"report   {write_report(run)}", highlight=False)


def _told(began: float) -> Callable[[int, int], None]:
    """A line per finished assessment: each is a whole identification."""
    return lambda done, total: typer.echo(f"{time.monotonic() - began:6.1f} s  {done} of {total} assessed", err=True)
