"""The page of the coverage study: coverage of the 95 % intervals, scatter against the Cramér-Rao bound."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from idic.report import Colour, Picture, look, new_figure, to_picture
from idic_studies.pages import study_charts as charts
from idic_studies.pages.case_record import CaseRecord
from idic_studies.pages.study_page import Goal, StudyPage, StudySection, Table

Z95 = 1.96
COVERAGE_RANGE = (0.93, 0.97)  # target
MAX_SCATTER_OVER_BOUND = 1.1  # target
MIN_DRAWS_OF_A_TARGET = 300  # from here on a coverage of 95 % is known to 2.5 % (95 % of chance)
MAX_SHOWN_ERROR = 5.0  # standard deviations
SYMBOLS = {"sheet.E": "$E$", "sheet.nu": "$\\nu$", "sheet.yield_stress": "$\\sigma_y$",
           "sheet.hardening_modulus": "$H$"}
PLAIN = {"sheet.E": "E", "sheet.nu": "ν", "sheet.yield_stress": "σy", "sheet.hardening_modulus": "H"}
IN_WORDS = {"grips": "metal, logged grip", "polymer": "polymer, logged grip", "measured": "polymer, measured edges",
            "virtual": "polymer, virtual boundaries", "foreign": "metal, logged grip, truth on a finer mesh",
            "foreign_measured": "polymer, measured edges, truth on a finer mesh",
            "foreign_virtual": "polymer, virtual boundaries, truth on a finer mesh"}
WORLD_IN_WORDS = {"blurred": "noise smoothed over 0.6 px", "jpeg": "JPEG of quality 80",
                  "bayer": "colour filter, demosaiced",
                  "grey_level": "noise by grey level", "understated": "noise stated 20 % low",
                  "drifting_force": "force noise correlated 0.9 from frame to frame",
                  "fields": "displacements of a subset DIC in the place of the images"}
BOUND_OF = {"foreign": "grips", "foreign_measured": "measured", "foreign_virtual": "virtual"}


@dataclass(frozen=True)
class Coverage:
    """Statistics of the draws of one group, per parameter of the law.

    covered : share of the intervals that hold the truth
    bias : mean error / stated std
    scatter, above_bound : std of the values / stated std, / Cramér-Rao bound (NaN where unknown)
    z : (draws, n) errors over stated std
    """

    name: str
    asked: int
    names: tuple[str, ...]
    z: np.ndarray
    stated: np.ndarray  # (n,) mean stated std / truth
    covered: np.ndarray
    bias: np.ndarray
    scatter: np.ndarray
    above_bound: np.ndarray

    @property
    def draws(self) -> int:
        return len(self.z)

    @property
    def band(self) -> np.ndarray:
        """Coverage that is compatible with the draws, 95 % (Wilson 1927, doi:10.2307/2276774)  # (2, n)"""
        n, share = self.draws, self.covered
        middle, spread = share + Z95**2 / (2 * n), Z95 * np.sqrt(share * (1 - share) / n + Z95**2 / (4 * n**2))
        return np.array([middle - spread, middle + spread]) / (1 + Z95**2 / n)

    @property
    def route(self) -> str:
        return self.name.partition("-")[0]

    @property
    def in_words(self) -> str:
        world, separator, route = self.route.rpartition("_")
        if separator and world in WORLD_IN_WORDS:
            return f"{WORLD_IN_WORDS[world]}: {IN_WORDS[route]}, {self.name.partition('-')[2]} least squares"
        return f"{IN_WORDS[self.route]}, {self.name.partition('-')[2]} least squares"


def coverage_of(name: str, records: Sequence[CaseRecord], bound: CaseRecord | None) -> Coverage:
    """Statistics of the converged draws of a group."""
    converged = [record for record in records if record.converged]
    names = tuple(key for key in PLAIN if key in converged[0].names)
    pick = [converged[0].names.index(key) for key in names]
    value, std, truth = (np.array([r.arrays[key][pick] for r in converged]) for key in ("value", "std", "truth"))
    z = (value - truth) / std
    mean_std, scatter = std.mean(axis=0), value.std(axis=0, ddof=1)
    least = np.full(len(pick), np.nan)
    if bound is not None:
        least = np.array([bound.arrays["std"][bound.names.index(key)] for key in names])
    return Coverage(name, len(records), names, z, mean_std / truth[0], (np.abs(z) < Z95).mean(axis=0), z.mean(axis=0),
                    scatter / mean_std, scatter / least)


def draw_coverage(records: Mapping[str, CaseRecord]) -> StudyPage:
    """The page of the finished cases."""
    members: dict[str, list[CaseRecord]] = {}
    for record in records.values():
        if record.group != "bound":
            members.setdefault(record.group, []).append(record)
    coverages = []
    for name, group in members.items():
        route = name.partition("-")[0]
        bound = records.get(f"bound/{BOUND_OF.get(route, route)}")
        if sum(record.converged for record in group) > 1:
            coverages.append(coverage_of(name, group, bound))
    goals = [goal for group in coverages if group.draws >= MIN_DRAWS_OF_A_TARGET for goal in _goals(group)]
    first = f"{sum(goal.met for goal in goals)} of {len(goals)} targets are met." if goals else ""
    text = ("Every draw has its own noise on all images, the reference included, on the force and on the logged grip, "
            "and its own gain and offset of every frame. The truth is computed on the user's mesh unless stated "
            "otherwise. Bound: standard deviation of generalised least squares on records without noise.")
    sections = (StudySection("coverage", "Coverage of the 95 % intervals", text, (_table(coverages),), (
        _picture(coverages), _intervals(coverages))),) if coverages else ()
    return StudyPage("Coverage of the error bars", first, tuple(goals), sections)


