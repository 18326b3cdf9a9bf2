"""Every named number of the diagnosis, what it bounds, and where it is read."""

from __future__ import annotations

import ast
import io
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import idic

ROOM = "diagnose"


@dataclass(frozen=True)
class Constant:
    """A named number, or a tuple of them.

    name : from the room on, with dots; file : from `idic` on; bounds : its comment
    """

    name: str
    file: str
    line: int
    value: str
    bounds: str

    @property
    def of_catalogue(self) -> bool:
        """Whether it belongs to one candidate: its probe, its grid."""
        return self.name.startswith("candidates.")


def constants(root: Path | None = None) -> Iterator[Constant]:
    """The constants of a package in the order of its files; root : of the package, idic by default."""
    root = Path(idic.__file__).parent if root is None else root
    for path in sorted((root / ROOM).rglob("*.py")):
        module = ".".join(path.relative_to(root / ROOM).with_suffix("").parts)
        yield from _of_module(path.read_text(encoding="utf-8"), module, path.relative_to(root.parent).as_posix())


def _of_module(text: str, module: str, file: str) -> Iterator[Constant]:
    comments = {token.start[0]: token.string.lstrip("# ") for token in
                tokenize.generate_tokens(io.StringIO(text).readline) if token.type == tokenize.COMMENT}
    for statement in ast.parse(text).body:
        for name, value in _assigned(statement):
            if name.isupper() and is_number(value):
                comment = comments.get(statement.lineno) or _above(text.splitlines(), statement.lineno)
                yield Constant(f"{module}.{name}", file, statement.lineno, ast.unparse(value), comment)


def _assigned(statement: ast.stmt) -> Iterator[tuple[str, ast.expr]]:
    if isinstance(statement, ast.AnnAssign) and statement.value is not None and isinstance(statement.target, ast.Name):
        yield statement.target.id, statement.value
    if not isinstance(statement, ast.Assign):
        return
    for target in statement.targets:
        if isinstance(target, ast.Name):
            yield target.id, statement.value
        elif isinstance(target, ast.Tuple) and isinstance(statement.value, ast.Tuple):
            yield from ((leaf.id, value) for leaf, value in zip(target.elts, statement.value.elts, strict=True)
                        if isinstance(leaf, ast.Name))


def is_number(value: ast.expr) -> bool:
    """Whether an expression is a number, or a tuple of numbers, of literals and other constants."""
    leaves = [node for node in ast.walk(value) if isinstance(node, ast.Constant | ast.Name)]
    is_tuple_of_names = isinstance(value, ast.Tuple) and all(isinstance(node, ast.Name) for node in leaves)
    return bool(leaves) and not is_tuple_of_names and all(
        isinstance(node, ast.Constant | ast.Name | ast.BinOp | ast.UnaryOp | ast.Tuple | ast.operator | ast.unaryop
                   | ast.expr_context) for node in ast.walk(value)) and all(
        node.id.isupper() if isinstance(node, ast.Name) else
        isinstance(node.value, int | float) and not isinstance(node.value, bool) for node in leaves)


def _above(lines: list[str], line: int) -> str:
    """The comment over a line (from 1)."""
    first = line - 1
    while first and lines[first - 1].startswith("#"):
        first -= 1
    return " ".join(text.lstrip("# ") for text in lines[first:line - 1])
