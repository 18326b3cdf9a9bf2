"""Edits of experiment.toml that several candidates share: further degrees of freedom, entries of [[boundary]]."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from typing import Any

from idic.diagnose.physics.candidate import Situation
from idic.fe import OUTLINE
from idic.model import Model, without_knot


def further_dofs(situation: Situation, *names: str, **values: float) -> dict[str, Any] | None:
    """Edits that make these names free, on top of the [[dof]] that the file has; None where one is free already.

    values : start values by the last word of a name, others as the file gives them
    """
    if any(without_knot(parameter) in names for parameter in situation.experiment.model.parameters.free):
        return None
    entries = [dict(entry) for entry in situation.document.get("dof", ()) if entry.get("name") not in names]
    additions = []
    for name in names:
        word = name.rpartition(".")[2]
        additions.append({"name": name} | ({"value": values[word]} if word in values else {}))
    return {"dof": entries + additions}


def driven(situation: Situation) -> Iterator[tuple[int, str, str, Mapping[str, Any]]]:
    """Prescribed displacements of the file that may be corrected: those that are logged, and those held at a value.

    Yields
    ------
    number of the [[boundary]], node set, component ("x"), its drive as a table
    """
    for number, table in enumerate(situation.document.get("boundary", ())):
        for component in "xyz":
            drive = table.get(f"u{component}")
            if isinstance(drive, (int, float)) and not isinstance(drive, bool):
                drive = {"value": drive}
            if isinstance(drive, Mapping) and ("value" in drive or "column" in drive):
                yield number, table["nodes"], component, drive


def with_correction(situation: Situation, number: int, component: str,
                    correction: Mapping[str, Any]) -> dict[str, Any]:
    """Edits that add one entry to the corrections of a drive (`docs/experiment-file.md`, [[boundary]])."""
    tables = copy.deepcopy(list(situation.document["boundary"]))
    entry = tables[number][f"u{component}"]
    drive: dict[str, Any] = dict(entry) if isinstance(entry, Mapping) else {"value": float(entry)}
    drive["corrections"] = [*drive.get("corrections", ()), dict(correction)]
    tables[number] = dict(tables[number]) | {f"u{component}": drive}
    return {"boundary": tables}


def channel_unit(situation: Situation, column: str) -> dict[str, Any]:
    """The unit that [[channel]] gives to a column whose name has none."""
    for table in situation.document.get("channel", ()):
        if table.get("column") == column and "unit" in table:
            return {"unit": table["unit"]}
    return {}


def camera_key(situation: Situation, key: str) -> str:
    """The dotted key of an entry of the main camera's table, [camera] or the first [[camera]]."""
    return f"camera.0.{key}" if isinstance(situation.document.get("camera"), list) else f"camera.{key}"


def camera_table(situation: Situation) -> Mapping[str, Any]:
    """The table of the main camera as it is; {} where there is none."""
    tables = situation.document.get("camera", {})
    return tables[0] if isinstance(tables, list) else tables


def open_share(model: Model) -> float | None:
    """By how much the narrowest width of an outline of points may be off, of that width; None where the mesh is none,
    or its edges are identified."""
    moved = any(name.startswith(OUTLINE) for name in model.parameters.free)
    return None if moved else model.outline_share
