"""Plain tables to TOML text, for experiment files that the program itself writes."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def to_toml(tables: Mapping) -> str:
    """TOML text of nested mappings, lists, text, numbers and truth values.

    Tables of the first two levels get headers ``[a]`` and ``[a.b]``, lists of tables ``[[a]]``; deeper ones are inline.
    """
    lines: list[str] = []
    _table(lines, (), tables, depth=2)
    return "\n".join(lines).lstrip("\n") + "\n"


def _table(lines: list[str], path: tuple[str, ...], table: Mapping, depth: int) -> None:
    later = []
    for key, value in table.items():
        if depth and isinstance(value, Mapping) and (len(path) == 0 or _only_tables(table)):
            later.append((key, value))
        elif depth and not path and _is_tables(value):
            later.append((key, value))
        else:
            lines.append(f"{_key(key)} = {_value(value)}")
    for key, value in later:
        name = ".".join(map(_key, (*path, key)))
        if isinstance(value, Mapping) and value and _only_tables(value) and depth > 1:
            _table(lines, (*path, key), value, depth - 1)
        elif isinstance(value, Mapping):
            lines.append(f"\n[{name}]")
            _table(lines, (*path, key), value, 0)
        else:
            for entry in value:
                lines.append(f"\n[[{name}]]")
                _table(lines, (*path, key), entry, 0)


def _only_tables(table: Mapping) -> bool:
    return all(isinstance(value, Mapping) for value in table.values())


def _is_tables(value: object) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(entry, Mapping) for entry in value)


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else json.dumps(key, ensure_ascii=False)


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, float):
        if math.isnan(value):
            return "nan"
        return repr(value) if math.isfinite(value) else ("inf" if value > 0 else "-inf")
    if isinstance(value, int):
        return str(value)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items()) + " }" if value else "{}"
    if isinstance(value, Sequence):
        return "[" + ", ".join(map(_value, value)) + "]"
    raise TypeError(f"no TOML for {type(value).__name__}")
