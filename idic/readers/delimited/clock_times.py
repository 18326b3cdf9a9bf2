"""Times of day as text: 14:05:03.250, 2:05:03,25 PM, 12.03.2024 14:05:03, 2024-03-12T14:05:03+01:00, 05:30.5.

A column of them becomes seconds on one clock. What two readings share is refused and never guessed: hours and minutes
or minutes and seconds, the day or the month first, a time zone beside none.
"""

from __future__ import annotations

import datetime
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

_DATE = r"(?P<date>[0-9]{1,4}(?:[-./ ]|\. )(?:[0-9]{1,2}|[A-Za-zÀ-ÿ]{3,9}\.?)(?:[-./ ]|\. )[0-9]{2,4})"
_TIME = (r"(?P<first>[0-9]{1,3}):(?P<second>[0-9]{2})(?::(?P<third>[0-9]{2}))?"
         r"(?:[.,](?P<fraction>[0-9]{1,12})|:(?P<thousandths>[0-9]{3}))?"
         r"(?: ?(?P<half>[AaPp])\.? ?[Mm]\.?)?(?: ?(?P<zone>Z|[+-][0-9]{2}:?[0-9]{2}))?")
_STAMP = re.compile(rf"(?:{_DATE}(?:[T_,;] *| +))?{_TIME}")
_TIME_THEN_DATE = re.compile(rf"{_TIME} +{_DATE}")
_DATE_ONLY = re.compile(_DATE)
_MONTHS = {name: number for number, names in enumerate((
    ("jan", "ene"), ("feb", "fév", "fev"), ("mar", "mär", "mrz"), ("apr", "avr", "abr"), ("may", "mai", "mag"),
    ("jun", "giu"), ("jul", "lug"), ("aug", "aoû", "ago"), ("sep", "set"), ("oct", "okt", "ott"), ("nov",),
    ("dec", "dez", "déc", "dic")), 1) for name in names}
_FORMAT = re.compile(r"[dDtTmMyYjJ./ ,-]*\b(?P<clock>[hH]{1,2}:[mM]{2}|[mM]{1,2}:[sS]{2})(?::[sS]{2})?[.,:0fFsSxX ]*"
                     r"(?:[aA][mM]/[pP][mM]|[tT]{2})?")
DAY_S, HOUR_S = 86400, 3600
_DAY_FIRST, _MONTH_FIRST = (0, 1), (1, 0)


class ClockError(ValueError):
    """Text that is no time of day, or that can be read in two ways.

    row : of the column; expected, finding, remedy : of the message
    """

    def __init__(self, fault: str, row: int, expected: str, finding: str, remedy: str):
        super().__init__(fault)
        self.what, self.row, self.expected, self.finding, self.remedy = fault, row, expected, finding, remedy


@dataclass(frozen=True)
class ClockTimes:
    """Instants of the rows of a column on one clock.

    whole_s, fraction_s : (n_rows,) s since the year 1, or since midnight (the full hour) where no date is given
    period_s : after which the clock shows the same again; None where it shows the date, or counts on
    has_date : whether the clock shows the date
    has_zone : whether it shows the time zone; then whole_s is that of UTC
    first : text of the first row
    """

    whole_s: np.ndarray
    fraction_s: np.ndarray
    period_s: int | None
    has_date: bool
    has_zone: bool
    first: str

    def seconds(self) -> np.ndarray:
        """Seconds since the first row  # (n_rows,)"""
        return self.seconds_since(self)

    def seconds_since(self, start: ClockTimes) -> np.ndarray:
        """Seconds since the first row of another column on the same clock  # (n_rows,)

        A clock without a date repeats after its period; the day is chosen at which the middle of the rows lies nearest
        to that first row.

        Raises
        ------
        ClockError
            Only one of the clocks shows its time zone, or the rows go on for longer than a turn of the clock.
        """
        seconds = self.whole_s - start.whole_s[0]
        periods = [clock.period_s for clock in (self, start) if clock.period_s is not None]
        if self.has_zone != start.has_zone:
            raise ClockError("only one of two clocks shows its time zone", 0, "the zone in both or in none",
                             f"{self.first} and {start.first}", "export both alike")
        if self is not start and periods:
            if seconds[-1] - seconds[0] >= min(periods):
                raise ClockError("a clock without a date that shows the same time again", len(seconds) - 1,
                                 f"less than {min(periods) / HOUR_S:g} h, or dates beside the times of both files",
                                 f"{(seconds[-1] - seconds[0]) / HOUR_S:.3g} h", "export the times with their date")
            middle = (seconds[0] + seconds[-1]) / 2
            seconds = seconds - min(periods) * int(np.round(middle / min(periods)))
        return seconds.astype(float) + (self.fraction_s - start.fraction_s[0])


