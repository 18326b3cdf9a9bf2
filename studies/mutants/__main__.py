"""Apply mutants one by one to a copy of the checkout and run their tests.

    python -m idic_studies.mutants [WORD ...]      those whose name holds one of the words; all by default
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from idic_studies.mutants.mutants import caught, copied_checkout, mutants

ALL_CAUGHT, SOME_MISSED = 0, 1


def main() -> int:
    """Print a line per mutant; returns the exit code: 0 all caught, 1 some missed."""
    parser = argparse.ArgumentParser(prog="python -m idic_studies.mutants", description="Do the tests see faults?")
    parser.add_argument("words", nargs="*", help="of the names of the mutants to try")
    words = parser.parse_args().words
    chosen = [mutant for mutant in mutants() if not words or any(word in mutant.name for word in words)]
    with tempfile.TemporaryDirectory(prefix="idic-mutants-") as folder:
        checkout, missed = copied_checkout(Path(folder)), 0
        for mutant in chosen:
            failed = caught(mutant, checkout)
            missed += failed is None
            sys.stdout.write(f"{'missed' if failed is None else 'caught'}  {mutant.name}"
                             f"{'' if failed is None else f'  [{failed}]'}\n")
            sys.stdout.flush()
    sys.stdout.write(f"{len(chosen) - missed} of {len(chosen)} caught\n")
    return SOME_MISSED if missed else ALL_CAUGHT


if __name__ == "__main__":
    sys.exit(main())
