"""Sets by position: comparisons of x, y, z joined by and/or/not. Parsed against a whitelist; nothing is evaluated."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping

import numpy as np

from idic.errors import InputError

_COMPARE: dict[type, Callable] = {ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge}
_BINARY: dict[type, Callable] = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul,
                                 ast.Div: operator.truediv}
_FUNCTIONS = {"abs": np.abs, "sqrt": np.sqrt}
_EXAMPLE = 'comparisons of x, y, z joined by and/or, e.g. "y < -9.9" or "abs(x) < 1e-6 and y > 0"'
_MAX_LENGTH, _MAX_POWER = 2000, 4.0


def where(expression: str, points: np.ndarray, *, file=None, key=None) -> np.ndarray:
    """Which points satisfy the expression.

    Parameters
    ----------
    expression : str
        ``<  <=  >  >=`` between sums, products, powers, ``abs`` and ``sqrt`` of ``x, y, z`` and numbers,
        joined by ``and``, ``or``, ``not``.
    points : array (n, 2|3)
        Coordinates, in the unit that the expression is written in (the mesh unit).

    Returns
    -------
    inside : bool array (n,)

    Raises
    ------
    InputError
        Where it is not such an expression.
    """
    points = np.asarray(points, dtype=float)
    names = dict(zip("xyz", points.T, strict=False))
    try:
        if len(expression) > _MAX_LENGTH:
            raise _Refused(f"an expression of {len(expression)} characters")
        tree = ast.parse(expression.strip(), mode="eval")
        inside = np.broadcast_to(_logical(tree.body, names), points.shape[:1])
    except (_Refused, SyntaxError, ValueError, RecursionError, MemoryError) as error:
        reason = "no valid syntax" if isinstance(error, SyntaxError) else str(error)
        raise InputError("not a usable set by position", file=file, key=key, expected=_EXAMPLE,
                         found=f"{expression!r}: {reason}",
                         remedy="write the expression with x, y, z in the unit of the mesh") from None
    return np.array(inside)


class _Refused(Exception):
    pass


def _logical(node: ast.AST, names: Mapping[str, np.ndarray]) -> np.ndarray:
    if isinstance(node, ast.BoolOp):
        parts = [_logical(value, names) for value in node.values]
        return np.logical_and.reduce(parts) if isinstance(node.op, ast.And) else np.logical_or.reduce(parts)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        return ~_logical(node.operand, names)
    if isinstance(node, ast.Compare):
        values = [_number(part, names) for part in (node.left, *node.comparators)]
        result = np.bool_(True)
        for op, left, right in zip(node.ops, values, values[1:], strict=False):
            if type(op) not in _COMPARE:
                raise _Refused("only <, <=, >, >= compare (positions are never exactly equal)")
            result = result & _COMPARE[type(op)](left, right)
        return result
    raise _Refused("the whole must be a comparison")


def _number(node: ast.AST, names: Mapping[str, np.ndarray]) -> np.ndarray | float:
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return float(node.value)
    if isinstance(node, ast.Name):
        if node.id not in names:
            raise _Refused(f"{node.id} is none of {', '.join(names)}")
        return names[node.id]
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
        value = _number(node.operand, names)
        return -value if isinstance(node.op, ast.USub) else value
    if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
        with np.errstate(divide="ignore", invalid="ignore"):
            left, right = np.float64(_number(node.left, names)), np.float64(_number(node.right, names))
            return _BINARY[type(node.op)](left, right)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        power = _number(node.right, names)
        if not isinstance(power, float) or abs(power) > _MAX_POWER:
            raise _Refused(f"powers are numbers up to {_MAX_POWER:g}")
        return _number(node.left, names) ** power
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in _FUNCTIONS \
            and len(node.args) == 1 and not node.keywords:
        with np.errstate(invalid="ignore"):
            return _FUNCTIONS[node.func.id](_number(node.args[0], names))
    raise _Refused(f"{ast.unparse(node)} is not allowed")
