"""Parameters beside what the noise does not know of."""

from __future__ import annotations

from collections.abc import Mapping

from rich.table import Table


def systematic_table(result: Mapping) -> Table:
    """Value, standard deviation, discretisation bias and systematic spread of every free parameter."""
    table = Table("parameter", "value", "std", "discretisation bias", "systematic std", "unit")
    for name, entry in result["parameters"].items():
        if entry["free"]:
            table.add_row(name, *(_shown(entry.get(key)) for key in ("value", "std", "discretisation_bias",
                                                                     "systematic_std")), entry["unit"])
    return table


def _shown(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"
