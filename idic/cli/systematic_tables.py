"""Parameters beside what the noise does not know of."""

from __future__ import annotations

from collections.abc import Mapping

from rich.table import Table

from idic.model.mode_names import is_mode
from idic.report.treatments import treatment_table


def systematic_table(result: Mapping) -> Table:
    """Value, standard deviation, discretisation bias and systematic spread of every free parameter and every ratio."""
    table = Table("parameter", "value", "std", "discretisation bias", "systematic std", "unit")
    for name, entry in (result["parameters"] | result["derived"]).items():
        if entry.get("free", True) and not is_mode(name):
            table.add_row(name, *(_shown(entry.get(key)) for key in ("value", "std", "discretisation_bias",
                                                                     "systematic_std")), entry.get("unit", ""))
    return table


def treatments_table(result: Mapping) -> Table | str:
    """What every treatment of boundary and camera gives."""
    found = treatment_table(result)
    if found is None:
        return "no other treatment of boundary and camera to compare with"
    table = Table("boundary", "camera", "ended", *found.quantities)
    for row in found.rows:
        table.add_row(*row)
    return table


def _shown(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"
