"""What a call in a source file calls, by its dotted name; `ast.unparse` says the same, thirty times as slowly."""

from __future__ import annotations

import ast


def called(node: ast.Call) -> str:
    """``a.b.c`` of ``a.b.c(...)``; "" where something else than a name is called."""
    parts, function = [], node.func
    while isinstance(function, ast.Attribute):
        parts.append(function.attr)
        function = function.value
    if not isinstance(function, ast.Name):
        return ""
    return ".".join([function.id, *reversed(parts)])
