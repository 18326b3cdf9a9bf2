"""Several finished runs side by side: ``compare.json``, ``compare.csv`` and a page.

Keys of ``compare.json`` (schema ``idic.compare/1``): ``runs`` (name, folder, quantity that was measured, status,
models, n_free, fit, parameters)
and ``parameters``: per name the unit, the value of every run in it and the difference to that of the first run in
standard deviations of the difference; a value whose unit has another dimension keeps its own and has no difference.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from idic.errors import InputError
from idic.inside import folder_inside, write_inside
from idic.model import is_mode
from idic.readers import factor_to
from idic.report import comparison_page
from idic.run.prepared.context import open_run
from idic.run.store.result_file import read_result, write_json
from idic.run.store.run_folders import folders_of

SCHEMA = "idic.compare/1"
IN_UNIT = ("value", "std", "systematic_std", "start")  # of a parameter
JSON_FILE, CSV_FILE, PAGE_FILE = "compare.json", "compare.csv", "compare.html"


def compare_runs(runs: Sequence[str | Path]) -> dict:
    """The content of ``compare.json``.

    Raises
    ------
    InputError
        Fewer than two runs, or a folder without a result.
    """
    if len(runs) < 2:
        raise InputError("nothing to compare", expected="two RUN folders or more", found=str(len(runs)),
                         remedy="idic compare RUN RUN ...")
    records = [_run_record(Path(run), name) for run, name in zip(runs, run_names(runs), strict=True)]
    for record in records:
        record["same_data"] = record["data"] is not None and record["data"] == records[0]["data"]
    names = dict.fromkeys(name for record in records for name in record["parameters"] if not is_mode(name))
    parameters = [_parameter(name, [record["parameters"].get(name) for record in records]) for name in names]
    return {"schema": SCHEMA, "runs": records,
            "parameters": [entry for entry in parameters if _worth_showing(entry["values"])]}


def write_comparison(content: Mapping, out: str | Path) -> Path:
    """Write ``compare.json``, ``compare.csv`` and ``compare.html`` into a folder; returns the page."""
    folder = folder_inside(out)
    write_json(folder / JSON_FILE, dict(content))
    write_inside(folder, CSV_FILE, _csv(content))
    return write_inside(folder, PAGE_FILE, comparison_page(content))


def run_names(runs: Sequence[str | Path]) -> list[str]:
    """Names of the runs: their folders, with as much of the path in front as tells them apart."""
    paths = [Path(run).resolve() for run in runs]
    for depth in range(1, max(len(path.parts) for path in paths) + 1):
        names = ["/".join(path.parts[-depth:]) for path in paths]
        if len(set(names)) == len(names):
            return names
    return [f"{k + 1}: {path.name}" for k, path in enumerate(paths)]


def _run_record(run: Path, name: str) -> dict:
    result = read_result(run)
    models, data = _models_and_data(run)
    residual = result["residual"]
    return {
        "name": name, "folder": os.fspath(run), "title": result.get("title", ""), "status": result["status"],
        "quantity": result.get("quantity", "grey"), "models": models, "data": data,
        "method": result.get("method", "integrated"),
        "n_free": sum(1 for p in result["parameters"].values() if p["free"]),
        "image_chi2_dof": residual.get("image_chi2_dof"), "image_rms": residual.get("image_rms_gv"),
        "image_unit": {"grey values": "GV"}.get(result["noise"].get("unit"), result["noise"].get("unit") or "GV"),
        "channel_chi2_dof": residual.get("channel_chi2_dof", {}), "iterations": result["iterations"],
        "wall_s": result["cost"].get("wall_s"),
        "parameters": {key: {k: entry.get(k) for k in ("value", "std", "systematic_std", "unit", "start", "free")}
                       for key, entry in result["parameters"].items()},
        "derived": result.get("derived", {}),
    }


def _models_and_data(run: Path) -> tuple[dict[str, str], list | None]:
    """Law per element set, and the differences of the recordings; None where an experiment is no longer there."""
    models: dict[str, str] = {}
    data: list | None = []
    for folder in folders_of(run).values():
        try:
            experiment = open_run(str(folder)).experiment
        except (InputError, OSError):
            data = None
            continue
        models |= {m.element_set: m.law for m in experiment.model.materials}
        if data is not None:
            data += [experiment.folder, list(experiment.recording.labels), list(experiment.recording.excluded)]
    return models, data


def _parameter(name: str, entries: Sequence[Mapping | None]) -> dict:
    """One row: the value in every run, and by how many standard deviations it differs from that of the first."""
    unit = next((entry["unit"] for entry in entries if entry is not None), "")
    values = [None if entry is None else _in_unit(entry, unit) for entry in entries]
    first, differences = values[0], []
    for entry in values:
        sizes = [side["std"] or 0.0 for side in (first, entry) if side is not None]
        std = sum(size**2 for size in sizes) ** 0.5
        comparable = first is not None and entry is not None and std > 0.0 and all(
            side["unit"] == unit and (side["std"] is not None or not side["free"]) for side in (first, entry))
        differences.append((entry["value"] - first["value"]) / std if comparable else None)
    return {"name": name, "unit": unit, "values": values, "differences": differences}


def _in_unit(entry: Mapping, unit: str) -> dict:
    """A parameter of a run in the unit of another one, as it is where the unit has another dimension."""
    factor = factor_to(unit, entry["unit"])
    if factor is None:
        return dict(entry)
    return dict(entry) | {key: factor * entry[key] for key in IN_UNIT if entry.get(key) is not None} | {"unit": unit}


def _worth_showing(entries: Sequence[Mapping | None]) -> bool:
    """Identified somewhere, or given differently."""
    statements = {None if entry is None else (f"{entry['value']:.12g}", entry["unit"]) for entry in entries}
    return any(entry is not None and entry["free"] for entry in entries) or len(statements - {None}) > 1


def _csv(content: Mapping) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = [run["name"] for run in content["runs"]]
    writer.writerow(["parameter", "unit",
                     *(f"{name} {column}" for name in names for column in ("value", "std", "steps"))])
    for entry in content["parameters"]:
        row = [entry["name"], entry["unit"]]
        for value, step in zip(entry["values"], entry["differences"], strict=True):
            is_open = value is None or value["unit"] != entry["unit"]
            row += ["", "", ""] if is_open else [value["value"], value["std"], step]
        writer.writerow(["" if cell is None else cell for cell in row])
    return text.getvalue()
