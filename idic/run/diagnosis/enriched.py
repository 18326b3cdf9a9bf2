"""The enriched model as a separate experiment folder: `idic identify RUN/enriched` runs it.

Data are not copied: the folder links to the files of the original experiment.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from pathlib import Path

from idic.experiment_file import EXPERIMENT_FILE, to_toml, validated, with_overrides
from idic.inside import folder_inside, remove_inside, write_inside
from idic.model import Experiment, knot_name, without_knot
from idic.run.diagnosis.source import Source
from idic.run.store.layout import ENRICHED

FOLDER = ENRICHED


def write_enriched(source: Source, experiment: Experiment, values: Mapping[str, float], named: tuple[str, ...]) -> Path:
    """Write ``RUN/enriched/experiment.toml`` with the parameters' values as starting values.

    Parameters
    ----------
    experiment : of `source`, with its edits
    values : parameters in internal units
    named : what was added, for the title

    Returns
    -------
    Path
        The file.
    """
    model = experiment.model
    folder = Path(source.run) / FOLDER
    remove_inside(source.run, FOLDER)
    folder_inside(source.run, FOLDER)
    start_values = {name: value / model.parameters[name].factor for name, value in values.items()
                    if name in model.parameters and model.parameters[name].free}
    document = source.document()
    document = with_overrides(document,
                              {name: value for name, value in start_values.items() if _in_file(document, name)})
    _start_heterogeneities(document, start_values)
    _start_cracks(document, start_values)
    _without_suspects(document)
    _start_corrections(document, start_values)
    document["experiment"]["title"] = f"{experiment.title}, with {' and '.join(n.replace('_', ' ') for n in named)}"
    file = folder / EXPERIMENT_FILE
    validated(document, file)
    write_inside(folder, EXPERIMENT_FILE, to_toml(document))
    _link_files(Path(experiment.folder), folder, Path(source.run))
    return file


def _in_file(document: Mapping, name: str) -> bool:
    """Whether a start value of this parameter has a place in the file."""
    head, _, tail = name.rpartition(".")
    if any(entry.get("name") == name for entry in document.get("dof", [])):
        return True
    return tail in document.get("material", {}).get(head, {})


def _start_heterogeneities(document: Mapping, start_values: Mapping[str, float]) -> None:
    """Write values into the entries of [[heterogeneity]]; start_values : in the units of the file."""
    for table in document.get("heterogeneity", ()):
        head = f"{table['set']}.{table.get('name', table['form'])}"
        for key in ("stiffness", "thickness", "radius_mm", "along_x", "along_y", "along_z", "stiffness_ratio",
                    "period_mm", "direction_deg", "offset_mm", "share"):
            name = f"{head}.{key.removesuffix('_mm').removesuffix('_deg')}"
            if name in start_values:
                entry = table.get(key, {"identify": True})  # a stiffness that is not there is free
                table[key] = (entry if isinstance(entry, dict) else {}) | {"value": start_values[name]}
        if table.get("centre_mm"):
            table["centre_mm"] = [start_values.get(f"{head}.{axis}", float(x))
                                  for axis, x in zip("xyz", table["centre_mm"], strict=False)]


def _start_cracks(document: Mapping, start_values: Mapping[str, float]) -> None:
    """Write values into the entries of [[crack]]; start_values : in the units of the file."""
    for table in document.get("crack", ()):
        stem = f"crack.{table['name']}.length"
        if stem in start_values:
            entry = table["length_mm"]
            table["length_mm"] = (entry if isinstance(entry, dict) else {}) | {"value": start_values[stem]}
        lengths = [start_values.get(knot_name(stem, frame)) for frame in table.get("knots", ())]
        if lengths and None not in lengths:
            table["lengths_mm"] = lengths


def _without_suspects(document: dict) -> None:
    """Leave out a suspected crack that no candidate has given a length: a crack of no length is none."""
    nothing = {"value": 0.0, "identify": False}
    tables = [table for table in document.get("crack", ()) if table["length_mm"] != nothing]
    document.pop("crack", None)
    if tables:
        document["crack"] = tables


def _start_corrections(document: dict, start_values: Mapping[str, float]) -> None:
    """Write amplitudes of corrections as [[dof]], where their values stand."""
    entries = document.get("dof", [])
    names = {entry.get("name") for entry in entries}
    for table in document.get("boundary", ()):
        for component in "xyz":
            drive = table.get(f"u{component}")
            for entry in drive.get("corrections", ()) if isinstance(drive, Mapping) else ():
                stem = f"boundary.{table['nodes']}.{component}.{entry['kind']}"
                entries = [*entries, *({"name": name, "value": value} for name, value in start_values.items()
                                       if without_knot(name) == stem and name not in names)]
    if entries:
        document["dof"] = entries


def _link_files(original: Path, folder: Path, run: Path) -> None:
    """Every other file of the folder of experiment.toml, by relative links (copies where links are not possible)."""
    for entry in sorted(original.iterdir()):
        around_run = (run.resolve(), *run.resolve().parents)
        if entry.name == EXPERIMENT_FILE or entry.name.startswith(".") or entry.resolve() in around_run:
            continue
        target = folder / entry.name
        try:
            target.symlink_to(way_to(entry.resolve(), folder.resolve()), target_is_directory=entry.is_dir())
        except OSError:  # no links on this file system
            (shutil.copytree if entry.is_dir() else shutil.copy2)(entry, target)


def way_to(path: Path, folder: Path, system=os.path) -> str:
    """The relative path from a folder; the whole path where there is none, as to another drive of Windows."""
    try:
        return system.relpath(path, folder)
    except ValueError:
        return str(path)
