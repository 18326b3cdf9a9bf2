"""The page of a study or of the blind trial: targets and results, tables, figures; one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from idic.report import Picture, filled_in

FIGURES, TABLES = "figures", "tables.md"


@dataclass(frozen=True)
class Goal:
    """One target: quantity, target, result; met is None without a target."""

    what: str
    wanted: str
    got: str
    met: bool | None


@dataclass(frozen=True)
class Table:
    """A table of finished texts; the first column is a label."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


@dataclass(frozen=True)
class StudySection:
    """A question, its tables and figures."""

    anchor: str
    title: str
    text: str
    tables: tuple[Table, ...] = ()
    pictures: tuple[Picture, ...] = ()


@dataclass(frozen=True)
class StudyPage:
    """Title, introduction, targets and sections."""

    title: str
    first: str
    goals: tuple[Goal, ...]
    sections: tuple[StudySection, ...]

    @property
    def pictures(self) -> tuple[Picture, ...]:
        return tuple(picture for section in self.sections for picture in section.pictures)

    def with_remark(self, text: str) -> StudyPage:
        """The page with a sentence added to its introduction."""
        return replace(self, first=f"{self.first} {text}".strip())


def write_page_files(page: StudyPage, html: Path, heading: str = "") -> Path:
    """Write the page, ``figures/*.png`` and ``tables.md`` (which begins with `heading`); returns `html`."""
    folder = html.parent / FIGURES
    folder.mkdir(exist_ok=True)
    for picture in page.pictures:
        (folder / f"{picture.name}.png").write_bytes(picture.png)
    texts = [f"## {section.title}\n\n{table.title}\n\n{markdown_table(table)}\n\n{table.note}\n"
             for section in page.sections for table in section.tables]
    (html.parent / TABLES).write_text(heading + "\n".join(texts), encoding="utf-8")
    html.write_text(render_study(page), encoding="utf-8")
    return html


def render_study(page: StudyPage) -> str:
    """The HTML text of a page."""
    return render_template("study.html.j2", {"page": page})


def render_template(name: str, values: Mapping[str, Any]) -> str:
    """The text of a template of this folder; the style sheet is that of the reports."""
    return filled_in(name, "idic_studies.pages", **values)


def markdown_table(table: Table) -> str:
    """The table as Markdown, for the documentation."""
    def line(cells):
        return "| " + " | ".join(cells) + " |"

    return "\n".join([line(table.header), line(["---"] * len(table.header)), *(line(row) for row in table.rows)])
