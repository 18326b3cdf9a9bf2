"""The ablation of the diagnosis, step by step; each step continues where it was interrupted.

    python -m idic_studies.ablation sample OUT                        draw the worlds; some need CalculiX
    python -m idic_studies.ablation trace OUT [WORLD …]               diagnose them once, with a trace
    python -m idic_studies.ablation without OUT NAME [WORLD …]        diagnose the worlds in which a constant or a move
                                                                      decided without it
    python -m idic_studies.ablation table OUT                         write table.md beside this file

Without a constant its comparisons have the outcome that most worlds gave them. NAME=NUMBER tries another value instead.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from idic_studies.ablation.inventory import constants
from idic_studies.ablation.runs import traced_sample, without
from idic_studies.ablation.table import asked_of, ledgers, write_table
from idic_studies.ablation.trace import Omission


def main(arguments: Sequence[str] | None = None) -> None:
    """One step of the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("step", choices=("sample", "trace", "without", "table"))
    parser.add_argument("out", type=Path)
    parser.add_argument("names", nargs="*")
    options = parser.parse_args(arguments)
    if options.step == "table":
        sys.stdout.write(f"{write_table(options.out)}\n")
        return
    for line in _runs(options.step, options.out, options.names):
        sys.stdout.write(f"{line}\n")
        sys.stdout.flush()


def _runs(step: str, out: Path, names: Sequence[str]) -> Iterator[str]:
    if step == "trace":
        return traced_sample(out, names)
    if step == "without":
        omission, worlds = omitted(out, names[0])
        return without(out, names[0], omission, names[1:] or worlds)
    from idic_studies.ablation.sample import draw_sample  # imports the diagnosis, which a trace must come before

    return draw_sample(out)


def omitted(out: Path, name: str) -> tuple[Omission, list[str]]:
    """What to go without, and the worlds of a traced sample in which that decides.

    name : of a constant (`inventory.constants`), of a move, or CONSTANT=NUMBER
    """
    worlds = ledgers(out)
    if "=" in name:
        name, _, number = name.partition("=")
        return Omission(values={name: float(number) if "." in number or "e" in number else int(number)}), list(
            asked_of(worlds)[name].worlds)
    if name in {constant.name for constant in constants()}:
        answer = asked_of(worlds)[name]
        outcomes = {(name, place): outcome for place, outcome in answer.usual.items()}
        return Omission(outcomes=outcomes), list(answer.minority)
    return Omission(moves=(name,)), [world for world, ledger in worlds.items()
                                     if ledger["moves"].get(name, {}).get("accepted", 0)]


if __name__ == "__main__":
    main()
