"""Expressions in texts of the user: arithmetic with names, and comparisons of it joined by and, or, not.

    SPECIMEN.yield_stress + 0.5 * SPECIMEN.hardening_modulus          a place in the deck of an external solver
    abs(x) < 1e-6 and not y > 0                                       a set of nodes by position

Parser and evaluator are written out here: nothing of the text is executed. A `Grammar` is the whitelist. The parser
turns a text into instructions for a stack; neither long nor deeply nested texts exhaust the evaluator.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

MAX_NESTING = 40  # parentheses, signs, powers and nots inside one another
PLAIN_NAME = r"[A-Za-z_]\w*"
_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_SIGNS = r"\*\*|<=|>=|[-+*/()<>]"
_COMPARISONS: dict[str, Callable] = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}
_ARITHMETIC: dict[str, Callable] = {"+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv}


@dataclass(frozen=True)
class Grammar:
    """What an expression may hold besides numbers, parentheses and ``+ - * / **``.

    Attributes
    ----------
    functions : {name: function of one number}
    name : regular expression of a name
    compares : True: a comparison (``<  <=  >  >=``), or several joined by ``and``, ``or``, ``not``; False: a number
    max_length : characters
    max_power : largest exponent, which is then a number; None: any exponent
    """

    functions: Mapping[str, Callable] = field(default_factory=dict)
    name: str = PLAIN_NAME
    compares: bool = False
    max_length: int = 400
    max_power: float | None = None


@dataclass(frozen=True)
class Expression:
    """A parsed expression: instructions for a stack, in order, and the names it uses.

    An instruction is ``("value", x)``, ``("name", name)``, ``(operator, n)`` with its number of operands,
    ``("call", function)`` or ``("compare", signs)``.
    """

    program: tuple[tuple[str, Any], ...]
    names: frozenset[str]
    grammar: Grammar

    def value(self, values: Mapping[str, float | str | np.ndarray]) -> float | str | np.ndarray:
        """The value for these values of the names: numbers, or arrays of one shape.

        A name may stand for a text; the value is that text if the name is the whole expression.

        Raises
        ------
        ArithmeticError, ValueError
            There is no value: division by zero, overflow, a root of a negative number, a text in a calculation.
        """
        stack: list = []
        for kind, argument in self.program:
            if kind == "value":
                stack.append(argument)
            elif kind == "name":
                stack.append(values[argument])
            else:
                n = len(argument) + 1 if kind == "compare" else 1 if kind == "call" else argument
                operands = stack[-n:]
                del stack[-n:]
                if any(isinstance(operand, str) for operand in operands):
                    raise ValueError("a table is no number")
                stack.append(self._computed(kind, argument, operands))
        return stack[0]

    def _computed(self, kind: str, argument, operands: list):
        if kind == "call":
            return self.grammar.functions[argument](operands[0])
        if kind == "compare":
            parts = [_COMPARISONS[sign](lower, upper)
                     for sign, lower, upper in zip(argument, operands, operands[1:], strict=False)]
            return np.logical_and.reduce(np.broadcast_arrays(*parts))
        if kind in ("and", "or"):
            join = np.logical_and if kind == "and" else np.logical_or
            return join.reduce(np.broadcast_arrays(*operands))
        if kind == "not":
            return np.logical_not(operands[0])
        if kind == "**":
            return self._power(*operands)
        return _ARITHMETIC[kind](*operands)

    def _power(self, base, exponent):
        limit = self.grammar.max_power
        if limit is not None and not (isinstance(exponent, float) and abs(exponent) <= limit):
            raise ValueError(f"exponents are numbers up to {limit:g}")
        return base**exponent if isinstance(base, np.ndarray) else math.pow(base, exponent)


def parse_expression(text: str, grammar: Grammar) -> Expression:
    """Parse a text.

    Raises
    ------
    ValueError
        The text is no expression of this grammar; the message says what is wrong and where.
    """
    if len(text) > grammar.max_length:
        raise ValueError(f"{len(text)} characters; at most {grammar.max_length} are read")
    parser = _Parser(_tokens(text, grammar), grammar)
    truth = parser.joined() if grammar.compares else parser.sum()
    if parser.rest:
        raise ValueError(f"{parser.rest[0][1]!r} is not expected there")
    if truth is not grammar.compares:
        raise ValueError("the whole must be a comparison" if grammar.compares else "the whole must be a number")
    return Expression(tuple(parser.program), frozenset(a for kind, a in parser.program if kind == "name"), grammar)


def _tokens(text: str, grammar: Grammar) -> list[tuple[str, str]]:
    pattern = re.compile(rf"\s*(?:(?P<number>{_NUMBER})|(?P<name>{grammar.name})|(?P<sign>{_SIGNS}))")
    tokens, position, text = [], 0, text.rstrip()
    while position < len(text):
        match = pattern.match(text, position)
        if match is None:
            raise ValueError(f"{text[position:position + 10]!r} is not understood")
        kind = str(match.lastgroup)  # one of the three groups has matched
        word = match[kind]
        tokens.append(("sign" if grammar.compares and word in ("and", "or", "not") else kind, word))
        position = match.end()
    return tokens


class _Parser:
    """Recursive descent: or > and > not > comparison > sum > product > signed > power > atom.

    Each method appends instructions to `program` and tells whether they leave a truth (True) or a number (False).
    """

    def __init__(self, tokens: list[tuple[str, str]], grammar: Grammar):
        self.rest = tokens
        self.grammar = grammar
        self.program: list[tuple[str, Any]] = []
        self.depth = 0

    def _take(self, *signs: str) -> str | None:
        if self.rest and self.rest[0][0] == "sign" and self.rest[0][1] in signs:
            return self.rest.pop(0)[1]
        return None

    def _deeper(self, method: Callable[[], bool]) -> bool:
        """What `method` parses, one level further inside."""
        self.depth += 1
        if self.depth > MAX_NESTING:
            raise ValueError(f"more than {MAX_NESTING} levels inside one another")
        truth = method()
        self.depth -= 1
        return truth

    def _number(self, truth: bool) -> None:
        if truth:
            raise ValueError("a comparison is no number")

    def joined(self) -> bool:
        return self._join("or", lambda: self._join("and", self._negated))

    def _join(self, word: str, part: Callable[[], bool]) -> bool:
        truth, n = part(), 1
        while self._take(word):
            truth = part() and truth
            n += 1
        if n > 1:
            if not truth:
                raise ValueError(f"{word!r} joins comparisons, not numbers")
            self.program.append((word, n))
        return truth

    def _negated(self) -> bool:
        if not self._take("not"):
            return self._comparison()
        if not self._deeper(self._negated):
            raise ValueError("'not' stands before a comparison, not before a number")
        self.program.append(("not", 1))
        return True

    def _comparison(self) -> bool:
        truth, signs = self.sum(), []
        while sign := self._take(*_COMPARISONS):
            self._number(truth)
            self._number(self.sum())
            signs.append(sign)
        if signs:
            self.program.append(("compare", tuple(signs)))
        return bool(signs) or truth

    def sum(self) -> bool:
        return self._chain(self._product, "+", "-")

    def _product(self) -> bool:
        return self._chain(self._signed, "*", "/")

    def _chain(self, part: Callable[[], bool], *signs: str) -> bool:
        truth = part()
        while sign := self._take(*signs):
            self._number(truth)
            self._number(part())
            self.program.append((sign, 2))
        return truth

    def _signed(self) -> bool:
        if not (sign := self._take("+", "-")):
            return self._power()
        self.program.append(("value", 0.0))
        self._number(self._deeper(self._signed))
        self.program.append((sign, 2))
        return False

    def _power(self) -> bool:
        truth = self._atom()
        if self._take("**"):
            self._number(truth)
            self._number(self._deeper(self._signed))
            self.program.append(("**", 2))
        return truth

    def _atom(self) -> bool:
        if self._take("("):
            truth = self._deeper(self.joined if self.grammar.compares else self.sum)
            if not self._take(")"):
                raise ValueError("a parenthesis is not closed")
            return truth
        if not self.rest or self.rest[0][0] == "sign":
            raise ValueError("a number or a name is missing" + (f" before {self.rest[0][1]!r}" if self.rest else ""))
        kind, text = self.rest.pop(0)
        if kind == "number":
            self.program.append(("value", float(text)))
        elif text in self.grammar.functions:
            if not (self.rest and self.rest[0][1] == "("):
                raise ValueError(f"{text} without parentheses")
            self._number(self._atom())
            self.program.append(("call", text))
        else:
            self.program.append(("name", text))
        return False
