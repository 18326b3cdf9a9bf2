"""The trace of a diagnosis: which constants were asked, which comparisons they decided, what was never entered.

`traced` installs an import hook for the modules of `idic.diagnose`. The product is not changed: the hook rewrites the
syntax tree of a module while it is imported, so it is installed before the first import of that room.

* Reading an upper-case number gives a `TracedFloat` or `TracedInt`: a number with the same bits that carries the name
  of its constant through arithmetic, and reports every comparison in which it takes part, minima and maxima included.
* Functions, conditions and moves report as well.

An `Omission` answers the comparisons of one constant with one outcome, gives a constant another value, or leaves a move
out.
"""

from __future__ import annotations

import ast
import importlib.abc
import importlib.machinery
import operator
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import numpy as np

ROOM = "idic.diagnose"
MOVES = f"{ROOM}.selection.move"
COMPARISONS = {"less": operator.lt, "less_equal": operator.le, "greater": operator.gt, "greater_equal": operator.ge,
               "equal": operator.eq, "not_equal": operator.ne}
BOUNDS = ("minimum", "maximum", "clip", "fmin", "fmax")
ARITHMETIC = ("add", "sub", "mul", "truediv", "floordiv", "mod", "pow")


@dataclass(frozen=True)
class Omission:
    """What a diagnosis goes without.

    outcomes : {(constant, place): outcome} of comparisons; values : {constant: value}; moves : names
    """

    outcomes: Mapping[tuple[str, str], bool] = field(default_factory=dict)
    values: Mapping[str, float] = field(default_factory=dict)
    moves: tuple[str, ...] = ()


@dataclass(eq=False)
class Ledger:
    """What happened. Keys are joined with blanks, so that a ledger is JSON.

    reads : CONSTANT PLACE; outcomes : CONSTANT PLACE OUTCOME; conditions : PLACE OUTCOME; calls : FUNCTION
    moves : {move: Counter of "asked", "applied", "failed", "refused", "accepted"}
    """

    omission: Omission = field(default_factory=Omission)
    reads: Counter = field(default_factory=Counter)
    outcomes: Counter = field(default_factory=Counter)
    conditions: Counter = field(default_factory=Counter)
    calls: Counter = field(default_factory=Counter)
    moves: dict[str, Counter] = field(default_factory=dict)

    def read(self, name: str, place: str, value: Any) -> Any:
        """The value of a constant, with its name."""
        self.reads[f"{name} {place}"] += 1
        return as_traced(self.omission.values.get(name, value), frozenset([name]) | names_of(value), self)

    def condition(self, place: str, value: Any) -> Any:
        """A tested value, which is returned as it is."""
        self.conditions[f"{place} {bool(value)}"] += 1
        return value

    def call(self, function: str) -> None:
        """A function was entered."""
        self.calls[function] += 1

    def compared(self, names: Iterable[str], outcome: Any) -> Any:
        """The outcome of a comparison, or what an omission puts in its place."""
        place = place_of_caller()
        for name in names:
            forced = self.omission.outcomes.get((name, place))
            if forced is not None:
                outcome = np.full_like(outcome, forced) if isinstance(outcome, np.ndarray) else forced
            n_true, n = int(np.count_nonzero(outcome)), int(np.size(outcome))
            self.outcomes[f"{name} {place} True"] += n_true
            self.outcomes[f"{name} {place} False"] += n - n_true
        return outcome

    @property
    def content(self) -> dict:
        """As JSON."""
        return {"reads": dict(self.reads), "outcomes": {key: n for key, n in self.outcomes.items() if n},
                "conditions": dict(self.conditions), "calls": dict(self.calls),
                "moves": {name: dict(number) for name, number in self.moves.items()}}


def place_of_caller() -> str:
    """File and line outside this module and NumPy."""
    frame = sys._getframe(1)
    while frame.f_back is not None and (frame.f_code.co_filename == __file__
                                        or "/numpy/" in frame.f_code.co_filename):
        frame = frame.f_back
    return f"{as_place(frame.f_code.co_filename)}:{frame.f_lineno}"


def as_place(file: str) -> str:
    """The path of a file of the package from its root on."""
    parts = Path(file).parts
    return "/".join(parts[parts.index("idic"):]) if "idic" in parts else file


def names_of(*values: Any) -> frozenset[str]:
    """Constants that some values depend on."""
    return frozenset().union(*(value.names for value in values if isinstance(value, TracedFloat | TracedInt)))


