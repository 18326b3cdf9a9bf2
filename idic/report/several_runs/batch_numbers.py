"""The numbers of a batch: scatter of repeated identifications, and a CSV with one row per run."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence

import numpy as np

from idic.readers import factor_to


def scatter(rows: Sequence[Mapping]) -> list[dict]:
    """How the converged runs of one experiment, and of all, spread: number, mean, std between runs, mean formal std.

    Runs of all experiments together come first, under the experiment None, where there are several experiments.
    """
    converged = [row for row in rows if row["status"] == "converged"]
    experiments = list(dict.fromkeys(row["experiment"] for row in converged))
    chosen = [None, *experiments] if len(experiments) > 1 else experiments
    groups = []
    for experiment in chosen:
        members = [row for row in converged if experiment in (None, row["experiment"])]
        if len(members) > 1:
            groups.append({"experiment": experiment, "runs": len(members), "parameters": _spreads(members)})
    return groups


def _spreads(rows: Sequence[Mapping]) -> dict[str, dict]:
    spreads = {}
    for name in dict.fromkeys(name for row in rows for name in row["parameters"]):
        entries = [entry for entry in in_one_unit(rows, name) if entry is not None and entry["std"] is not None]
        if len(entries) < 2:
            continue
        values = np.array([entry["value"] for entry in entries])
        spreads[name] = {"n": len(values), "mean": float(values.mean()), "std": float(values.std(ddof=1)),
                       "min": float(values.min()), "max": float(values.max()),
                       "formal_std": float(np.mean([entry["std"] for entry in entries])), "unit": entries[0]["unit"]}
    return spreads


def in_one_unit(rows: Sequence[Mapping], name: str) -> list[Mapping | None]:
    """The entry of a parameter in every run, in the unit of the first that has it; None where a run has none, or one of
    another dimension (px and mm)."""
    unit = next((row["parameters"][name].get("unit") or "" for row in rows if name in row["parameters"]), "")
    return [_in_unit(row["parameters"][name], unit) if name in row["parameters"] else None for row in rows]


def _in_unit(entry: Mapping, unit: str) -> Mapping | None:
    factor = factor_to(unit, entry.get("unit") or "")
    if factor is None:
        return None
    return {**entry, "unit": unit, **{key: factor * entry[key] for key in ("value", "std", "start")
                                      if entry.get(key) is not None}}


def batch_table(content: Mapping) -> str:
    """CSV: a row per run; value, ``.std`` and ``.start`` of every parameter that is free in any of them, and its
    ``.unit`` in the experiment of the run."""
    plain = ("name", "experiment", "status", "reason", "iterations", "image_chi2_dof", "wall_s")
    names = list(dict.fromkeys(name for row in content["runs"] for name in row["parameters"]))
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow((*plain, *(f"{name}{tail}" for name in names for tail in ("", ".std", ".start", ".unit"))))
    for row in content["runs"]:
        entries = [row["parameters"].get(name, {}) for name in names]
        cells = [row[key] for key in plain] + [e.get(key) for e in entries for key in ("value", "std", "start", "unit")]
        writer.writerow(["" if cell is None else " ".join(cell.split()) if isinstance(cell, str) else f"{cell:.10g}"
                         for cell in cells])  # fmt: skip
    return buffer.getvalue()
