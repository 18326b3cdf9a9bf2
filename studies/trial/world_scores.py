"""Scores and targets of trials in drawn worlds."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from idic_studies.pages.study_page import Goal
from idic_studies.trial.evaluation import NO_ALARM, TrialRecord
from idic_studies.trial.scores import median_goal, share_goal
from idic_studies.trial.strength import CLEAR, CONCEALED, FAINT
from idic_studies.trial.trial import NOT_GENERATED

MAX_BRIER = 0.05
MIN_INTERVALS = 0.9


def world_goals(records: Sequence[TrialRecord]) -> tuple[Goal, ...]:
    """Every score with trials; trials whose generation failed do not count."""
    records = [r for r in records if r.verdict != NOT_GENERATED]
    single = [r for r in records if r.group == "singles"]
    visible = [r for r in single if r.strength in (CONCEALED, CLEAR)]
    of = {group: [r for r in records if r.group == group] for group in ("clean", "outside", "pairs")}
    onsets = [r for r in visible if r.onset_error is not None and r.verdict not in NO_ALARM]
    scores = [
        share_goal("alarms on clean recordings", of["clean"], lambda r: r.alarm, "≤ 1 %", most=0.01),
        share_goal("false physics: a material cause that is not there", records, lambda r: r.false_physics, "≤ 3 %",
                   most=0.03),
        share_goal("cause in the set, or its side flagged (concealed, clear)", visible, right_or_flagged, "≥ 92 %",
                   least=0.92),
        share_goal("cause in the set (concealed, clear)", visible, lambda r: r.inside, ""),
        share_goal("cause alone (concealed, clear)", visible, _alone, ""),
        share_goal("cause in the set (faint)", [r for r in single if r.strength == FAINT], lambda r: r.inside, "≥ 85 %",
                   least=0.85),
        share_goal("both causes of a pair", of["pairs"], lambda r: r.inside, "≥ 90 %", least=0.9),
        share_goal("no candidate: unexplained by the library, or a slit told as a cut", of["outside"],
                   lambda r: r.verdict == "outside_library" or r.inside, ""),
        share_goal("onset within 2 frames", onsets, lambda r: abs(r.onset_error) <= 2.0, "≥ 90 %", least=0.9),
        median_goal("bias after / before (median)", [r.bias_ratio for r in visible if r.bias_ratio is not None],
                    "≤ 0.15", most=0.15),
        _intervals(records), _brier(records)]
    return tuple(goal for goal in scores if goal is not None)


def right_or_flagged(record: TrialRecord) -> bool:
    """Whether the truth is in the reported set, or is reported as unexplained on the right side."""
    return record.inside or (record.verdict == "outside_library" and record.side_right)


def _alone(record: TrialRecord) -> bool:
    return record.inside and len(record.reported) == 1 and record.verdict == "single"


def _intervals(records: Sequence[TrialRecord]) -> Goal | None:
    """95 % intervals of the last model, where the truth is in the set."""
    counted = [r.intervals for r in records if (r.inside or r.group == "clean") and r.intervals[1]]
    n_held, n = (sum(part) for part in zip(*counted, strict=True)) if counted else (0, 0)
    return Goal("95 % intervals of the last model that hold the truth (cause in the set, or clean)", "≥ 90 %",
                f"{n_held} of {n} ({100.0 * n_held / n:.0f} %)", n_held / n >= MIN_INTERVALS) if n else None


def _brier(records: Sequence[TrialRecord]) -> Goal | None:
    """Mean square of the given probability less the outcome: the set holds the truth, or nothing is missing."""
    squares = [(r.probability - float(_holds(r))) ** 2 for r in records if r.probability is not None]
    return Goal("Brier score of the probability", "≤ 0.05", f"{np.mean(squares):.3f} (n = {len(squares)})",
                bool(np.mean(squares) <= MAX_BRIER)) if squares else None


def _holds(record: TrialRecord) -> bool:
    """Whether the answer is right; finite strains of the truth are no alarm, and no error of a clean recording."""
    if record.verdict == "none":
        return not record.truth
    return record.inside or (not record.truth and not record.alarm)


Filter = Callable[[TrialRecord], bool]
PARTS: tuple[tuple[str, Filter], ...] = (("all", lambda r: True), ("known kinds", lambda r: not r.unseen),
                                         ("unseen kinds", lambda r: r.unseen))
