"""The page of the two-step study: scatter, bias and error bars of every method on the same noisy images."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from idic.report import CYCLE, Picture, look, new_figure, to_picture
from idic_studies.pages.case_record import CaseRecord
from idic_studies.pages.study_page import StudyPage, StudySection, Table

METHODS = {"integrated": "integrated", "ordinary": "integrated, ordinary least squares",
           "two_step": "two steps, weighted", "two_step_mechanical": "two steps, weighted, regularised FE-DIC",
           "unweighted": "two steps, unweighted", "unweighted_mechanical": "two steps, unweighted, regularised FE-DIC"}
PLAIN = {"sheet.E": "E", "sheet.nu": "ν", "sheet.yield_stress": "σy", "sheet.hardening_modulus": "H"}


@dataclass(frozen=True)
class Spread:
    """Statistics of the draws of one method.

    bias, scatter, stated : mean error, scatter and mean stated standard deviation over the truth, per parameter
    converged, asked : numbers of draws; cpu_s : CPU s per draw
    """

    bias: np.ndarray
    scatter: np.ndarray
    stated: np.ndarray
    converged: int
    asked: int
    cpu_s: float


def spread_of(records: Sequence[CaseRecord]) -> Spread | None:
    """Statistics of the converged draws of a method; None with fewer than two."""
    converged = [record for record in records if record.converged]
    if len(converged) < 2:
        return None
    pick = [converged[0].names.index(name) for name in PLAIN]
    value, std, truth = (np.array([r.arrays[key][pick] for r in converged]) for key in ("value", "std", "truth"))
    scatter = value.std(axis=0, ddof=1)
    return Spread(value.mean(axis=0) / truth[0] - 1.0, scatter / truth[0], std.mean(axis=0) / truth[0], len(converged),
                  len(records), float(np.mean([record.facts["cpu_s"] for record in records])))


def draw_two_step(records: Mapping[str, CaseRecord]) -> StudyPage:
    """The page of the finished cases."""
    cells: dict[tuple[str, str], dict[str, list[CaseRecord]]] = {}
    for record in records.values():
        mesh, noise, method = record.group.split("-")
        cells.setdefault((mesh, noise), {}).setdefault(method, []).append(record)
    sections = []
    for (mesh, noise), members in cells.items():
        spreads = {method: spread_of(members[method]) for method in METHODS if method in members}
        level = next(iter(members.values()))[0].facts["case"]["noise"]
        title = f"{mesh.capitalize()} mesh, noise {level:g} grey values"
        sections.append(StudySection(f"{mesh}-{noise}", title, "", (_table(title, spreads, members),),
                                     (_picture(f"{mesh}_{noise}", title, spreads),)))
    return StudyPage("The integrated method and two steps", "Scatter and bias over draws of the same noise.", (),
                     tuple(sections))


def _table(title: str, spreads: Mapping[str, Spread | None], members: Mapping[str, Sequence[CaseRecord]]) -> Table:
    header = ("method", *(f"{symbol}: bias ± scatter (stated std) [%]" for symbol in PLAIN.values()), "converged",
              "CPU s")
    rows = []
    for method, spread in spreads.items():
        if spread is None:
            rows.append((METHODS[method], *("–",) * len(PLAIN), f"0 or 1 of {len(members[method])}", "–"))
            continue
        values = [f"{100 * b:+.2g} ± {100 * s:.2g} ({100 * mean_std:.2g})"
                  for b, s, mean_std in zip(spread.bias, spread.scatter, spread.stated, strict=True)]
        rows.append((METHODS[method], *values, f"{spread.converged} of {spread.asked}", f"{spread.cpu_s:.1f}"))
    draws = max((spread.converged for spread in spreads.values() if spread is not None), default=0)
    note = (f"Bias and scatter: mean and standard deviation of the relative error. A scatter is known to "
            f"{100 / np.sqrt(2 * max(draws - 1, 1)):.0f} % of itself, a bias to {100 / np.sqrt(max(draws, 1)):.0f} % "
            "of the scatter.")
    return Table(title, header, tuple(rows), note)


def _picture(name: str, title: str, spreads: Mapping[str, Spread | None]) -> Picture:
    with look():
        figure = new_figure(6.5, 3.0)
        axis = figure.subplots()
        determined = [(method, spread) for method, spread in spreads.items() if spread is not None]
        for k, (method, spread) in enumerate(determined):
            at = np.arange(len(PLAIN)) + 0.12 * (k - (len(determined) - 1) / 2)
            axis.errorbar(at, 100 * spread.bias, 100 * spread.scatter, fmt="o", color=CYCLE[k % len(CYCLE)],
                          markersize=4, capsize=2, label=METHODS[method])
        axis.axhline(0.0, color="0.6", linewidth=0.8)
        axis.set_xticks(range(len(PLAIN)), list(PLAIN.values()))
        axis.set(ylabel="relative error: mean, scatter [%]", yscale="symlog")
        axis.legend(fontsize=6)
        return to_picture(figure, f"two_step_{name}", title, "Points: mean error; bars: scatter of one identification.")
