"""The parameters of a result as records: value, standard deviation, interval, unit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from html import escape

import numpy as np

from idic.report import number_text, readable_unit, with_std


@dataclass(frozen=True)
class Estimate:
    """A parameter of a result, in the unit of the experiment.

    std : standard deviation, None where the parameter was locked or the test does not determine it; of `std_noise` and
    `std_model` (docs/error-bars.md); ci95 : interval of 95 %; start : where the identification began
    """

    name: str
    value: float
    std: float | None
    ci95: tuple[float, float] | None
    unit: str
    start: float
    free: bool
    std_noise: float | None = None
    std_model: float | None = None

    @classmethod
    def of(cls, name: str, entry: Mapping) -> Estimate:
        """From the entry of ``result.json``."""
        ci95 = entry.get("ci95")
        return cls(name, entry["value"], entry["std"], None if ci95 is None else (ci95[0], ci95[1]), entry["unit"],
                   entry["start"], entry["free"], entry.get("std_noise"), entry.get("std_model"))

    @property
    def determined(self) -> bool:
        """Whether it was identified."""
        return self.std is not None

    def __str__(self) -> str:
        return f"{self.name} = {with_std(self.value, self.std, self.unit)}"


class Estimates(Mapping[str, Estimate]):
    """The parameters of a result by name, in the order of the experiment."""

    def __init__(self, entries: Mapping[str, Mapping]):
        self._items = {name: Estimate.of(name, entry) for name, entry in entries.items()}

    def __getitem__(self, name: str) -> Estimate:
        return self._items[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __repr__(self) -> str:
        return "\n".join(f"{estimate}{'' if estimate.free else '  (locked)'}" for estimate in self.values())

    def _repr_html_(self) -> str:
        return estimates_html(self.values())


def covariance(content: Mapping) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Names (n), values (n,) and covariance (n, n) of what a result determines, in the units of the experiment."""
    correlation = content["correlation"]
    names, entries = tuple(correlation["names"]), content["parameters"]
    values = np.array([entries[name]["value"] for name in names], dtype=float)
    stds = np.array([entries[name]["std"] for name in names], dtype=float)
    coefficients = np.array(correlation["matrix"], dtype=float).reshape(len(names), len(names))
    return names, values, coefficients * np.outer(stds, stds)


def estimates_html(estimates) -> str:
    """A table of estimates."""
    rows = "".join(
        f"<tr><td style='text-align:left'>{escape(e.name)}</td><td>{escape(with_std(e.value, e.std, e.unit))}</td>"
        f"<td>{escape(_interval(e))}</td><td>{escape(with_std(e.start, None, e.unit))}</td>"
        f"<td style='text-align:left'>{_state(e)}</td></tr>" for e in estimates)
    return ("<table><thead><tr><th style='text-align:left'>parameter</th><th>value ± std</th><th>95 "
            "%</th><th>start</th>"
            f"<th></th></tr></thead><tbody>{rows}</tbody></table>")


def _interval(estimate: Estimate) -> str:
    if estimate.ci95 is None:
        return ""
    factor, unit = readable_unit(estimate.value, estimate.unit)
    return " … ".join(number_text(end / factor,
    estimate.std / factor) for end in estimate.ci95) + f" {unit}".rstrip(" -")


def _state(estimate: Estimate) -> str:
    if not estimate.free:
        return "locked"
    return "" if estimate.determined else "not determined"
