"""The bench.

    python -m idic_studies.equality record --out DIR [--case NAME ... | --fast] [--arrays]
    python -m idic_studies.equality compare BASE HEAD [--all]
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from idic_studies.equality.case_process import record_cases
from idic_studies.equality.cases import CASES
from idic_studies.equality.comparison import Comparison, compared, read_record

MAX_DIFFERENCES = 10  # of a case that are shown
EQUAL, DIFFERENT = 0, 1


def main() -> int:
    """The commands; returns the exit code: 0 all equal, 1 something differs or failed."""
    parser = argparse.ArgumentParser(prog="python -m idic_studies.equality", description="Equality of two versions.")
    commands = parser.add_subparsers(dest="command", required=True)
    record = commands.add_parser("record", help="run cases and write their records")
    record.add_argument("--out", type=Path, required=True)
    record.add_argument("--case", action="append", choices=CASES, metavar="NAME", help=", ".join(CASES))
    record.add_argument("--fast", action="store_true", help="the cases of the default tests")
    record.add_argument("--arrays", action="store_true", help="keep the decoded arrays, too")
    compare = commands.add_parser("compare", help="list the differences of two folders of records")
    compare.add_argument("base", type=Path)
    compare.add_argument("head", type=Path)
    compare.add_argument("--all", action="store_true", help="all differences, not the first ones only")
    arguments = parser.parse_args()
    if arguments.command == "record":
        names = arguments.case or [case.name for case in CASES.values() if case.fast or not arguments.fast]
        return EQUAL if record_cases(names, arguments.out, arguments.arrays, _say) else DIFFERENT
    return compare_folders(arguments.base, arguments.head, None if arguments.all else MAX_DIFFERENCES)


def compare_folders(base: Path, head: Path, limit: int | None) -> int:
    """Compare all records that one of two folders holds."""
    names = sorted({file.stem for folder in (base, head) for file in folder.glob("*.json")},
                   key=lambda name: list(CASES).index(name) if name in CASES else len(CASES))
    code = EQUAL if names else DIFFERENT
    if not names:
        _say(f"no records in {base} and {head}")
    for name in names:
        files = [folder / f"{name}.json" for folder in (base, head)]
        missing = [str(file) for file in files if not file.is_file()]
        if missing:
            _say(f"{name:24} different: no record {missing[0]}")
            code = DIFFERENT
            continue
        comparison = compared(*(read_record(file) for file in files), *(_kept_arrays(file) for file in files))
        for line in comparison_lines(comparison, limit):
            _say(line)
        code = code if comparison.equal else DIFFERENT
    return code


def comparison_lines(comparison: Comparison, limit: int | None) -> list[str]:
    """A comparison in lines."""
    way = "" if comparison.exact else " (other fingerprint: numbers within tolerances, texts without numbers, no sums)"
    if comparison.equal:
        return [f"{comparison.case:24} equal{way}"]
    listed = comparison.differences[:limit]
    n_more = len(comparison.differences) - len(listed)
    return [f"{comparison.case:24} different{way}", *(f"    {difference}" for difference in listed),
            *([f"    and {n_more} more (--all)"] if n_more else [])]


def _kept_arrays(file: Path) -> Mapping[str, np.ndarray] | None:
    arrays = file.with_suffix(".npz")
    return np.lib.npyio.NpzFile(arrays, allow_pickle=False) if arrays.is_file() else None


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
