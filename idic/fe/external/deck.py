"""A text file with places for numbers: the input deck of an external solver, filled in for one set of parameters.

``{SPECIMEN.E}`` is the value of a name, ``{SPECIMEN.nu:.6e}`` the same in a format, ``{2 / SPECIMEN.kappa}``
arithmetic with names (`idic.expressions`); ``{{`` and ``}}`` are braces. Nothing else is
read: no attributes, no code. Any other brace is an error.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from idic.errors import InputError, NotConverged
from idic.expressions import Expression, Grammar, parse_expression

DEFAULT_FORMAT = ".12g"
# names hold dots, brackets and hyphens (SET-1.E): a minus between two names takes a space before it
ARITHMETIC = Grammar({"exp": math.exp, "log": math.log, "sqrt": math.sqrt}, name=r"[A-Za-z_](?:[\w.\[\]]|-(?=\w))*")
_TOKEN = re.compile(r"\{\{|\}\}|\{(?P<inside>[^{}\n]*)\}|(?P<stray>[{}])")
_FORMAT = re.compile(r"[<>]?[+ -]?0?\d{0,2}(?:\.\d{1,2})?[eEfFgG]")


@dataclass(frozen=True)
class Place:
    """One place for a value; `line` counts from 1."""

    text: str
    expression: Expression
    format: str
    line: int


@dataclass(frozen=True)
class Deck:
    """A parsed template: literal text and places in turn."""

    file: Path
    parts: tuple[str | Place, ...]

    @property
    def names(self) -> frozenset[str]:
        """Every name that the deck asks for."""
        return frozenset(name for part in self.parts if isinstance(part, Place) for name in part.expression.names)

    def check(self, names: Collection[str]) -> None:
        """Whether all names are known.

        Raises
        ------
        InputError
            At the first name that is not, with its line.
        """
        for part in self.parts:
            for name in sorted(part.expression.names - set(names)) if isinstance(part, Place) else ():
                suggestions = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
                raise InputError("an unknown name in the deck", file=self.file, key=f"line {part.line}",
                                 expected=f"one of {', '.join(sorted(names))}", found=f"{{{part.text}}}",
                                 remedy=f"did you mean {suggestions[0]}?"
                                 if suggestions else "a literal brace is written twice: {{")

    def render(self, values: Mapping[str, float | str]) -> str:
        """The deck with these values: numbers in the format of their place, texts (tables) as they are.

        Raises
        ------
        NotConverged
            A value that is not finite: these parameters make no deck.
        """
        return "".join(part if isinstance(part, str) else self._text_at(part, values) for part in self.parts)

    def _text_at(self, place: Place, values: Mapping[str, float | str]) -> str:
        try:
            value = place.expression.value(values)
        except (ArithmeticError, ValueError) as problem:
            location = f"{self.file.name}, line {place.line}"
            raise NotConverged(f"{location}: {{{place.text}}} has no value: {problem}") from None
        if isinstance(value, str):
            return value
        if not math.isfinite(value):
            raise NotConverged(f"{self.file.name}, line {place.line}: {{{place.text}}} is {value}")
        return format(float(value), place.format)


def parse_deck(text: str, file: Path) -> Deck:
    """Split a template.

    Raises
    ------
    InputError
        A single brace, an invalid expression, or a format that is not one of numbers.
    """
    parts: list[str | Place] = []
    end = 0
    for token in _TOKEN.finditer(text):
        parts.append(text[end:token.start()])
        end = token.end()
        if token["inside"] is None and token["stray"] is None:
            parts.append(token[0][0])
            continue
        line = text.count("\n", 0, token.start()) + 1
        if token["stray"] is not None:
            raise _not_a_place(file, line, text[token.start():token.start() + 30].partition("\n")[0], "it is alone")
        inside, colon, number_format = token["inside"].partition(":")
        if colon and not _FORMAT.fullmatch(number_format):
            raise _not_a_place(file, line, token[0], f"{number_format!r} is not a number format such as .6e")
        try:
            expression = parse_expression(inside, ARITHMETIC)
        except ValueError as problem:
            raise _not_a_place(file, line, token[0], str(problem)) from None
        parts.append(Place(token["inside"], expression, number_format or DEFAULT_FORMAT, line))
    return Deck(file, tuple(part for part in (*parts, text[end:]) if part != ""))


def _not_a_place(file: Path, line: int, text: str, reason: str) -> InputError:
    return InputError("a brace without a name or an expression", file=file, key=f"line {line}",
                      expected="{NAME}, {NAME:.6e}, {2 * NAME}, or {{ and }} for braces",
                      found=f"{text.strip()} ({reason})", remedy="double the brace if it is meant for the solver")
