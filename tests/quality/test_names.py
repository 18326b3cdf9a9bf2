"""A binding is a noun: bare pronouns, participles and adverbs say nothing about the value that they name."""

from __future__ import annotations

import ast
import re
from collections import Counter
from functools import cache
from pathlib import Path

from quality.sources import modules

BANNED = {  # as the whole name of a value; the noun is the residual, the candidate, the frame …
    "found", "own", "one", "told", "left", "before", "after", "said", "given", "shown", "seen", "here", "there", "now",
    "then", "this", "that", "those", "these", "it", "its", "them", "they", "others", "other", "another", "both", "each",
    "some", "such", "same", "rest", "whole", "far", "near", "known", "taken", "made", "held", "kept", "asked", "wanted",
    "sought", "stated", "meant", "done", "gone", "alone", "apart", "again", "also", "already", "always", "enough",
    "further", "beside", "behind", "ours", "theirs", "mine", "what", "which", "who", "why", "where", "how", "next",
    "last", "old", "new", "present", "absent", "free", "fixed",
}
# Bindings of these names, by room; a number only goes down. The bar is 1 % of all bindings.
MOST = {
    "idic.correlation": 1, "idic.diagnose": 10, "idic.draw": 1, "idic.errors": 4, "idic.experiment_file": 4,
    "idic.identification": 1, "idic.model": 1, "idic.notebook": 1, "idic.parameters": 1, "idic.report": 1,
    "idic.run": 10, "idic_studies": 22,
}


@cache
def bindings(file: Path) -> Counter:
    """How often each name is bound in a file: assignments, loops, parameters, imports under another name."""
    names: Counter = Counter()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names[node.id] += 1
        elif isinstance(node, ast.arg):
            names[node.arg] += 1
        elif isinstance(node, ast.alias) and node.asname:
            names[node.asname] += 1
        elif isinstance(node, ast.ExceptHandler) and node.name:
            names[node.name] += 1
    return names


def by_room() -> tuple[Counter, Counter]:
    """Banned and all bindings of each room."""
    banned, total = Counter(), Counter()
    for name, file in modules().items():
        room = ".".join(name.split(".")[:2]) if name.startswith("idic.") else name.split(".")[0]
        for binding, number in bindings(file).items():
            total[room] += number
            banned[room] += number if binding in BANNED else 0
    return banned, total


def test_bindings_are_nouns():
    banned, _ = by_room()
    more = {room: number for room, number in banned.items() if number > MOST.get(room, 0)}
    assert not more, f"name the thing (found, own, one … say nothing): {more}; most: {MOST}"


def test_the_rule_sees_every_kind_of_binding(tmp_path):
    file = tmp_path / "code.py"
    file.write_text("def f(own):\n    for one in own:\n        found = one\n    a, left = 1, 2\n"
                    "try:\n    pass\nexcept ValueError as told:\n    pass\n")
    assert {name for name in bindings(file) if name in BANNED} == {"own", "one", "found", "left", "told"}


def test_dotted_names_in_docstrings_exist():
    """`idic.room.name` in the words of a module is a module, or what it binds; a rename leaves no former name."""
    former = [(module, name) for module, file in modules().items()
              for name in re.findall(r"`(idic\.[a-z_]+\.[A-Za-z_.]+)`", file.read_text(encoding="utf-8"))
              if not _exists(name)]
    assert not former, "\n".join(map(str, former))


def _exists(name: str) -> bool:
    """Whether a dotted name is one of a module, followed by a name that its file defines."""
    parts = name.split(".")
    for number in range(len(parts), 1, -1):
        if (file := modules().get(".".join(parts[:number]))) is not None:
            return set(parts[number:number + 1]) <= _defined(file)
    return False


@cache
def _defined(file: Path) -> frozenset[str]:
    """Names that a file binds, and those on its door."""
    names = set(bindings(file))
    for source in (file, file.with_suffix(".pyi")):
        for node in ast.walk(ast.parse(source.read_text(encoding="utf-8") if source.exists() else "")):
            if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.alias):
                names.add(node.name)
    return frozenset(names)