def plain(value: Any) -> Any:
    """A number without its names."""
    return float(value) if isinstance(value, TracedFloat) else int(value) if isinstance(value, TracedInt) else value


def as_traced(value: Any, names: frozenset[str], ledger: Ledger) -> Any:
    """A number that carries names; anything else as it is."""
    if isinstance(value, bool | np.bool_) or not names:
        return value
    if isinstance(value, int | np.integer):
        traced: Any = TracedInt(value)
    elif isinstance(value, float | np.floating):
        traced = TracedFloat(value)
    else:
        return value
    traced.names, traced.ledger = names, ledger
    return traced


class Traced:
    """Arithmetic and comparisons of a number that carries names."""

    names: frozenset[str]
    ledger: Ledger

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **more: Any) -> Any:
        names = names_of(*inputs)
        outcome = getattr(ufunc, method)(*map(plain, inputs), **more)
        if method != "__call__":
            return outcome
        if ufunc.__name__ in COMPARISONS:
            return self.ledger.compared(names, outcome)
        if ufunc.__name__ in BOUNDS:
            self.ledger.compared(names, np.asarray(outcome != plain(inputs[0])) if not isinstance(inputs[0], Traced)
                                 else np.asarray(outcome != plain(inputs[1])))
        return as_traced(outcome, names, self.ledger)


def _compare(symbol: Callable) -> Callable:
    def compare(self: Any, operand: Any) -> Any:
        if not isinstance(operand, int | float | np.number):
            return NotImplemented
        return self.ledger.compared(names_of(self, operand), symbol(plain(self), plain(operand)))

    return compare


def _combine(symbol: Callable, is_reflected: bool) -> Callable:
    def combine(self: Any, operand: Any) -> Any:
        if not isinstance(operand, int | float | np.number):
            return NotImplemented
        first, second = (plain(operand), plain(self)) if is_reflected else (plain(self), plain(operand))
        return as_traced(symbol(first, second), names_of(self, operand), self.ledger)

    return combine


def _one(symbol: Callable) -> Callable:
    return lambda self: as_traced(symbol(plain(self)), self.names, self.ledger)


OPERATORS: dict[str, Any] = {f"__{symbol.__name__}__": _compare(symbol) for symbol in COMPARISONS.values()}
OPERATORS |= {f"__{name}__": _combine(getattr(operator, name), False) for name in ARITHMETIC}
OPERATORS |= {f"__r{name}__": _combine(getattr(operator, name), True) for name in ARITHMETIC}
OPERATORS |= {"__neg__": _one(operator.neg), "__abs__": _one(operator.abs)}
TracedFloat: Any = type("TracedFloat", (Traced, float), OPERATORS | {"__hash__": float.__hash__})
TracedInt: Any = type("TracedInt", (Traced, int), OPERATORS | {"__hash__": int.__hash__})


class Rewriting(ast.NodeTransformer):
    """Calls of the ledger `ledger__` in the syntax tree of a module; constants : {local name: full name}"""

    def __init__(self, place: str, module: str, constants: Mapping[str, str]):
        self.place, self.constants, self.scope = place, constants, [module.removeprefix(f"{ROOM}.")]

    def visit_Name(self, node: ast.Name) -> ast.AST:
        if node.id not in self.constants or not isinstance(node.ctx, ast.Load):
            return node
        return self._call(node, "read", self.constants[node.id], f"{self.place}:{node.lineno}", node)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        self.scope.append(node.name)
        name = ".".join(self.scope)
        self.generic_visit(node)
        self.scope.pop()
        entry = ast.Expr(self._call(node, "call", name))
        node.body.insert(1 if ast.get_docstring(node) is not None else 0, ast.copy_location(entry, node.body[0]))
        return node

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:
        self.scope.append(node.name)
        self.generic_visit(node)
        self.scope.pop()
        return node

    def _tested(self, node: ast.expr) -> ast.expr:
        return self._call(node, "condition", f"{self.place}:{node.lineno}:{node.col_offset}", node)

    def visit_If(self, node: ast.If) -> ast.AST:
        self.generic_visit(node)
        node.test = self._tested(node.test)
        return node

    def visit_IfExp(self, node: ast.IfExp) -> ast.AST:
        self.generic_visit(node)
        node.test = self._tested(node.test)
        return node

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.AST:
        self.generic_visit(node)
        node.values = [*(self._tested(value) for value in node.values[:-1]), node.values[-1]]
        return node

    def visit_comprehension(self, node: ast.comprehension) -> ast.AST:
        self.generic_visit(node)
        node.ifs = [self._tested(test) for test in node.ifs]
        return node

    def _call(self, node: ast.AST, method: str, *arguments: Any) -> ast.Call:
        nodes = [argument if isinstance(argument, ast.AST) else ast.Constant(argument) for argument in arguments]
        called = ast.Attribute(ast.Name("ledger__", ast.Load()), method, ast.Load())
        return ast.fix_missing_locations(ast.copy_location(ast.Call(called, nodes, []), node))