def is_clock_time(cell: str) -> bool:
    """Whether a cell is a time of day, with or without its date."""
    return ":" in cell and (_STAMP.fullmatch(cell.strip()) or _TIME_THEN_DATE.fullmatch(cell.strip())) is not None


def is_dated(cell: str) -> bool:
    """Whether a time of day shows its date."""
    match = _STAMP.fullmatch(cell.strip()) or _TIME_THEN_DATE.fullmatch(cell.strip())
    return match is not None and match["date"] is not None


def is_date(cell: str) -> bool:
    """Whether a cell is a date without a time."""
    return _DATE_ONLY.fullmatch(cell.strip()) is not None and _date_parts(cell.strip()) is not None


def clock_format(text: str) -> str | None:
    """What the first number of a clock is by a format such as ``hh:mm:ss``: "h", or "m"; None without a format."""
    match = _FORMAT.fullmatch(text.strip().strip("[]()").strip())
    return None if match is None else match["clock"][0].lower()


def clock_times(cells: Sequence[str], dates: Sequence[str] | None = None, first: str | None = None) -> ClockTimes:
    """The instants of a column.

    Parameters
    ----------
    dates : sequence of str, optional
        The cells of a column of dates beside it.
    first : "h" or "m", optional
        What the first number of a cell of two numbers is, as the header states it.

    Raises
    ------
    ClockError
        A cell is no time of day, or the column can be read in two ways.
    """
    matches = [_match(cell, row) for row, cell in enumerate(cells)]
    texts = [match["date"] for match in matches] if dates is None else list(dates)
    if any(texts) and not all(texts):
        raise _unlike(texts, cells, "the date")
    days = np.array(_days(texts)) if any(texts) else None
    zones = [match["zone"] for match in matches]
    if any(zones) and not all(zones):
        raise _unlike(zones, cells, "the time zone")
    in_minutes = _in_minutes(matches, cells, first, days is not None)
    seconds = np.array([_whole_seconds(match, row, in_minutes) for row, match in enumerate(matches)])
    fraction = np.array([float(f"0.{_decimals(match) or 0}") for match in matches])
    largest = 60 if in_minutes else 24
    turns = HOUR_S if in_minutes else DAY_S
    counts_on = any(int(match["first"]) >= largest for match in matches)
    date_moves = days is not None and (dates is None or len(set(days.tolist())) > 1)
    if not date_moves and not counts_on:  # a fall by more than half a turn is midnight, or the full hour
        seconds = seconds + turns * np.cumsum(np.diff(seconds, prepend=seconds[0]) < -turns // 2)
    if days is not None:
        seconds = seconds + DAY_S * days
    return ClockTimes(seconds, fraction, None if days is not None or counts_on else turns, days is not None,
                      all(zones), cells[0].strip() if dates is None else f"{dates[0].strip()} {cells[0].strip()}")


def _match(cell: str, row: int) -> re.Match[str]:
    match = _STAMP.fullmatch(cell.strip()) or _TIME_THEN_DATE.fullmatch(cell.strip())
    if match is None:
        raise ClockError("a cell among times of day is none", row, "a time such as 14:05:03.250",
                         repr(cell) if cell.strip() else "an empty cell", "correct the cell, or leave the row out")
    return match


def _decimals(match: re.Match[str]) -> str | None:
    """The digits behind the whole seconds."""
    return match["fraction"] or match["thousandths"]


def _unlike(formats: Sequence[str | None], cells: Sequence[str], part: str) -> ClockError:
    row = next(k for k, text in enumerate(formats) if bool(text) != bool(formats[0]))
    return ClockError(f"only some times of day show {part}", row, f"{part} in every row or in none", repr(cells[row]),
                      "write all rows alike")


def _in_minutes(matches: Sequence[re.Match[str]], cells: Sequence[str], first: str | None, dated: bool) -> bool:
    """Whether the first of two numbers is minutes: 22:30.5; InputError where 05:30 may be either."""
    lengths = [match["third"] is not None for match in matches]
    if any(lengths):
        if not all(lengths):
            raise ClockError("times of day of different length", lengths.index(not lengths[0]),
                             "hours, minutes and seconds in every row", repr(cells[lengths.index(not lengths[0])]),
                             "export all times alike, as hh:mm:ss")
        return False
    if first is not None:
        return first == "m"
    if any(map(_decimals, matches)):
        return True
    if dated or any(match["half"] or match["zone"] for match in matches):
        return False
    raise ClockError("times that are hours and minutes, or minutes and seconds", 0, "hh:mm:ss, or a header that says "
                     "which", repr(cells[0]), "write [hh:mm] or [mm:ss] behind the name of the column, such as "
                     "Time [mm:ss]")


def _whole_seconds(match: re.Match[str], row: int, in_minutes: bool) -> int:
    """Whole seconds since midnight, or since the full hour of a clock of minutes."""
    first, second, third = int(match["first"]), int(match["second"]), int(match["third"] or 0)
    half, is_wrong = match["half"], second > 59 or third > 59
    if half:
        is_wrong |= in_minutes or not 1 <= first <= 12
        first = first % 12 + (12 if half in "pP" else 0)
    if match["date"] and first > 23:
        is_wrong = True
    if is_wrong:
        raise ClockError("a time of day that no clock shows", row, "hh:mm:ss, with a fraction behind a point or comma",
                         repr(match.group()), "correct the cell, or leave the row out")
    zone = match["zone"]
    shift = 0 if zone in (None, "Z") else int(f"{zone[0]}1") * (int(zone[1:3]) * HOUR_S + int(zone[-2:]) * 60)
    return (first * 60 + second if in_minutes else first * HOUR_S + second * 60 + third) - shift


# dates ------------------------------------------------------------------------------------------------
def _date_parts(text: str) -> tuple[tuple[int, int], int, bool] | None:
    """The two numbers beside the year, the year, and whether their order is certain; None for no date."""
    parts = [part for part in re.split(r"[-./ ]+", text) if part]
    if len(parts) != 3:
        return None
    if not parts[1].isdigit():
        month = _MONTHS.get(parts[1].lower()[:3])
        year_first = len(parts[0]) == 4
        day, year = (parts[2], parts[0]) if year_first else (parts[0], parts[2])
        return None if month is None or len(day) > 2 else ((int(day), month), _year(year), True)
    if len(parts[0]) == 4:
        return ((int(parts[2]), int(parts[1])), int(parts[0]), True) if len(parts[2]) <= 2 else None
    if len(parts[0]) > 2 or len(parts[2]) == 3:
        return None
    return (int(parts[0]), int(parts[1])), _year(parts[2]), "." in text  # points separate the day first everywhere


def _year(text: str) -> int:
    return int(text) + (2000 if len(text) == 2 else 0)


def _days(texts: Sequence[str]) -> list[int]:
    """Days since the year 1 of dates; the day or the month comes first, as the dates themselves show."""
    parts = {}
    for row, text in enumerate(texts):
        if text not in parts:
            parts[text] = _date_parts(text.strip())
            if parts[text] is None:
                raise _no_date(row, text)
    order = _DAY_FIRST if all(certain for _, _, certain in parts.values()) else _order(list(parts), texts)
    days = {}
    for text, (pair, year, _) in parts.items():
        day = _ordinal(pair, year, order)
        if day is None:
            raise _no_date(list(texts).index(text), text)
        days[text] = day
    return [days[text] for text in texts]


def _order(distinct: Sequence[str], texts: Sequence[str]) -> tuple[int, int]:
    """Places of day and month, from the one order in which all dates exist and follow each other day by day."""
    readings = {}
    for order in (_DAY_FIRST, _MONTH_FIRST):
        days = [_ordinal(*_date_parts(text.strip())[:2], order) for text in distinct]
        if all(day is not None for day in days):
            readings[order] = days
    if not readings:
        raise _no_date(0, distinct[0])
    if len(readings) == 2 and len(distinct) > 1:
        gaps = {order: np.diff(days) for order, days in readings.items()}
        by_day = [order for order, steps in gaps.items() if (steps == 1).all()]
        rising = [order for order, steps in gaps.items() if (steps > 0).all()]
        chosen = by_day if len(by_day) == 1 else rising
        if len(chosen) != 1:
            row = next(k for k, text in enumerate(texts) if text == distinct[1])
            raise ClockError("dates with the day or the month first", row, "dates of one reading, as 2024-03-12",
                             f"{distinct[0]} and {distinct[1]}", "export the dates as yyyy-mm-dd")
        return chosen[0]
    return next(iter(readings))


def _ordinal(pair: tuple[int, int], year: int, order: tuple[int, int]) -> int | None:
    try:
        return datetime.date(year, pair[order[1]], pair[order[0]]).toordinal()
    except ValueError:
        return None


def _no_date(row: int, text: str) -> ClockError:
    return ClockError("a date that does not exist", row, "a date such as 2024-03-12", repr(text),
                      "correct the cell, or leave the row out")