def _goals(group: Coverage) -> list[Goal]:
    unbiased = group.route not in BOUND_OF
    low, high = group.covered.min(), group.covered.max()
    inside = bool(COVERAGE_RANGE[0] <= low and high <= COVERAGE_RANGE[1])
    goals = [Goal(f"coverage, {group.in_words}, {group.draws} draws", "93 to 97 %, every parameter",
                  f"{100 * low:.1f} to {100 * high:.1f} %", inside)]
    if unbiased and group.name.endswith("generalised"):
        worst = np.nanmax(group.above_bound)
        goals.append(Goal(f"scatter over the Cramér-Rao bound, {group.in_words}", f"at most {MAX_SCATTER_OVER_BOUND}",
                          f"{worst:.3f}", bool(worst <= MAX_SCATTER_OVER_BOUND)))
    return goals


def _table(coverages: Sequence[Coverage]) -> Table:
    rows = []
    for group in coverages:
        for i, name in enumerate(group.names):
            low, high = 100 * group.band[:, i]
            rows.append((group.in_words, PLAIN[name], f"{100 * group.covered[i]:.1f} %", f"{low:.1f} to {high:.1f} %",
                         f"{group.bias[i]:+.2f}",
                         f"{group.scatter[i]:.3f}", f"{group.above_bound[i]:.3f}", f"{100 * group.stated[i]:.3g} %",
                         f"{group.draws} of {group.asked}"))
    return Table("Coverage per parameter",
                 ("", "parameter", "coverage", "of chance (95 %)", "mean error / std", "scatter / std",
                                            "scatter / bound", "stated std", "converged"), tuple(rows),
                 "1000 draws know a coverage of 95 % to ± 1.4 % (95 % of chance), a scatter to 2.2 %.")


def _picture(coverages: Sequence[Coverage]) -> Picture:
    with look():
        figure = new_figure(8.0, 1.2 + 0.36 * len(coverages))
        axis = figure.subplots()
        axis.axvspan(100 * COVERAGE_RANGE[0], 100 * COVERAGE_RANGE[1], color=Colour.FAINT, lw=0)
        axis.axvline(95.0, color=Colour.GREY, lw=0.8)
        most = int(np.argmax([len(group.names) for group in coverages]))
        for row, group in enumerate(coverages):
            colour = Colour.BLUE if group.name.endswith("generalised") else Colour.ORANGE
            for i, name in enumerate(group.names):
                y = -row + 0.12 * (1.5 - i)
                axis.plot(100 * group.band[:, i], [y, y], color=colour, lw=0.8, alpha=0.5)
                axis.plot(100 * group.covered[i], y, charts.SIGNS[i], color=colour, ms=4,
                          label=SYMBOLS[name] if row == most else None)
        axis.set_yticks(-np.arange(len(coverages)), [group.name.replace("-", ", ") for group in coverages])
        axis.set(xlabel="95 % intervals that hold the truth [%]")
        figure.legend(loc="outside right upper")
        return to_picture(figure, "coverage", "Coverage", "Grey: 93 to 97 %. Blue: generalised, orange: ordinary least "
                      "squares. Lines: what is compatible with the number of draws (95 %).")


def _intervals(coverages: Sequence[Coverage]) -> Picture:
    """Every error over its stated standard deviation: inside the band the interval holds the truth."""
    with look():
        figure = new_figure(8.0, 1.0 + 0.2 * sum(len(group.names) for group in coverages))
        axis, labels = figure.subplots(), []
        axis.axvspan(-Z95, Z95, color=Colour.FAINT, lw=0)
        for group in coverages:
            for i, name in enumerate(group.names):
                z = np.clip(group.z[:, i], -MAX_SHOWN_ERROR, MAX_SHOWN_ERROR)
                for part, colour in ((np.abs(z) < Z95, Colour.BLUE), (np.abs(z) >= Z95, Colour.ORANGE)):
                    axis.plot(z[part], np.full(int(part.sum()), -len(labels)), "|", ms=5, mew=0.7, color=colour)
                labels.append(f"{group.name.replace('-', ', ')}: {SYMBOLS[name]}")
            axis.axhline(-len(labels) + 0.5, color=Colour.GREY, lw=0.4)
        axis.set_yticks(-np.arange(len(labels)), labels, fontsize=7)
        axis.set(xlabel=f"(value − truth) / std [–]; beyond ± {MAX_SHOWN_ERROR:.0f} at the edge",
                 ylim=(-len(labels) + 0.4, 0.6))
        return to_picture(figure, "intervals", "Intervals against truth", "A stroke per draw. Grey: the 95 % interval "
                          "holds the truth; orange: it does not.")
