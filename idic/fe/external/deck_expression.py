"""Arithmetic with names, for the places of a deck: ``SPECIMEN.yield_stress + 0.5 * SPECIMEN.hardening_modulus``.

Numbers, names, ``+ - * / **``, parentheses, ``exp``, ``log``, ``sqrt``: parsed and computed here, nothing is executed.
Names may hold dots, brackets and hyphens (``SET-1.E``), so that a minus between two names needs a space before it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

_TOKEN = re.compile(r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_](?:[\w.\[\]]|-(?=\w))*)"
                    r"|(?P<sign>\*\*|[-+*/()]))")
FUNCTIONS = {"exp": math.exp, "log": math.log, "sqrt": math.sqrt}
_OPERATIONS = {"+": lambda a, b: a + b, "-": lambda a, b: a - b, "*": lambda a, b: a * b, "/": lambda a, b: a / b,
               "**": math.pow}
LONGEST = 400  # characters


@dataclass(frozen=True)
class Expression:
    """A parsed expression. tree : a number, a name, or (operation or function, argument, ...)."""

    tree: object
    names: frozenset[str]

    def value(self, values: Mapping[str, float | str]) -> float | str:
        """Its value; a text (a table) where it is the name of one.

        Raises
        ------
        ArithmeticError, ValueError
            Where it has none.
        """
        return _value(self.tree, values)


def parse_expression(text: str) -> Expression:
    """Raises ValueError, saying what is wrong."""
    if len(text) > LONGEST:
        raise ValueError(f"more than {LONGEST} characters")
    tokens, position = [], 0
    text = text.rstrip()
    while position < len(text):
        match = _TOKEN.match(text, position)
        if match is None:
            raise ValueError(f"{text[position:position + 10]!r} is not understood")
        tokens.append((match.lastgroup, match[match.lastgroup]))
        position = match.end()
    parser = _Parser(tokens)
    tree = parser.sum()
    if parser.rest:
        raise ValueError(f"{parser.rest[0][1]!r} is not expected there")
    return Expression(tree, frozenset(parser.names))


class _Parser:
    """Recursive descent: sum > product > signed > power > atom."""

    def __init__(self, tokens: list[tuple[str, str]]):
        self.rest = tokens
        self.names: set[str] = set()

    def _take(self, *signs: str) -> str | None:
        if self.rest and self.rest[0][0] == "sign" and self.rest[0][1] in signs:
            return self.rest.pop(0)[1]
        return None

    def sum(self):
        left = self._product()
        while sign := self._take("+", "-"):
            left = (sign, left, self._product())
        return left

    def _product(self):
        left = self._signed()
        while sign := self._take("*", "/"):
            left = (sign, left, self._signed())
        return left

    def _signed(self):
        if sign := self._take("+", "-"):
            return (sign, 0.0, self._signed())
        return self._power()

    def _power(self):
        base = self._atom()
        return ("**", base, self._signed()) if self._take("**") else base

    def _atom(self):
        if self._take("("):
            inside = self.sum()
            if not self._take(")"):
                raise ValueError("a parenthesis is not closed")
            return inside
        if not self.rest or self.rest[0][0] == "sign":
            raise ValueError("a number or a name is missing" + (f" before {self.rest[0][1]!r}" if self.rest else ""))
        kind, text = self.rest.pop(0)
        if kind == "number":
            return float(text)
        if text in FUNCTIONS:
            if not (self.rest and self.rest[0][1] == "("):
                raise ValueError(f"{text} without parentheses")
            return (text, self._atom())
        self.names.add(text)
        return text


def _value(tree, values: Mapping[str, float | str]):
    if isinstance(tree, str):
        return values[tree]
    if isinstance(tree, float):
        return tree
    head, *arguments = tree
    numbers = [_value(argument, values) for argument in arguments]
    if any(isinstance(number, str) for number in numbers):
        raise ValueError("a table is no number")
    return FUNCTIONS[head](*numbers) if head in FUNCTIONS else _OPERATIONS[head](*numbers)
