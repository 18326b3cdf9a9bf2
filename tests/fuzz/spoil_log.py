"""Logs written in many dialects, with or without damage; the numbers that they must be read as are known."""

from __future__ import annotations

from dataclasses import dataclass, field

from hypothesis import strategies as st

COLUMNS = ("frame", "time_s", "force_kN", "grip_um")
VALUES = ((0, 0.0, 0.0, -0.1), (1, 1.0, 0.1, 5.0), (2, 2.0, 0.2, 10.0), (3, 3.0, 0.3, 15.0))
NO_NUMBER = [
    "nan",
    "NaN",
    "inf",
    "-inf",
    "1e400",
    "",
    "-",
    "lost",
    "1.2.3",
    "1 2",
    "0x10",
    "1_0",
    "٣",
    "१",
    "1e",
    "=A1",
    "--1",
    "1.5mm",
    "1,5,2",
    "True",
    "\x00",
    '"',
    "1\x1b[0m",
    "#N/A",
    "1'000.0",
    "1.000.000,5",
    "1.580.000",
    "1,580.25",
    "1\u202f580",
]


@dataclass(frozen=True)
class Dialect:
    """How a table of numbers is written as text."""

    separator: str = ","
    decimal: str = "."
    newline: str = "\n"
    encoding: str = "utf-8"
    order: tuple[int, ...] = (0, 1, 2, 3)
    quoted: bool = False
    spaces: bool = False
    comment: bool = False
    blank: bool = False
    number: str = "{!r}"
    minus: str = "-"
    above: tuple[str, ...] = ()  # lines of the instrument above the header; {} stands for the separator
    units: bool = False
    excel: bool = False
    spare_columns: int = 0
    spare_rows: int = 0

    def cell(self, value: float) -> str:
        text = self.number.format(value).replace(".", self.decimal).replace("-", self.minus)
        return f" {text} " if self.spaces else f'"{text}"' if self.quoted else text


@dataclass(frozen=True)
class Damage:
    """One thing wrong: a cell, lose_cell, gain_cell, lose_row, double_row, swap_rows, lose_header, a name; cut,
    splice."""

    what: str
    row: int = 0
    column: int = 0
    value: object = None


@dataclass(frozen=True)
class LogFile:
    dialect: Dialect
    damages: tuple[Damage, ...] = field(default=())

    def content(self) -> bytes:
        dialect = self.dialect
        names = [COLUMNS[k] for k in dialect.order]
        rows = [[dialect.cell(float(row[k]) if k else row[k]) for k in dialect.order] for row in VALUES]
        for damage in self.damages:
            _damage_table(names, rows, damage)
        table = ([names] if names else []) + ([["", "s", "kN", "um"]] if dialect.units and names else []) + rows
        if dialect.units and names:
            table[1] = [table[1][k] for k in dialect.order]
        spare = dialect.separator * dialect.spare_columns
        lines = [line.replace("{}", dialect.separator) for line in dialect.above]
        lines += [dialect.separator.join(row) + spare for row in table]
        lines += [dialect.separator * (len(COLUMNS) - 1) + spare] * dialect.spare_rows
        lines = [f"sep={dialect.separator}"] * dialect.excel + lines
        lines = lines[:1] + ["# a comment"] * dialect.comment + lines[1:]
        if dialect.blank:
            lines.insert(2, "")
        text = dialect.newline.join(lines) + dialect.newline
        content = text.encode(dialect.encoding, errors="replace")
        for damage in self.damages:
            if damage.what == "cut":
                content = content[: int(damage.value * len(content))]
            elif damage.what == "splice":
                content = damage.value(content)
        return content


def _damage_table(names: list[str], rows: list[list[str]], damage: Damage) -> None:
    row = rows[damage.row % len(rows)] if rows else []
    column = damage.column % max(len(row), 1)
    if damage.what == "cell" and row:
        row[column] = damage.value
    elif damage.what == "lose_cell" and row:
        del row[column]
    elif damage.what == "gain_cell":
        row.insert(column, "0")
    elif damage.what == "lose_row" and rows:
        rows.remove(row)
    elif damage.what == "double_row" and rows:
        rows.append(list(row))
    elif damage.what == "swap_rows" and len(rows) > 1:
        a, b = damage.row % len(rows), (damage.row + 1) % len(rows)
        rows[a], rows[b] = rows[b], rows[a]
    elif damage.what == "lose_header":
        names.clear()
    elif damage.what == "name" and names:
        names[column % len(names)] = damage.value


@st.composite
def dialects(draw) -> Dialect:
    separator, decimal = draw(
        st.sampled_from(
            [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), (",", ","), ("|", "."), (" ", ".")]
        )
    )
    return Dialect(
        separator,
        decimal,
        draw(st.sampled_from(["\n", "\r\n", "\r"])),
        draw(st.sampled_from(["utf-8", "utf-8", "utf-8-sig", "utf-16", "utf-16-le", "latin-1", "cp1252"])),
        tuple(draw(st.permutations(range(4)))),
        *(draw(st.booleans()) for _ in range(4)),
        draw(st.sampled_from(["{!r}", "{!r}", "{:.6e}", "{:+.4f}", "{:E}"])),
        draw(st.sampled_from("-\N{MINUS SIGN}")),
        draw(st.sampled_from([(), ("Operator{}Müller", "Specimen{}5", "Date{}2026-11-23"), ("Test 7", "")])),
        draw(st.booleans()),
        draw(st.booleans()),
        draw(st.integers(0, 2)),
        draw(st.integers(0, 2)),
    )


def damages(splices) -> st.SearchStrategy[Damage]:
    place = dict(row=st.integers(0, 3), column=st.integers(0, 3))
    return (
        st.builds(Damage, st.just("cell"), value=st.sampled_from(NO_NUMBER) | st.text(max_size=5), **place)
        | st.builds(
            Damage,
            st.sampled_from(["lose_cell", "gain_cell", "lose_row", "double_row", "swap_rows", "lose_header"]),
            **place,
        )
        | st.builds(
            Damage,
            st.just("name"),
            value=st.sampled_from([*COLUMNS, "", "t_s", "time_h", "force_N", "x" * 300, "1.0", "ß"]),
            **place,
        )
        | st.builds(Damage, st.just("cut"), value=st.floats(0, 1))
        | st.builds(Damage, st.just("splice"), value=splices)
    )
