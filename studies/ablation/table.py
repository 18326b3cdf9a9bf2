"""The table of what was tried: what the sample asked of every constant and of every move, and what goes."""

from __future__ import annotations

import csv
import json
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from idic_studies.ablation.inventory import Constant, constants

TABLE, DECISIONS = Path(__file__).with_name("table.md"), Path(__file__).with_name("decisions.csv")
ROOM = "idic/diagnose/"  # elsewhere a constant is a number like any other
CONFIDENCE = 0.95
MEASURES = ("verdict", "reported", "alarm", "false_physics", "inside", "side_right", "onset_error", "intervals",
            "probability")  # of the blind trial (`idic_studies.trial.evaluation.TrialRecord`)

NOT_READ, ONE_OUTCOME, DECIDES, VALUE = "not read", "one outcome", "decides", "value"


@dataclass(frozen=True)
class Asked:
    """What the worlds of a sample asked of a constant.

    reads : how often it was read; compared : comparisons it took part in; places : {place: (n_true, n_false)}
    usual : {place: the outcome that occurred in most worlds, or most often}
    worlds : in which it was read; minority : worlds in which a comparison had the rarer outcome of its place
    """

    reads: int = 0
    compared: int = 0
    places: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    usual: Mapping[str, bool] = field(default_factory=dict)
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
            if not place.startswith(ROOM):
                continue
            total[name][place][outcome == "True"] += n
            outcomes_in[name][place, outcome == "True"].append(world)
    usage = {}
    for name in {*reads, *total}:
        usual, rare = {}, dict[str, None]()
        for place, number in total[name].items():
            counts = [(len(outcomes_in[name][place, outcome]), number[outcome]) for outcome in (False, True)]
            usual[place] = counts[True] > counts[False]
            rare |= dict.fromkeys(outcomes_in[name][place, not usual[place]])
        places = {place: (number[True], number[False]) for place, number in total[name].items()}
        usage[name] = Asked(reads[name], sum(map(sum, places.values())), places, usual, tuple(read_in[name]),
                            tuple(rare))
    return usage


def moves_of(ledgers: Iterable[Mapping[str, Any]]) -> dict[str, Counter]:
    """{move: how often it was asked, applied, accepted, …} and in how many worlds it was applied and accepted."""
    numbers: dict[str, Counter] = defaultdict(Counter)
    for ledger in ledgers:
        for name, number in ledger["moves"].items():
            numbers[name] += Counter(number)
            numbers[name]["worlds applied"] += number.get("applied", 0) > 0
            numbers[name]["worlds accepted"] += number.get("accepted", 0) > number.get("without effect", 0)
    return dict(numbers)


def largest_share_unseen(n: int, confidence: float = CONFIDENCE) -> float:
    """The share of worlds in which something may decide that decided in none of n: (1 - p)^n = 1 - confidence."""
    return 1.0 - (1.0 - confidence) ** (1.0 / n)


def ledgers(out: Path) -> dict[str, dict[str, Any]]:
    """Traces of the worlds in a folder."""
    return {path.parent.name: json.loads(path.read_text(encoding="utf-8"))["ledger"]
            for path in sorted(out.glob("*/trace.json"))}


def ledgers_of_tests(out: Path) -> dict[str, dict[str, Any]]:
    """Traces of tests in a folder (`tested`), as those of worlds."""
    return {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in sorted(out.glob("tests/*.json"))}


def decisions(path: Path = DECISIONS) -> dict[str, tuple[str, str]]:
    """{constant or move: (decision, reason)}."""
    with path.open(encoding="utf-8", newline="") as file:
        return {row["name"]: (row["decision"], row["reason"]) for row in csv.DictReader(file)}


def changed(complete: Mapping[str, Any], reduced: Mapping[str, Any]) -> list[str]:
    """Measures of the blind trial that differ between two answers to one world."""
    return [name for name in MEASURES if complete[name] != reduced[name]]


def tried_without(out: Path) -> dict[str, dict[str, list[str]]]:
    """{constant, move or CONSTANT=NUMBER: {world: measures that differ}}."""
    changes: dict[str, dict[str, list[str]]] = defaultdict(dict)
    for path in sorted(out.glob("without/*/*.json")):
        changes[path.parent.name][path.stem] = changed(_record(out / path.stem / "trace.json"), _record(path))
    return dict(changes)