def constants_of(tree: ast.Module, module: str) -> dict[str, str]:
    """{local name: MODULE.NAME, from `ROOM` on} of the upper-case names that a module defines or imports from it."""
    names = {}
    for statement in tree.body:
        if isinstance(statement, ast.ImportFrom) and statement.module and statement.module.startswith(f"{ROOM}."):
            origin = statement.module.removeprefix(f"{ROOM}.")
            names |= {a.asname or a.name: f"{origin}.{a.name}" for a in statement.names if a.name.isupper()}
        targets = statement.targets if isinstance(statement, ast.Assign) else (
            [statement.target] if isinstance(statement, ast.AnnAssign) else [])
        for target in targets:
            for leaf in (target.elts if isinstance(target, ast.Tuple) else [target]):
                if isinstance(leaf, ast.Name) and leaf.id.isupper():
                    names[leaf.id] = f"{module.removeprefix(f'{ROOM}.')}.{leaf.id}"
    return names


class Loader(importlib.machinery.SourceFileLoader):
    """Loads a module of the room with calls of a ledger."""

    ledger: Ledger

    def get_code(self, fullname: str) -> CodeType:
        """The rewritten module; never the stored one."""
        source, path = self.get_data(self.path), self.path
        tree = ast.parse(source, path)
        rewritten = Rewriting(as_place(path), fullname, constants_of(tree, fullname)).visit(tree)
        return compile(ast.fix_missing_locations(rewritten), path, "exec")

    def exec_module(self, module: ModuleType) -> None:
        """Execute it; the loop over moves takes traced moves."""
        vars(module)["ledger__"] = self.ledger
        super().exec_module(module)
        if module.__name__ == MOVES:
            vars(module)["moved"] = traced_loop(vars(module)["moved"], self.ledger)


class Finder(importlib.abc.MetaPathFinder):
    """Finds the modules of the room."""

    def __init__(self, ledger: Ledger):
        self.ledger = ledger

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> Any:
        """The usual place of a module, with another loader."""
        if not fullname.startswith(f"{ROOM}."):
            return None
        spec = importlib.machinery.PathFinder.find_spec(fullname, path, target)
        if spec is not None and type(spec.loader) is importlib.machinery.SourceFileLoader:
            loader = Loader(fullname, str(spec.origin))
            loader.ledger = self.ledger
            spec.loader, spec.cached = loader, None
        return spec


def traced(omission: Omission = Omission()) -> Ledger:
    """A ledger of all diagnoses in this process from now on.

    Raises
    ------
    RuntimeError
        If a module of the room has been imported.
    """
    early = [name for name in sys.modules if name.startswith(f"{ROOM}.")]
    if early:
        raise RuntimeError(f"{early[0]} has been imported before the trace began")
    ledger = Ledger(omission)
    sys.meta_path.insert(0, Finder(ledger))
    return ledger


def traced_loop(moved: Callable, ledger: Ledger) -> Callable:
    """The loop over moves with moves that report."""
    def loop(state: Any, moves: Iterable[Any]) -> Any:
        return moved(state, [traced_move(move, ledger) for move in moves])

    return loop


def traced_move(move: Any, ledger: Ledger) -> Any:
    """A move that reports."""
    number = ledger.moves.setdefault(move.name, Counter())

    def applies(state: Any) -> bool:
        number["asked"] += 1
        return move.name not in ledger.omission.moves and move.applies(state)

    def edit(state: Any) -> Any:
        number["applied"] += 1
        tried = move.edit(state)
        number["failed"] += tried is None
        number["without effect"] += tried is not None and tried is state
        return tried

    def accept(state: Any, tried: Any) -> bool:
        is_accepted = bool(move.accept(state, tried))
        number["accepted" if is_accepted else "refused"] += 1
        return is_accepted

    return replace(move, applies=applies, edit=edit, accept=accept)
