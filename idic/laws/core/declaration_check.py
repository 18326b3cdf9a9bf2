"""What is refused when a law is declared: arguments, names and values that do not fit together."""

from __future__ import annotations

import inspect
import re
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

KEYS_OF_A_MATERIAL = ("law", "kinematics", "smoothness", "from")  # of [material.SET], which are no parameters
ARGUMENTS = {
    "update": ("F", "state", "params", "dt", "P", "state_new"),
    "linearise": ("F", "state", "params", "dt", "dF", "dstate", "dparams", "P", "state_new", "dP", "dstate_new"),
}
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
_COMPOSED_NAME = re.compile(rf"{_NAME.pattern}(\(.*\))?")


def check_declaration(spec: Any) -> None:
    """Refuse a `LawSpec` that no experiment can use.

    Raises
    ------
    ValueError
        Names that are taken twice or that experiment.toml cannot hold, values outside their bounds, functions with
        other arguments than `ARGUMENTS`.
    """
    def refuse(fault: str):
        raise ValueError(f"law {spec.name}: {fault}")

    if not _COMPOSED_NAME.fullmatch(spec.name):
        refuse("a name has letters, digits, _ and -, and begins with a letter")
    for kind, names in (("parameter", spec.parameter_names), ("state variable", spec.state_names)):
        if twice := _twice(names):
            refuse(f"two {kind}s are named {twice}")
    for p in spec.parameters:
        if not _NAME.fullmatch(p.name):
            refuse(f"parameter {p.name!r}: a name has letters, digits, _ and -, and begins with a letter")
        if p.name in KEYS_OF_A_MATERIAL:
            refuse(f"{p.name} is a key of [material.SET]; give the parameter another name")
        low, high = p.bounds
        for word, value in (("default", p.default), ("null", p.null)):
            if value is not None and not low <= value <= high:
                refuse(f"{word} {value:g} of {p.name} is outside its bounds ({low:g}, {high:g})")
    for word, functions in (("update", spec.updates), ("linearise", spec.linearise)):
        for function in functions.values():
            if (n := n_arguments(function)) != len(ARGUMENTS[word]):
                refuse(f"{word} takes {len(ARGUMENTS[word])} arguments ({', '.join(ARGUMENTS[word])}); found {n}")


def n_arguments(function: Callable) -> int:
    """Positional arguments of a function, compiled or not."""
    plain = getattr(function, "py_func", function)
    return sum(p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD) for p in inspect.signature(plain).parameters
               .values())


def _twice(names: Iterable[str]) -> str | None:
    return next((name for name, count in Counter(names).items() if count > 1), None)
