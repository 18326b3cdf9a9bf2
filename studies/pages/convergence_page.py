"""The page of the convergence study: the share of starts that converge to the truth over their distance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from idic.report import CYCLE, Picture, look, new_figure, to_picture
from idic_studies.pages.case_record import CaseRecord
from idic_studies.pages.study_page import StudyPage, StudySection, Table

MAX_ERROR_STD, MAX_ERROR_SHARE = 4.0, 0.01  # of a success: standard deviations, plus this share of the truth
IN_WORDS = {"metal": "open-hole strip of metal, 4 parameters", "bulge": "bulge test, 5 parameters",
            "polycarbonate": "necking polycarbonate, 10 parameters"}
SCHEDULES = {"all": "all at once", "spectrum": "spectrum", "coarse": "blurred images first",
             "windows": "first thirds first", "beside": "four parallel steps"}


def reached_truth(record: CaseRecord) -> bool:
    """Converged, and every parameter at its truth within its stated error and the bias of a coarse mesh."""
    value, std, truth = (record.arrays[name] for name in ("value", "std", "truth"))
    allowed = MAX_ERROR_STD * np.nan_to_num(std, nan=0.0) + MAX_ERROR_SHARE * np.abs(truth)
    return bool(record.converged and np.all(np.abs(value - truth) <= allowed))


def success(records: Sequence[CaseRecord]) -> dict[tuple[str, str, float], tuple[int, int, float, float]]:
    """(starts that reach the truth, starts, mean CPU s, mean rounds) per test, schedule and distance."""
    counted: dict[tuple[str, str, float], list[CaseRecord]] = {}
    for record in records:
        test, _, schedule = record.group.partition("-")
        counted.setdefault((test, schedule, int(record.name.partition("-")[0]) / 100), []).append(record)
    return {key: (sum(map(reached_truth, members)), len(members), float(np.mean([r.facts["cpu_s"] for r in members])),
                  float(np.mean([r.facts["rounds"] for r in members]))) for key, members in counted.items()}


def draw_convergence(records: Mapping[str, CaseRecord]) -> StudyPage:
    """The page of the finished cases."""
    counts = success(list(records.values()))
    sections = []
    for test in dict.fromkeys(key[0] for key in counts):
        of_test = {key[1:]: value for key, value in counts.items() if key[0] == test}
        sections.append(StudySection(test, IN_WORDS.get(test, test), "All schedules have the same starts.",
                                     (_table(of_test),), (_picture(test, of_test),)))
    total = {name: [sum(v[i] for k, v in counts.items() if k[1] == name) for i in (0, 1)] for name in SCHEDULES}
    shares = ", ".join(f"{SCHEDULES[name]} {n} of {of}" for name, (n, of) in total.items() if of)
    return StudyPage("Success over the distance of the start", f"At the truth: {shares}.", (), tuple(sections))


def _table(of_test: Mapping[tuple[str, float], tuple[int, int, float, float]]) -> Table:
    distances = sorted({distance for _, distance in of_test})
    rows = []
    for name, words in SCHEDULES.items():
        cells = [of_test.get((name, distance)) for distance in distances]
        if any(cells):
            counts = [cell for cell in cells if cell]
            means = [sum(c[k] * c[1] for c in counts) / sum(c[1] for c in counts) for k in (2, 3)]
            rows.append((words, *("–" if cell is None else f"{cell[0]} of {cell[1]}" for cell in cells),
                         *(f"{mean:.1f}" for mean in means)))
    headings = ("schedule", *(f"distance {d:g}" for d in distances), "CPU s per run", "rounds per run")
    note = (f"At the truth: converged, every parameter within {MAX_ERROR_STD:g} standard deviations plus "
            f"{100 * MAX_ERROR_SHARE:g} % of its truth. Distance d: every parameter times d^u, |u| up to 1. A round: "
            "points that are evaluated in parallel, or one alone.")
    return Table("Starts that converge to the truth", headings, tuple(rows), note)


def _picture(test: str, of_test: Mapping[tuple[str, float], tuple[int, int, float, float]]) -> Picture:
    with look():
        figure = new_figure(6.5, 3.2)
        axis = figure.subplots()
        ticks = sorted({distance for _, distance in of_test})
        spacing = min(0.02, 0.06 * np.diff(np.log(ticks)).min(initial=np.inf))  # of the schedules at one distance
        for k, (name, words) in enumerate(SCHEDULES.items()):
            points = sorted((distance, n / of) for (schedule, distance), (n, of, *_) in of_test.items()
                            if schedule == name)
            if points:
                at = np.array(points)
                axis.plot(at[:, 0] * np.exp(spacing * (k - 2)), at[:, 1], "o-", color=CYCLE[k], label=words,
                          markersize=4)
        axis.set(xlabel="distance of the start [–]", ylabel="share at the truth [–]", ylim=(-0.05, 1.05),
                 xscale="log")
        axis.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axis.minorticks_off()
        axis.legend()
        return to_picture(figure, f"success_{test}", "Starts that converge to the truth",
                      "Points of one distance are shifted a little.")
