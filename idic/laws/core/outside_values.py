"""What a compiled function takes from outside of itself: helpers, constants and tables, which machine code freezes."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

LIBRARIES = ("idic", "numpy", "numba", "math", "cmath", "builtins")  # they change with their version alone


def outside_values(function: Callable) -> str:
    """sha256 of the helpers and global values that a function uses, of theirs too; empty where there are none.

    Numba compiles an array or a number of a module into the function, and so the function of another file; it takes
    its machine code from the disk until the file of the function itself changes.
    """
    visited: set[int] = set()
    plain: FunctionType = getattr(function, "py_func", function)  # type: ignore[arg-type]
    parts = list(_used(plain, visited))
    return hashlib.sha256("\n".join(parts).encode()).hexdigest() if parts else ""


def code_of(function: Callable) -> str:
    """sha256 of the code of a function, of its helpers, and of the constants and tables that they use."""
    plain = getattr(function, "py_func", function)
    return hashlib.sha256(f"{_text(plain.__code__)} {outside_values(plain)}".encode()).hexdigest()


def _used(function: FunctionType, visited: set[int]) -> Iterator[str]:
    visited.add(id(function))
    names = sorted(_names(function.__code__))
    for name in names:
        if name in function.__globals__:
            yield from _described(name, function.__globals__[name], names, visited)
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        yield from _described(name, cell.cell_contents, names, visited)


def _described(name: str, value: Any, names: list[str], visited: set[int]) -> Iterator[str]:
    value = getattr(value, "py_func", value)
    if _library(value):
        return
    if isinstance(value, ModuleType):
        for attribute in names:
            if hasattr(value, attribute):
                yield from _described(f"{name}.{attribute}", getattr(value, attribute), names, visited)
    elif isinstance(value, FunctionType):
        if id(value) not in visited:
            yield f"{name} {_text(value.__code__)} {_text(value.__defaults__)}"
            yield from _used(value, visited)
    elif isinstance(value, (list, tuple)):
        yield f"{name} {len(value)}"
        for k, entry in enumerate(value):
            yield from _described(f"{name}[{k}]", entry, names, visited)
    else:
        yield f"{name} {_text(value)}"


def _text(value: Any) -> str:
    """The same in every process: no address, no order of a set."""
    if isinstance(value, CodeType):
        return f"{value.co_code.hex()} {value.co_names} {_text(value.co_consts)}"
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()}"
    if isinstance(value, tuple):
        return f"({', '.join(map(_text, value))})"
    if isinstance(value, frozenset):
        return f"{{{', '.join(sorted(map(_text, value)))}}}"
    is_plain = isinstance(value, (bool, int, float, complex, str, bytes, np.generic, type(None)))
    return repr(value) if is_plain else type(value).__name__


def _library(value: Any) -> bool:
    module = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None)
    return isinstance(module, str) and module.partition(".")[0] in LIBRARIES


def _names(code: CodeType) -> set[str]:
    inner = (constant for constant in code.co_consts if isinstance(constant, CodeType))
    return set(code.co_names).union(*(_names(constant) for constant in inner))
