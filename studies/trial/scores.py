"""Scores of evaluated trials and their targets, and the confusion matrix."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from idic_studies.pages.study_page import Goal
from idic_studies.trial.evaluation import TrialRecord
from idic_studies.trial.strength import CLEAR, CONCEALED, FAINT
from idic_studies.trial.trial import NOT_GENERATED

VERDICTS_WITHOUT_A_NAME = ("none", "blind", "outside_library", "failed", NOT_GENERATED)


def goals(records: Sequence[TrialRecord]) -> tuple[Goal, ...]:
    """Every score with trials; trials whose generation failed do not count."""
    records = [r for r in records if r.verdict != NOT_GENERATED]
    single = [r for r in records if r.group == "singles"]
    visible = [r for r in single if r.strength in (CONCEALED, CLEAR)]
    quiet = [r for r in single if r.strength in (FAINT, CONCEALED)]
    of = {group: [r for r in records if r.group == group] for group in ("clean", "outside", "pairs", "twins")}
    named = [r for r in visible if r.named]
    scores = [
        share_goal("false alarms on clean recordings (nominal 1 %)", of["clean"], lambda r: r.alarm, "≤ 2 %",
                   most=0.02),
        share_goal("right family first (concealed and clear)", visible, lambda r: r.family_first, "≥ 90 %", least=0.9),
        share_goal("right family first (faint)", [r for r in single if r.strength == FAINT],
                   lambda r: r.family_first, ""),
        share_goal("truth inside the reported set (concealed and clear)", visible, lambda r: r.inside, "≥ 95 %",
                   least=0.95),
        share_goal("indistinguishable pairs given as a set", of["twins"], lambda r: r.as_set, "≥ 90 %", least=0.9),
        share_goal("effects unexplained by the library, reported as such", of["outside"],
                   lambda r: r.verdict == "outside_library", "≥ 80 %", least=0.8),
        share_goal("… and falsely named", of["outside"], lambda r: r.verdict in ("single", "set", "multiple"), "≤ 10 %",
                   most=0.1),
        share_goal("both effects of a pair", of["pairs"], lambda r: r.inside, "≥ 75 %", least=0.75),
        share_goal("onset within 2 frames", [r for r in visible if r.onset_error is not None],
                   lambda r: abs(r.onset_error) <= 2.0, "≥ 90 %", least=0.9),
        median_goal("median error of the onset (frames)",
                    [abs(r.onset_error) for r in visible if r.onset_error is not None], "≤ 1", most=1.0),
        median_goal("median overlap of place", [r.overlap for r in visible if r.overlap is not None], "≥ 0.5",
                    least=0.5),
        median_goal("held-out excess after / before (concealed and clear, median)",
                    [r.excess_ratio for r in named if r.excess_ratio is not None], "≤ 0.15", most=0.15),
        median_goal("parameter bias after / before (concealed and clear, median)",
                    [r.bias_ratio for r in named if r.bias_ratio is not None], "≤ 20 %", most=0.2),
        median_goal("blocks of pixels and later frames that get better (concealed and clear, median share)",
                    [r.blocks_better for r in named if r.blocks_better is not None], "≥ 80 %", least=0.8),
        median_goal("predicted against achieved drop of chi-square (faint and concealed, median deviation)",
                    [abs(r.drop_ratio - 1.0) for r in quiet if r.drop_ratio is not None], "≤ 25 %", most=0.25),
        median_goal("CPU seconds of a trial (median)", [r.cpu_s for r in records], "≤ 120", most=120.0)]
    return tuple(goal for goal in scores if goal is not None)


def share_goal(title: str, records: Sequence[TrialRecord], right: Callable[[TrialRecord], bool], target: str,
               least: float = 0.0, most: float = 1.0) -> Goal | None:
    if not records:
        return None
    n = sum(bool(right(r)) for r in records)
    return Goal(title, target, f"{n} of {len(records)} ({100.0 * n / len(records):.0f} %)",
                least <= n / len(records) <= most if target else None)


def median_goal(title: str, values: Sequence[float], target: str, least: float = -np.inf,
                most: float = np.inf) -> Goal | None:
    if not len(values):
        return None
    middle = float(np.median(values))
    return Goal(title, target, f"{middle:.3g} (n = {len(values)}, worst {_worst(values, most):.3g})",
                least <= middle <= most)


def _worst(values: Sequence[float], most: float) -> float:
    return float(max(values) if np.isfinite(most) else min(values))


def said(record: TrialRecord) -> str:
    """The column of the confusion matrix: the first name, or the verdict without one."""
    return record.named[0] if record.named and record.verdict not in VERDICTS_WITHOUT_A_NAME else record.verdict


def confusion(records: Sequence[TrialRecord]) -> tuple[tuple[str, ...], tuple[str, ...], np.ndarray]:
    """Rows: true effect (clean and outside last); columns: first name  # rows, columns, counts"""
    chosen = [r for r in records if r.group in ("singles", "clean", "outside")]
    label = {"clean": lambda r: "clean", "outside": lambda r: f"outside: {r.truth[0]}"}
    true = [label.get(r.group, lambda r: r.truth[0])(r) for r in chosen]
    order = {"singles": 0, "clean": 1, "outside": 2}
    rows = tuple(dict.fromkeys(t for _, t in sorted(zip(chosen, true, strict=True), key=lambda p: order[p[0].group])))
    first_names = [said(r) for r in chosen]
    columns = tuple(dict.fromkeys([*(row for row in rows if row in first_names),
                                   *sorted(set(first_names) - set(rows) - set(VERDICTS_WITHOUT_A_NAME)),
                                   *(word for word in VERDICTS_WITHOUT_A_NAME if word in first_names)]))
    counts = np.zeros((len(rows), len(columns)), dtype=int)
    for t, s in zip(true, first_names, strict=True):
        counts[rows.index(t), columns.index(s)] += 1
    return rows, columns, counts
