"""The table of what was tried: what the sample asked of every constant and of every move, and what goes."""

from __future__ import annotations

import csv
import json
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from idic_studies.ablation.inventory import Constant

DECISIONS = Path(__file__).with_name("decisions.csv")
CONFIDENCE = 0.95

NOT_READ, ONE_OUTCOME, DECIDES, VALUE = "not read", "one outcome", "decides", "value"


@dataclass(frozen=True)
class Asked:
    """What the worlds of a sample asked of a constant.

    reads : how often it was read; compared : comparisons it took part in; places : {place: (n_true, n_false)}
    worlds : in which it was read; minority : worlds in which a comparison had the rarer outcome of its place
    """

    reads: int = 0
    compared: int = 0
    places: Mapping[str, tuple[int, int]] = None  # type: ignore[assignment]
    worlds: tuple[str, ...] = ()
    minority: tuple[str, ...] = ()

    @property
    def status(self) -> str:
        """Not read; read and compared, with one outcome at every place or with both; read and never compared."""
        if self.compared:
            return DECIDES if self.minority else ONE_OUTCOME
        return VALUE if self.reads else NOT_READ


def asked_of(ledgers: Mapping[str, Mapping[str, Mapping[str, int]]]) -> dict[str, Asked]:
    """{constant: what was asked of it} by the ledgers of some worlds (`trace.Ledger.content`)."""
    reads, read_in = Counter[str](), defaultdict[str, list[str]](list)
    total: dict[str, dict[str, Counter[bool]]] = defaultdict(lambda: defaultdict(Counter))
    outcomes_in: dict[str, dict[tuple[str, bool], list[str]]] = defaultdict(lambda: defaultdict(list))
    for world, ledger in ledgers.items():
        for key, n in ledger["reads"].items():
            name = key.split()[0]
            reads[name] += n
            if world not in read_in[name]:
                read_in[name].append(world)
        for key, n in ledger["outcomes"].items():
            name, place, outcome = key.split()
            total[name][place][outcome == "True"] += n
            outcomes_in[name][place, outcome == "True"].append(world)
    found = {}
    for name in {*reads, *total}:
        rare: dict[str, None] = {}
        for place, number in total[name].items():
            if min(number[True], number[False]):
                minority = len(outcomes_in[name][place, True]) < len(outcomes_in[name][place, False])
                rare |= dict.fromkeys(outcomes_in[name][place, minority])
        places = {place: (number[True], number[False]) for place, number in total[name].items()}
        found[name] = Asked(reads[name], sum(map(sum, places.values())), places, tuple(read_in[name]), tuple(rare))
    return found


def moves_of(ledgers: Iterable[Mapping[str, Any]]) -> dict[str, Counter]:
    """{move: how often it was asked, applied, accepted, …} and in how many worlds it was applied and accepted."""
    found: dict[str, Counter] = defaultdict(Counter)
    for ledger in ledgers:
        for name, number in ledger["moves"].items():
            found[name] += Counter(number)
            found[name]["worlds applied"] += number.get("applied", 0) > 0
            found[name]["worlds accepted"] += number.get("accepted", 0) > number.get("without effect", 0)
    return dict(found)


def largest_share_unseen(n: int, confidence: float = CONFIDENCE) -> float:
    """The share of worlds in which something may decide that decided in none of n: (1 - p)^n = 1 - confidence."""
    return 1.0 - (1.0 - confidence) ** (1.0 / n)


def ledgers(out: Path) -> dict[str, dict[str, Any]]:
    """Traces of the worlds in a folder."""
    return {path.parent.name: json.loads(path.read_text(encoding="utf-8"))["ledger"]
            for path in sorted(out.glob("*/trace.json"))}


def decisions(path: Path = DECISIONS) -> dict[str, tuple[str, str]]:
    """{constant or move: (decision, reason)}."""
    with path.open(encoding="utf-8", newline="") as file:
        return {row["name"]: (row["decision"], row["reason"]) for row in csv.DictReader(file)}


def rows(constants: Sequence[Constant], asked: Mapping[str, Asked]) -> list[tuple[str, ...]]:
    """One row per constant: name, value, what it bounds, reads, comparisons, worlds, worlds with the rarer outcome,
    status."""
    found = []
    for constant in constants:
        answer = asked.get(constant.name, Asked())
        found.append((constant.name, constant.value, constant.bounds, str(answer.reads), str(answer.compared),
                      str(len(answer.worlds)), str(len(answer.minority)), answer.status))
    return found
