"""Sets by position: the points that satisfy comparisons of x, y, z joined by and, or, not."""

from __future__ import annotations

import numpy as np

from idic.errors import InputError
from idic.expressions import Grammar, parse_expression

POSITIONS = Grammar({"abs": np.abs, "sqrt": np.sqrt}, compares=True, max_length=2000, max_power=4.0)
_EXAMPLE = 'comparisons of x, y, z joined by and, or, not, e.g. "y < -9.9" or "abs(x) < 1e-6 and y > 0"'


def points_where(expression: str, points: np.ndarray, *, file=None, key=None) -> np.ndarray:
    """True for the points that satisfy the expression.

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
        The text is not a valid expression.
    """
    points = np.asarray(points, dtype=float)
    coordinates = dict(zip("xyz", points.T, strict=False))
    try:
        parsed = parse_expression(expression, POSITIONS)
        for name in sorted(parsed.names - set(coordinates)):
            raise ValueError(f"{name} is none of {', '.join(coordinates)}")
        with np.errstate(all="ignore"):
            inside = np.broadcast_to(parsed.value(coordinates), points.shape[:1])
    except (ValueError, ArithmeticError) as problem:
        raise InputError("not a usable set by position", file=file, key=key, expected=_EXAMPLE,
                         found=f"{expression!r}: {problem}",
                         remedy="write the expression with x, y, z in the unit of the mesh; compare by <, <=, >, >=, "
                                "never by ==") from None
    return np.array(inside)
