"""`idic batch`: many identifications at once, and their table."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from idic.cli.app import (MemoryLimit, Overrides, RefusedStore, Scheduler, Sensitivity, SensitivityOption, UsePrefect,
                          Workers, app, is_watched, orchestrator_of, read_overrides, terminal, wide_console)
from idic.cli.command import user_path
from idic.cli.outcomes import DONE, NOT_CONVERGED, outcome

STAGES = ("identification", "summary and page")


@app.command()
def batch(
    experiments: Annotated[
        list[Path],
        typer.Argument(metavar="FILE_OR_EXPERIMENT...", help="Experiment folders, or lists of runs (.toml, .csv)."),
    ],
    out: Annotated[Path, typer.Option(help="Folder for a RUN of each, batch.html, batch.csv, batch.json.")],
    starts: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Number of random starts of every run.")
    ] = None,
    spread: Annotated[
        float, typer.Option(help="Largest relative distance of a random start, within the bounds: 0.3 is 30 %.")
    ] = 0.3,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random starts.")] = 0,
    resume: Annotated[bool, typer.Option("--resume", help="Continue an earlier batch; finished runs stay.")] = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
    memory_limit: MemoryLimit = None,
    sensitivity: SensitivityOption = Sensitivity.auto,
    prefect: UsePrefect = None,
    overrides: Overrides = None,
    store: RefusedStore = None,
) -> None:
    """Identify many experiments, or one from many starts."""
    with outcome(resume=True):
        from idic.cli.progress import progress_view
        from idic.run import Console, Workplace, identify_batch, refuse_store

        refuse_store(store, "batch")
        settings = read_overrides(overrides)
        with progress_view(terminal(stderr=True), out, STAGES) as view:
            callbacks = Console(view.stage, view.tasks, dashboards=view.dashboards, remark=view.said)
            content = identify_batch(experiments, out, starts=starts, spread=spread, seed=seed, resume=resume,
                                     overrides=settings, sensitivity=sensitivity.value, console=callbacks,
                                     workplace=Workplace(workers, scheduler, memory_limit),
                                     orchestrator=orchestrator_of(is_watched(prefect)))
        _show(content, out)
        raise typer.Exit(DONE if content["converged"] == len(content["runs"]) else NOT_CONVERGED)


def _show(content: Mapping, out: Path) -> None:
    from idic.report import batch_headline

    console = wide_console()
    console.print(batch_headline(content), highlight=False)
    console.print(batch_rows(content))
    for group in content["groups"]:
        if group["parameters"]:
            of = group["experiment"] or "all experiments"
            console.print(f"Scatter over the converged runs of {of}", highlight=False)
            console.print(scatter_rows(group["parameters"]))
    console.print(f"page     {user_path(out / 'batch.html')}\ntable    {user_path(out / 'batch.csv')}", highlight=False,
                  soft_wrap=True)


def scatter_rows(parameters: Mapping) -> Table:
    """Mean, scatter between runs and mean stated standard deviation of every parameter."""
    from idic.report import short

    table = Table(box=None, header_style="bold")
    for title in ("parameter", "mean", "std between runs", "mean stated std", "unit", "runs"):
        table.add_column(title, justify="left" if title in ("parameter", "unit") else "right")
    for name, entry in parameters.items():
        table.add_row(name, f"{entry['mean']:.6g}", short(entry["std"]), short(entry["formal_std"]), entry["unit"],
                      str(entry["n"]))
    return table


def batch_rows(content: Mapping) -> Table:
    """Status and parameters of every run."""
    from idic.report import batch_parameters, short_names, with_std

    names = batch_parameters(content)
    titles = short_names(names)
    table = Table(box=None, header_style="bold")
    for title in ("run", "status", *(titles[name] for name in names), "chi2", "s", "reason"):
        table.add_column(title, justify="left" if title in ("run", "status", "reason") else "right")
    for row in content["runs"]:
        entries = [row["parameters"].get(name) for name in names]
        cells = ["-" if e is None else "not determined" if e["std"] is None
                 else with_std(e["value"], e["std"], e.get("unit") or "") for e in entries]  # fmt: skip
        chi2, wall = row["image_chi2_dof"], row["wall_s"]
        table.add_row(row["name"], row["status"].replace("_", " "), *cells, "-" if chi2 is None else f"{chi2:.2f}",
                      "-" if wall is None else f"{wall:.0f}", (row["reason"].strip().splitlines() or [""])[0])
    return table
