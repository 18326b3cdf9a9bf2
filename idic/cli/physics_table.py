"""The table of `idic physics`."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table


def physics_table(candidates: Sequence) -> Table:
    """The library: name, family, physics, null value, rivals, tests that separate it from them."""
    table = Table(header_style="bold", show_lines=True)
    names = (name for candidate in candidates for name in (candidate.name, *candidate.rivals))
    longest = max(len(name) + 1 for name in names)  # a name is not broken
    for column in ("name", "family and side", "physics", "absent at", "rivals", "separating tests"):
        table.add_column(column, overflow="fold", no_wrap=column == "name",
                         min_width=longest if column == "rivals" else None)
    for candidate in candidates:
        rivals = "\n".join(f"{name}: {reason}" for name, reason in candidate.rivals.items())
        table.add_row(candidate.name, f"{candidate.family}\n({candidate.side})", described(candidate), candidate.null,
                      rivals, "\n".join(f"· {test}" for test in candidate.separating_tests))
    return table


def described(candidate) -> str:
    """Name of a candidate in standard words, its paraphrase in brackets."""
    return candidate.title + (f" ({candidate.paraphrase})" if candidate.paraphrase else "")
