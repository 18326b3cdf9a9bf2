"""The order of frames by their file names: numbers as they stand, with their signs, past the largest one, as dates and
times of day; and what each reading is called in the key `order`.

Numbers are signs, or a counter that began again, only where they run through that place without a step: -2, -1, 0, 1
or 9998, 9999, 0, 1.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime
from itertools import pairwise

NAMES, SIGNED, WRAPPED, CLOCK, LISTED = "names", "signed", "wrapped", "clock", "listed"
DECIMALS = "decimals"
MAX_GAP_STEPS = 2  # largest steps of the other numbers: a run of numbers has no wider gap where it passes its end
MIDNIGHT_GAP_S, EVENING_S, MORNING_S = 12 * 3600.0, 18 * 3600.0, 6 * 3600.0  # of times of day without a date
DAY_S = 86400.0
_EPOCH = datetime(1970, 1, 1)
_FRACTION = re.compile(r"(?<![\d.])\d+(?:\.\d+)?(?![\d.])")  # not 2024.05.01
_NUMBER = re.compile(r"((?<![0-9])[-+−](?=\d))?(\d+)")
_ENDS = tuple(10**digits - 1 for digits in range(2, 10)) + (255, 1023, 4095, 65535)  # of counters

_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_YEAR_FIRST = re.compile(r"(?<!\d)((?:19|20)\d\d)([-._]?)(\d\d)\2(\d\d)(?!\d)")
_YEAR_LAST = re.compile(r"(?<!\d)(\d{1,2})([-._])(\d{1,2})\2((?:19|20)\d\d)(?!\d)")
_COMPACT_YEAR_LAST = re.compile(r"(?<!\d)(\d\d)()(\d\d)((?:19|20)\d\d)(?!\d)")
_MONTH = f"({'|'.join(_MONTHS)})[a-z]*"
_DAY_MONTH = re.compile(rf"(?<!\d)(\d{{1,2}})[-._ ]?{_MONTH}[-._ ]?((?:19|20)\d\d)(?!\d)", re.IGNORECASE)
_MONTH_DAY = re.compile(rf"{_MONTH}[-._ ]?(\d{{1,2}})[-._, ]+((?:19|20)\d\d)(?!\d)", re.IGNORECASE)
_HALF_DAY = re.compile(r"(?<!\d)(\d{1,2})(?:[-_.: ]?(\d\d))?(?:[-_.: ]?(\d\d))?(?:[.,](\d+))?[-_ ]?([ap])\.?m(?![a-z])",
                       re.IGNORECASE)
_OF_DAY = re.compile(r"(?<!\d)([01]?\d|2[0-3])[-_.:h]?([0-5]\d)[-_.:m]?([0-5]\d)(?:[.,](\d+))?")


class UncertainOrder(ValueError):
    """Names that have two readings. expected, found : as of an `InputError`; orders : the values of the key."""

    def __init__(self, expected: str, finding: str, orders: tuple[str, str]):
        super().__init__(expected)
        self.expected, self.found, self.orders = expected, finding, orders


def natural_key(text: str) -> list[tuple[int, int, str]]:
    """Sort key in which ``frame_2`` comes before ``frame_10``."""
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part.lower()) for part in re.split(r"(\d+)", text)
            if part]


def order_by_names(stems: Sequence[str], order: str | None = None) -> tuple[list[int], str]:
    """Indices of the names in their order, and the reading by which they are in it.

    order : "names", "signed", "wrapped", "clock", "decimals", "number 1", "number 2" …; None: what the names show

    Raises
    ------
    UncertainOrder
        Names with two readings, or names that lack the reading of `order`.
    """
    readings = {DECIMALS: decimal_keys, SIGNED: signed_keys, WRAPPED: wrapped_keys, CLOCK: clock_keys}
    if order is None:
        for name, reading in readings.items():
            if (keys := reading(stems)) is not None:
                return _sorted(keys, stems), name
        _check_signs(stems)
        return _sorted([()] * len(stems), stems), NAMES
    if order == NAMES:
        return _sorted([()] * len(stems), stems), NAMES
    statements = {SIGNED: _signs_stated, CLOCK: clock_keys, WRAPPED: _wrapped_where_widest,
                  DECIMALS: _decimals_stated}
    keys = _number_keys(stems, int(order.split()[1]) - 1) if order.startswith("number ") else statements[order](stems)
    if keys is None:
        meaning = {SIGNED: "one signed number in every name", CLOCK: "a date or a 12-hour time in every name",
                   WRAPPED: "one number that differs in every name",
                   DECIMALS: "numbers with a point"}.get(order, f"a {order} in every name")
        raise UncertainOrder(meaning, f"{stems[0]} … {stems[-1]}", (NAMES, LISTED))
    return _sorted(keys, stems), order


def orders_of_names(stems: Sequence[str]) -> dict[str, list[int]]:
    """Every reading that the names have, as indices in its order."""
    keys = {NAMES: [()] * len(stems), SIGNED: _signs_stated(stems), WRAPPED: _wrapped_where_widest(stems),
            CLOCK: clock_keys(stems), DECIMALS: _decimals_stated(stems)}
    keys |= {f"number {column + 1}": _number_keys(stems, column) for column in range(1, 6)}
    return {name: _sorted(values, stems) for name, values in keys.items() if values is not None}


def decimal_keys(stems: Sequence[str]) -> list[tuple] | None:
    """The values of 0, 0.5, 1: numbers of which some have a fraction and some have none; None elsewhere.

    1.9, 1.10 may be a counter behind a point: all of these have a fraction.
    """
    values = _decimals_stated(stems)
    fractions = [["." in text for text in _FRACTION.findall(stem)] for stem in stems]
    return values if values is not None and len({tuple(row) for row in fractions}) > 1 else None


def _decimals_stated(stems: Sequence[str]) -> list[tuple] | None:
    """The numbers of the names, with what stands behind their points; None where none of them has a point."""
    numbers = [_FRACTION.findall(stem) for stem in stems]
    has_point = any("." in text for row in numbers for text in row)
    if not has_point or len({_FRACTION.sub("#", stem) for stem in stems}) != 1:
        return None
    return [tuple(map(float, row)) for row in numbers]


def signed_keys(stems: Sequence[str]) -> list[tuple] | None:
    """The numbers of the names where some are below zero and all run through it; None elsewhere."""
    numbers, signs = _numbers(stems), _signs(stems)
    mixed = [] if numbers is None else [j for j, column in enumerate(zip(*signs, strict=True))
                                        if "-" in column and set(column) != {"-"}]
    if len(mixed) != 1:
        return None
    values = [-row[mixed[0]] if sign[mixed[0]] == "-" else row[mixed[0]]
              for row, sign in zip(numbers, signs, strict=True)]
    if len(set(values)) < len(values) or not _is_run_through(sorted(values), 0):
        return None
    return _replaced(numbers, mixed[0], values)


def wrapped_keys(stems: Sequence[str]) -> list[tuple] | None:
    """The numbers of the names counted on past the largest one that a counter has; None where they do not pass it."""
    column = _one_column(stems)
    if column is None or max(column) not in _ENDS or min(column) > 1:
        return None
    return _wrapped_where_widest(stems, max(column) + 1 - min(column))


def clock_keys(stems: Sequence[str]) -> list[tuple] | None:
    """Seconds by 12-hour times, dates with the year behind or the month in letters, times of day past midnight; None
    where the names have none of these: the digits of other times are in order."""
    half_day = [_HALF_DAY.search(stem) for stem in stems]
    if all(_is_half_day(match) for match in half_day) or _have(_YEAR_LAST, stems) or _have(_DAY_MONTH, stems) or \
            _have(_MONTH_DAY, stems) or (_have(_COMPACT_YEAR_LAST, stems) and not _have(_YEAR_FIRST, stems)):
        days = _days(stems)
        times = [_seconds_of_day(_without_date(stem)) for stem in stems]
        if days is None and not any(times):
            return None
        keys = [(day + (time or 0.0),) for day, time in zip(days or [0.0] * len(stems), times, strict=True)]
        return keys if len(set(keys)) > 1 else None
    return _past_midnight(stems)


def _sorted(keys: Sequence[tuple], stems: Sequence[str]) -> list[int]:
    return sorted(range(len(stems)), key=lambda k: (keys[k], natural_key(stems[k])))


def _numbers(stems: Sequence[str]) -> list[list[int]] | None:
    """The numbers of each name without their signs; None of names that differ otherwise, too."""
    if len({_NUMBER.sub("#", stem) for stem in stems}) != 1:
        return None
    return [[int(match[1]) for match in _NUMBER.findall(stem)] for stem in stems]


def _signs(stems: Sequence[str]) -> list[list[str]]:
    return [[match[0].replace("−", "-") for match in _NUMBER.findall(stem)] for stem in stems]


def _replaced(numbers: Sequence[Sequence[int]], place: int, values: Sequence[int]) -> list[tuple]:
    return [(*row[:place], value, *row[place + 1:]) for row, value in zip(numbers, values, strict=True)]


def _one_column(stems: Sequence[str]) -> list[int] | None:
    """The one number of each name that differs from name to name; None where it is not one, or not unique."""
    numbers = _numbers(stems)
    varying = [] if numbers is None else [column for column in zip(*numbers, strict=True) if len(set(column)) > 1]
    return list(varying[0]) if len(varying) == 1 and len(set(varying[0])) == len(stems) else None


def _is_run_through(values: Sequence[int], place: int) -> bool:
    """Whether sorted numbers on both sides of a place are as close to each other there as elsewhere."""
    below, above = [v for v in values if v < place], [v for v in values if v >= place]
    if not below or not above:
        return False
    gaps_elsewhere = [later - value for part in (below, above) for value, later in pairwise(part)]
    return above[0] - below[-1] <= MAX_GAP_STEPS * max(gaps_elsewhere, default=1)


def _check_signs(stems: Sequence[str]) -> None:
    """UncertainOrder where the one number that differs has a minus behind a blank or an underscore in every name."""
    numbers, signs = _numbers(stems), _signs(stems)
    if numbers is None or len(stems) < 2:
        return
    for column, sign in zip(zip(*numbers, strict=True), zip(*signs, strict=True), strict=True):
        if len(set(column)) > 1 and set(sign) == {"-"} and all(re.search(r"[_ ][-−]\d", stem) for stem in stems):
            raise UncertainOrder("numbers that count up in time", f"{stems[0]} … {stems[-1]}: a minus before every "
                                 "number is a sign, or a dash", (SIGNED, NAMES))


def _signs_stated(stems: Sequence[str]) -> list[tuple] | None:
    """The numbers with every sign that stands before them."""
    numbers, signs = _numbers(stems), _signs(stems)
    if numbers is None or not any("-" in row for row in signs):
        return None
    return [tuple(-value if sign == "-" else value for value, sign in zip(*rows, strict=True))
            for rows in zip(numbers, signs, strict=True)]


def _wrapped_where_widest(stems: Sequence[str], period: int | None = None) -> list[tuple] | None:
    """The numbers counted on from the one behind the widest gap; None where they have none, or not over the end."""
    column = _one_column(stems)
    if column is None or len(column) < 3:
        return None
    values = sorted(column)
    gaps = [later - value for value, later in pairwise(values)]
    widest = max(gaps)
    gaps_elsewhere = sorted(gaps)[:-1]
    if widest <= MAX_GAP_STEPS * max(gaps_elsewhere):
        return None
    start = values[gaps.index(widest) + 1]
    if period is not None and (min(gaps.index(widest), len(gaps) - 1 - gaps.index(widest)) < 1 or widest < period // 2
                               or period + values[0] - values[-1] > MAX_GAP_STEPS * max(gaps_elsewhere)):
        return None
    return [(value < start, value) for value in column]


def _number_keys(stems: Sequence[str], place: int) -> list[tuple] | None:
    """One of several numbers in a name, where it differs from name to name."""
    numbers = _numbers(stems)
    if numbers is None or place >= len(numbers[0]):
        return None
    column = [row[place] for row in numbers]
    return [(value,) for value in column] if len(set(column)) == len(column) else None


# dates and times of day -------------------------------------------------------------------------------
def _have(pattern: re.Pattern, stems: Sequence[str]) -> bool:
    return all(pattern.search(stem) for stem in stems)


def _is_half_day(match: re.Match | None) -> bool:
    return match is not None and 1 <= int(match[1]) <= 12 and int(match[2] or 0) < 60 and int(match[3] or 0) < 60


def _days(stems: Sequence[str]) -> list[float] | None:
    """Dates in s; None where the names have none. UncertainOrder where day and month may be exchanged."""
    if _have(_YEAR_FIRST, stems):
        parts = [_YEAR_FIRST.search(stem).group(1, 3, 4) for stem in stems]
        return _dates(parts)
    if _have(_DAY_MONTH, stems):
        return _dates([(m[3], _month(m[2]), m[1]) for m in map(_DAY_MONTH.search, stems)])
    if _have(_MONTH_DAY, stems):
        return _dates([(m[3], _month(m[1]), m[2]) for m in map(_MONTH_DAY.search, stems)])
    pattern = _YEAR_LAST if _have(_YEAR_LAST, stems) else _COMPACT_YEAR_LAST
    if not _have(pattern, stems):
        return None
    matches = [pattern.search(stem) for stem in stems]
    day_first = _dates([(m[4], m[3], m[1]) for m in matches])
    month_first = _dates([(m[4], m[1], m[3]) for m in matches])
    if day_first and month_first and _ranks(day_first) != _ranks(month_first):
        raise UncertainOrder("dates in which day and month cannot be exchanged, such as 2024-11-30",
                             f"{stems[0]} … {stems[-1]}", (LISTED, NAMES))
    return day_first or month_first


def _month(name: str) -> int:
    return _MONTHS.index(name[:3].lower()) + 1


def _dates(parts: Sequence[tuple]) -> list[float] | None:
    """(year, month, day) -> s; None where one is no date."""
    try:
        return [(datetime(*(int(part) for part in date)) - _EPOCH).total_seconds() for date in parts]
    except (ValueError, OverflowError):
        return None


def _ranks(values: Sequence[float]) -> list[int]:
    return [sorted(set(values)).index(value) for value in values]


def _without_date(stem: str) -> str:
    for pattern in (_YEAR_FIRST, _DAY_MONTH, _MONTH_DAY, _YEAR_LAST, _COMPACT_YEAR_LAST):
        if pattern.search(stem):
            return pattern.sub("|", stem, count=1)
    return stem


def _seconds_of_day(text: str) -> float | None:
    match = _HALF_DAY.search(text)
    if _is_half_day(match):
        hours = int(match[1]) % 12 + (12 if match[5].lower() == "p" else 0)
    elif (match := _OF_DAY.search(text)) is not None:
        hours = int(match[1])
    else:
        return None
    return 3600.0 * hours + 60.0 * int(match[2] or 0) + int(match[3] or 0) + float(f"0.{match[4] or 0}")


def _past_midnight(stems: Sequence[str]) -> list[tuple] | None:
    """Times of day without a date that run from the evening into the night."""
    column = _one_column_of_times(stems)
    if column is None:
        return None
    values = sorted(column)
    gap, start = max(((later - value, later) for value, later in pairwise(values)), default=(0.0, 0.0))
    if gap < MIDNIGHT_GAP_S or values[0] > MORNING_S or values[-1] < EVENING_S:
        return None
    return [(value + DAY_S * (value < start),) for value in column]


def _one_column_of_times(stems: Sequence[str]) -> list[float] | None:
    if any(_YEAR_FIRST.search(stem) for stem in stems):
        return None
    padded = re.compile(r"(?<!\d)([01]\d|2[0-3])([-_.:h]?)([0-5]\d)[-_.:m]?([0-5]\d)(?!\d)")
    matches = [padded.search(stem) for stem in stems]
    if any(match is None for match in matches):
        return None
    if len({padded.sub("|", stem, count=1) for stem in stems}) != 1:  # a counter beside it orders the names
        return None
    return [3600.0 * int(m[1]) + 60.0 * int(m[3]) + int(m[4]) for m in matches]
