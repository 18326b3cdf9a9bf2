"""The page of a batch: status of every run, scatter of the identified parameters, links to the reports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from idic.model import is_mode
from idic.report.design.page import short
from idic.report.figures.picture import CYCLE, Colour, Picture
from idic.report.figures.style import look, new_figure, to_picture
from idic.report.html import filled_in
from idic.report.result.words import number_text, short_names, with_std
from idic.report.several_runs.batch_numbers import in_one_unit

MAX_PANELS = 12  # parameters that the figure shows; the tables have all
SUBPLOTS_PER_ROW = 3
MAX_LABELLED_RUNS = 12  # runs whose names fit below a panel


def batch_headline(content: Mapping) -> str:
    """How many runs converged, and the status of the others, in one sentence."""
    rows = content["runs"]
    counts: dict[str, int] = {}
    for row in rows:
        if row["status"] != "converged":
            counts[row["status"]] = counts.get(row["status"], 0) + 1
    text = f"{content['converged']} of {len(rows)} runs converged"
    if counts:
        text += "; " + ", ".join(f"{n} {status.replace('_', ' ')}" for status, n in counts.items())
    return text + "."


def batch_parameters(content: Mapping) -> list[str]:
    """Free parameters of the runs, modes of boundaries left out."""
    names = dict.fromkeys(name for row in content["runs"] for name in row["parameters"])
    return [name for name in names if not is_mode(name)]


def draw_batch(content: Mapping) -> Picture | None:
    """Value ± standard deviation of every parameter in every run that has one; None where there is nothing to draw."""
    names = [name for name in batch_parameters(content) if _points(content["runs"], name)][:MAX_PANELS]
    if not names or len(content["runs"]) < 2:
        return None
    experiments = list(dict.fromkeys(row["experiment"] for row in content["runs"]))
    columns = min(SUBPLOTS_PER_ROW, len(names))
    rows = -(-len(names) // columns)
    with look():
        figure = new_figure(3.3 * columns, 2.4 * rows + (0.5 if len(content["runs"]) <= MAX_LABELLED_RUNS else 0.0))
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for axis in axes[len(names):]:
            axis.set_visible(False)
        for axis, name in zip(axes, names, strict=False):
            _panel(axis, content["runs"], name, experiments)
        return to_picture(figure, "scatter", "Parameters of all runs",
                      "Bars are one standard deviation. Filled: converged; hollow: not. Dashed: the "
                      "mean of the converged runs; small grey crosses: the starts. Starts and runs that did not "
                      "converge are shown where they lie within the panel. One colour per experiment.")


def _points(rows: Sequence[Mapping], name: str) -> list[tuple[int, Mapping, Mapping]]:
    """(place, run, entry) of the runs in which a parameter was determined, all in one unit."""
    return [(i, row, entry) for i, (row, entry) in enumerate(zip(rows, in_one_unit(rows, name), strict=True))
            if entry is not None and entry["std"] is not None]


def _panel(axis, rows: Sequence[Mapping], name: str, experiments: Sequence[str]) -> None:
    points = _points(rows, name)
    for i, row, entry in points:
        colour, is_converged = CYCLE[experiments.index(row["experiment"]) % len(CYCLE)], row["status"] == "converged"
        axis.errorbar(i, entry["value"], entry["std"], color=colour, marker="o",
                      mfc=colour if is_converged else "white", capsize=2, linewidth=0.9, markersize=3.5)
    converged = [entry["value"] for _, row, entry in points if row["status"] == "converged"]
    if converged:
        axis.axhline(float(np.mean(converged)), color=Colour.GREY, linestyle="--", linewidth=0.8, zorder=0)
    low, high = _limits(points) or axis.get_ylim()
    axis.plot([i for i, _, _ in points], [entry["start"] for _, _, entry in points], "x", color=Colour.GREY,
              markersize=3, linestyle="none", zorder=0)
    axis.set_ylim(low, high)
    axis.set_xlim(-0.6, len(rows) - 0.4)
    unit = points[0][2].get("unit")
    axis.set_title(f"{name}" + (f" ({unit})" if unit else ""))
    if len(rows) <= MAX_LABELLED_RUNS:
        axis.set_xticks(range(len(rows)), [row["name"] for row in rows], rotation=45, ha="right")
    else:
        axis.set_xlabel("run, in the order of the table")


def _limits(points) -> tuple[float, float] | None:
    """Limits of the axis from the converged runs and their bars, so that a run that ended far off does not hide their
    scatter."""
    converged = [entry for _, row, entry in points if row["status"] == "converged"]
    if not converged:
        return None
    low, high = (f(e["value"] + s * e["std"] for e in converged) for f, s in ((min, -1.0), (max, 1.0)))
    room = 0.15 * (high - low) or 0.01 * abs(high) or 1.0
    return low - room, high + room


def render_batch(content: Mapping) -> str:
    """The HTML text; the reports of the runs are linked, everything else is in the page."""
    names = batch_parameters(content)
    short_name = short_names(names)
    return filled_in(
        "batch.html.j2", first=batch_headline(content), finished=content["status"] == "finished",
        names=[short_name[n] for n in names],
        rows=[_row(row, names) for row in content["runs"]],
        groups=[_group(g, names, short_name) for g in content["groups"]],
        picture=draw_batch(content))


def _row(row: Mapping, names: Sequence[str]) -> dict:
    entries = [row["parameters"].get(name) for name in names]
    first = row["reason"].strip().splitlines()
    return {"name": row["name"], "status": row["status"].replace("_", " "), "good": row["status"] == "converged",
            "report": f"{row['run']}/report.html" if row["iterations"] is not None else None,
            "reason": first[0] if first else "", "details": "\n".join(first[1:]),
            "iterations": "–" if row["iterations"] is None else str(row["iterations"]),
            "chi2": "–" if row["image_chi2_dof"] is None else f"{row['image_chi2_dof']:.3f}",
            "wall": "–" if row["wall_s"] is None else f"{row['wall_s']:.0f}",
            "cells": ["–" if e is None else "not determined" if e["std"] is None
                      else with_std(e["value"], e["std"], e.get("unit") or "") for e in entries]}


def _group(group: Mapping, names: Sequence[str], short_name: Mapping[str, str]) -> dict:
    rows = []
    for name in names:
        if name in group["parameters"]:
            entry = group["parameters"][name]
            ratio = entry["std"] / entry["formal_std"] if entry["formal_std"] else float("inf")
            rows.append({"name": short_name[name], "unit": entry["unit"] or "–", "n": entry["n"],
                         "mean": number_text(entry["mean"], entry["std"]), "std": short(entry["std"]),
                         "formal": short(entry["formal_std"]), "ratio": f"{ratio:.2g}",
                         "range": f"{number_text(entry['min'], entry['std'])} … "
                                  f"{number_text(entry['max'], entry['std'])}"})
    return {"title": group["experiment"] or "all experiments", "runs": group["runs"], "rows": rows}
