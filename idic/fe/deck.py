"""A text file with places for numbers: the input deck of an external solver, filled in for one set of parameters.

``{SPECIMEN.E}`` is the value of a name, ``{SPECIMEN.nu:.6e}`` the same in a format of its own, ``{{`` and ``}}`` are
braces. Nothing else is understood: no expressions, no attributes, no code. A brace that is none of these is an error.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from idic.errors import InputError

DEFAULT_FORMAT = ".12g"
_NAME = r"[A-Za-z_][A-Za-z0-9_.\[\]-]*"
_FORMAT = r"[<>]?[+ -]?0?\d{0,2}(?:\.\d{1,2})?[eEfFgG]"
_TOKEN = re.compile(rf"\{{\{{|\}}\}}|\{{(?P<name>{_NAME})(?::(?P<format>{_FORMAT}))?\}}|(?P<stray>[{{}}][^{{}}\n]{{0,40}})")


@dataclass(frozen=True)
class Place:
    """One place for a number; `line` counts from 1."""

    name: str
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
        return frozenset(part.name for part in self.parts if isinstance(part, Place))

    def check(self, known: Mapping[str, object] | set[str]) -> None:
        """Whether all names are known.

        Raises
        ------
        InputError
            At the first name that is not, with its line.
        """
        for part in self.parts:
            if isinstance(part, Place) and part.name not in known:
                near = difflib.get_close_matches(part.name, known, n=1, cutoff=0.5)
                raise InputError("the deck asks for a name that there is not", file=self.file, key=f"line {part.line}",
                                 expected=f"one of {', '.join(sorted(known))}", found=f"{{{part.name}}}",
                                 remedy=f"did you mean {{{near[0]}}}?" if near else "a literal brace is written twice: {{")

    def render(self, values: Mapping[str, float | str]) -> str:
        """The deck with these values: numbers in the format of their place, text (tables) as it is."""
        return "".join(part if isinstance(part, str) else _shown(part, values[part.name]) for part in self.parts)


def _shown(place: Place, value: float | str) -> str:
    return value if isinstance(value, str) else format(float(value), place.format)


def parse_deck(text: str, file: Path) -> Deck:
    """Split a template.

    Raises
    ------
    InputError
        A brace that opens no name, a format that is not one of numbers.
    """
    parts: list[str | Place] = []
    end = 0
    for token in _TOKEN.finditer(text):
        parts.append(text[end:token.start()])
        end = token.end()
        line = text.count("\n", 0, token.start()) + 1
        if token["stray"] is not None:
            raise InputError("a brace that is no place for a number", file=file, key=f"line {line}",
                             expected="{NAME}, {NAME:.6e}, or {{ and }} for braces", found=token["stray"].strip(),
                             remedy="double the brace if the solver is to see it")
        if token["name"] is None:
            parts.append(token[0][0])
        else:
            parts.append(Place(token["name"], token["format"] or DEFAULT_FORMAT, line))
    return Deck(file, tuple(part for part in (*parts, text[end:]) if part != ""))
