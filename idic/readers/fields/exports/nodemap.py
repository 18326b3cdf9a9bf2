"""Node maps of ARAMIS as the scripts of laboratories export them: signals of the stage in the comments above the table.

    # current_stage_index : 7
    # SIGNALS:
    # force               : value_element : 1003.1
    # Kraft               : analog_input  : 1007.1
    #ID; x_undef [mm]; y_undef [mm]; z_undef [mm]; u [mm]; v [mm]; w [mm]; ...

The file names no unit of a signal; `time` is in seconds.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from idic.errors import InputError
from idic.readers.delimited.numerals import number_in

_SIGNAL = re.compile(r"#\s*(.+?)\s*:\s*(value_element|analog_input|\w*signal\w*)\s*:\s*(\S+)\s*")
_TIME = "time"


def signals_of(lines: Sequence[str], path: Path) -> tuple[float | None, dict[str, tuple[float, str | None]]]:
    """Time of a stage in s, None without, and its signals: name -> (value, None).

    Raises
    ------
    InputError
        A value is no number.
    """
    matches = [(number, match) for number, line in enumerate(lines, 1) if (match := _SIGNAL.fullmatch(line.rstrip()))]
    names = [match[1] for _, match in matches]
    time: float | None = None
    signals: dict[str, tuple[float, str | None]] = {}
    for number, match in matches:
        name, kind, cell = match.groups()
        value = number_in(cell, "," if "," in cell else ".")
        if value is None or not abs(value) < float("inf"):
            raise InputError("a signal of a stage is not a number", file=path, key=f"{name}, line {number}",
                             expected="a finite number", found=repr(cell), remedy="export the stage again")
        if name.lower() == _TIME and time is None:
            time = value
        else:
            signals[name if names.count(name) == 1 else f"{name} {kind}"] = value, None
    return time, signals