def _record(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8"))["record"]


def write_table(out: Path) -> Path:
    """Write `TABLE` from the traces in a folder and from `DECISIONS`."""
    TABLE.write_text(table_text(out), encoding="utf-8")
    return TABLE


def table_text(out: Path) -> str:
    """The table in Markdown."""
    worlds, tried, decided = ledgers(out), tried_without(out), decisions()
    usage, in_tests, listed = asked_of(worlds), asked_of(ledgers_of_tests(out)), list(constants())
    number = Counter(usage.get(constant.name, Asked()).status for constant in listed)
    lines = ["# Ablation of the diagnosis", "",
             "`python -m idic_studies.ablation table OUT` writes this page; `sample`, `trace` and `without` make OUT.",
             "",
             f"{len(worlds)} drawn worlds. What decided in none of them decides, with 95 % confidence, in fewer than "
             f"{100 * largest_share_unseen(len(worlds)):.0f} % of such worlds.", "",
             f"{len(listed)} constants: {number[NOT_READ]} are not read, {number[ONE_OUTCOME]} are compared with one "
             f"outcome at every place, {number[DECIDES]} decide, {number[VALUE]} are values that nothing is compared "
             "with (grids, probes, priors, tolerances of a search). Going without those of the first two kinds changes "
             "no answer to these worlds.", "",
             "Column \"in tests\": the same of the default tests in tests/diagnose that were traced (`tested.py`). A "
             "constant that decides there has its recording there.", "",
             *_worlds(out, list(worlds)), *_moves(worlds.values(), tried, decided),
             *_constants(listed, usage, in_tests, tried, decided)]
    return "\n".join(lines) + "\n"


def _worlds(out: Path, names: Sequence[str]) -> list[str]:
    records = {name: _record(out / name / "trace.json") for name in names}
    cells = [(name, record["verdict"], ", ".join(record["reported"]), _yes(record["alarm"]),
              _yes(record["false_physics"]), _yes(record["inside"])) for name, record in records.items()]
    return _lines("The sample", ("world", "verdict", "reported", "alarm", "false physics", "cause in the set"), cells)


def _yes(value: bool) -> str:
    return "yes" if value else "–"


def _moves(worlds: Iterable[Mapping[str, Any]], tried: Mapping, decided: Mapping) -> list[str]:
    cells = [(name, str(number["asked"]), str(number["applied"]), str(number["accepted"]),
              f"{number['worlds applied']}, {number['worlds accepted']}", *_decision(name, tried, decided))
             for name, number in moves_of(worlds).items()]
    return _lines("Moves of the selection", ("move", "asked", "applied", "accepted", "worlds applied, accepted",
                                             "without it", "decision"), cells)


def _constants(listed: Sequence[Constant], usage: Mapping[str, Asked], in_tests: Mapping[str, Asked], tried: Mapping,
               decided: Mapping) -> list[str]:
    cells = []
    for constant in listed:
        answer = usage.get(constant.name, Asked())
        cells.append((constant.name, constant.value, constant.bounds, answer.status, str(answer.compared),
                      f"{len(answer.worlds)}, {len(answer.minority)}", in_tests.get(constant.name, Asked()).status,
                      *_decision(constant.name, tried, decided)))
    names = {constant.name for constant in listed}
    cells += [(name, *[""] * 6, *_decision(name, tried, decided)) for name, (decision, _) in decided.items()
              if decision == "gone" and name not in names]
    return _lines("Constants", ("constant", "value", "bounds", "status", "compared", "worlds read, decided",
                                "in tests", "without it", "decision"), cells)


def _decision(name: str, tried: Mapping[str, Mapping[str, Sequence[str]]],
              decided: Mapping[str, tuple[str, str]]) -> tuple[str, str]:
    """What changed without something, in words; what is done with it, and why."""
    changes = [f"{key.partition('=')[2]}{': ' if '=' in key else ''}{_changes(worlds)}"
               for key, worlds in tried.items() if key.partition("=")[0] == name]
    decision, reason = decided.get(name, ("stays", ""))
    return "; ".join(changes), f"{decision}: {reason}" if reason else decision


def _changes(worlds: Mapping[str, Sequence[str]]) -> str:
    differing = {world: measures for world, measures in worlds.items() if measures}
    words = "; ".join(f"{world}: {', '.join(measures)}" for world, measures in differing.items())
    return f"{len(differing)} of {len(worlds)} answers change{f' ({words})' if words else ''}"


def _lines(title: str, heads: Sequence[str], cells: Iterable[Sequence[str]]) -> list[str]:
    """A section with a table."""
    body = ["| " + " | ".join(cell.replace("|", "/") for cell in row) + " |" for row in cells]
    return [f"## {title}", "", "| " + " | ".join(heads) + " |", "|" + "---|" * len(heads), *body, ""]
