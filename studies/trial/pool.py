"""Trials of several campaigns pooled, and their table of scores and targets.

    python -m idic_studies.trial.pool OUT [OUT …]
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from idic_studies.trial.evaluation import TrialRecord, evaluated
from idic_studies.trial.scores import goals
from idic_studies.trial.seal import Folder, answered, opened
from idic_studies.trial.world_scores import PARTS, world_goals


def records_of(outs: Sequence[Path]) -> list[TrialRecord]:
    """The evaluated answers in the folders of some trials."""
    return [evaluated(folder, number, opened(folder, number), answer)
            for folder in map(Folder, outs) for number, answer in answered(folder).items()]


def target_table(records: Sequence[TrialRecord]) -> str:
    """Scores and targets as text; of drawn worlds also for known and unseen kinds alone."""
    in_worlds = [r for r in records if r.world]
    if not in_worlds:
        return _lines([("score", "target", "measured")] + [(g.what, g.wanted, g.got) for g in goals(records)])
    parts = [(name, {g.what: g for g in world_goals([r for r in in_worlds if chosen(r)])}) for name, chosen in PARTS]
    rows = [("score", "target", *(name for name, _ in parts))]
    rows += [(score, goal.wanted or "–", *(part[score].got if score in part else "–" for _, part in parts))
             for score, goal in parts[0][1].items()]
    return _lines(rows)


def _lines(rows: Sequence[Sequence[str]]) -> str:
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return "".join("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() + "\n"
                   for row in rows)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table of some campaigns together."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("out", type=Path, nargs="+")
    options = parser.parse_args(arguments)
    sys.stdout.write(target_table(records_of(options.out)))


if __name__ == "__main__":
    main()
