"""A batch in the terminal: every run, and the scatter between them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from idic.report.design.page import short
from idic.report.result.words import short_names, with_std
from idic.report.several_runs.batch_page import batch_headline, batch_parameters
from idic.report.terminal.text_table import Line, TextTable


def batch_lines(content: Mapping) -> Iterator[Line | TextTable]:
    """Sentences and tables of batch.json."""
    yield Line(batch_headline(content))
    yield batch_rows(content)
    for group in content["groups"]:
        if group["parameters"]:
            yield Line(f"Scatter over the converged runs of {group['experiment'] or 'all experiments'}")
            yield scatter_rows(group["parameters"])


def scatter_rows(parameters: Mapping) -> TextTable:
    """Mean, scatter between runs and mean stated standard deviation of every parameter."""
    table = TextTable(("parameter", "mean", "std between runs", "mean stated std", "unit", "runs"),
                      frozenset(("parameter", "unit")))
    for name, entry in parameters.items():
        table.add_row(name, f"{entry['mean']:.6g}", short(entry["std"]), short(entry["formal_std"]), entry["unit"],
                      str(entry["n"]))
    return table


def batch_rows(content: Mapping) -> TextTable:
    """Status and parameters of every run."""
    names = batch_parameters(content)
    titles = short_names(names)
    table = TextTable(("run", "status", *(titles[name] for name in names), "chi2", "s", "reason"),
                      frozenset(("run", "status", "reason")))
    for row in content["runs"]:
        entries = [row["parameters"].get(name) for name in names]
        cells = ["-" if e is None else "not determined" if e["std"] is None
                 else with_std(e["value"], e["std"], e.get("unit") or "") for e in entries]
        chi2, wall = row["image_chi2_dof"], row["wall_s"]
        table.add_row(row["name"], row["status"].replace("_", " "), *cells, "-" if chi2 is None else f"{chi2:.2f}",
                      "-" if wall is None else f"{wall:.0f}", (row["reason"].strip().splitlines() or [""])[0])
    return table
