"""The page of a study: targets beside what was reached, tables and figures; one self-contained HTML file."""

from __future__ import annotations

from dataclasses import dataclass, replace

from jinja2 import Environment, PackageLoader, StrictUndefined

from idic.report.figures.style import Picture


@dataclass(frozen=True)
class Goal:
    """One line of the list on top: what was asked for, and what came out; met is None where nothing was asked for."""

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
    """Everything a reader of a study sees."""

    title: str
    first: str
    goals: tuple[Goal, ...]
    sections: tuple[StudySection, ...]

    @property
    def pictures(self) -> tuple[Picture, ...]:
        return tuple(picture for section in self.sections for picture in section.pictures)

    def with_remark(self, text: str) -> StudyPage:
        """The page with a sentence added to its first one."""
        return replace(self, first=f"{self.first} {text}".strip())


def render_study(page: StudyPage) -> str:
    """The HTML text."""
    environment = Environment(loader=PackageLoader("idic.report", "."), autoescape=True, undefined=StrictUndefined,
                              trim_blocks=True, lstrip_blocks=True)
    return environment.get_template("study.html.j2").render(page=page)


def markdown_table(table: Table) -> str:
    """The table as Markdown, for the documentation."""
    def line(cells):
        return "| " + " | ".join(cells) + " |"

    return "\n".join([line(table.header), line(["---"] * len(table.header)), *(line(row) for row in table.rows)])
