"""Tables as the terminal shows them, and that of the constitutive laws."""

from __future__ import annotations

from collections.abc import Iterable

from rich.console import Console
from rich.table import Table

from idic.report import Line, TextTable


def laid_out(content: TextTable) -> Table:
    """A table of texts for rich."""
    table = Table(box=None, header_style="bold")
    for title in content.titles:
        table.add_column(title, justify="left" if title in content.words else "right",
                         no_wrap=title in content.unbroken)
    for row in content.rows:
        table.add_row(*row)
    return table


def show(console: Console, parts: Iterable[Line | TextTable]) -> None:
    """Print lines and tables, one below the other."""
    for part in parts:
        if isinstance(part, TextTable):
            console.print(laid_out(part))
        else:
            console.print(part.text, style=part.style, highlight=False, markup=False)


def laws_table(laws) -> Table:
    """All laws with parameters, units, null values.

    Parameters
    ----------
    laws : iterable of idic.laws.core.law.LawSpec
    """
    from idic.laws import ELASTOPLASTIC as COMPOSED, EXPANSION

    table = Table(box=None, header_style="bold")
    for column in ("law", "kinematics", "parameter", "unit", "null", "typical"):
        table.add_column(column, no_wrap=True)
    table.add_column("meaning", overflow="fold")
    for law in laws:
        first = [law.name, ", ".join(law.kinematics)]
        for parameter in law.parameters:
            table.add_row(*first, parameter.name, parameter.unit, _plain(parameter.null), _plain(parameter.default),
                          parameter.description)  # fmt: skip
            first = ["", ""]
        if law.compose is not None and law.name == COMPOSED:
            _add_terms(table)
    table.add_row("every law", "", EXPANSION.name, EXPANSION.unit, _plain(EXPANSION.null), _plain(EXPANSION.default),
                  EXPANSION.description)  # fmt: skip
    return table


def _add_terms(table: Table) -> None:
    """The terms that the composed law may have; n counts the terms of a list from 1."""
    from idic.laws import LISTS, TEMPERATURE_TERMS, TERMS

    for term in (*TERMS.values(), *TEMPERATURE_TERMS.values()):
        head = [f"  + {term.kind}", term.group]
        stem = f"{term.group}_n" if term.group in LISTS else term.group
        for parameter in term.parameters:
            table.add_row(*head, f"{stem}_{parameter.name}", parameter.unit, _plain(parameter.null),
                          _plain(parameter.default), parameter.description)  # fmt: skip
            head = ["", ""]
        if not term.parameters:
            table.add_row(*head, "", "", "", "", f"{term.equation} (default)")


def _plain(value: float | None) -> str:
    return "-" if value is None else f"{value:.6g}"
