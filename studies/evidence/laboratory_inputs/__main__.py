"""Inputs of laboratories, of two authors, counted: right, refused with the reason, wrong.

``python studies/evidence/laboratory_inputs`` prints the table, and every input that is not right; goal: none is wrong.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from itertools import chain
from pathlib import Path

from files import files
from outcome import REFUSED, RIGHT, WRONG, outcome
from recordings import recordings
from second_files import files as second_files
from second_recordings import recordings as second_recordings
from second_tables import fields, logs


def main(words: list[str]) -> int:
    """Judge all inputs whose kind or name holds one of the words; the number of wrong ones."""
    counts: dict[str, Counter] = {}
    for case in chain(recordings(), files(), second_recordings(), second_files(), logs(), fields()):
        if words and not any(word in f"{case.kind} {case.name}" for word in words):
            continue
        with tempfile.TemporaryDirectory() as folder:
            result, found = outcome(case, Path(folder) / "test")
        counts.setdefault(case.kind, Counter())[result] += 1
        if result != RIGHT:
            print(f"{result:<8} {case.kind}: {case.name}: {found[:400]}")
    total = sum(counts.values(), Counter())
    print("| kind | right | refused with the reason | wrong |\n| --- | --- | --- | --- |")
    for kind, count in [*counts.items(), ("all", total)]:
        print(f"| {kind} | {count[RIGHT]} | {count[REFUSED]} | {count[WRONG]} |")
    return total[WRONG]


if __name__ == "__main__":
    sys.exit(min(main(sys.argv[1:]), 1))
