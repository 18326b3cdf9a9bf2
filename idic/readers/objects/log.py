"""A table in memory as the log reader gives that of a file: a DataFrame, a dict of columns, or a path."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from idic.errors import InputError
from idic.readers.delimited.log_table import Table
from idic.readers.delimited.table_times import column_notes
from idic.readers.logs import Decimal, Log

KEY, LOG_IN_MEMORY = "loads", Path("loads")  # in messages


def log_of(loads: Any, units: Mapping[str, str] | None = None, decimal: Decimal | None = None) -> Log:
    """The columns of a log.

    Parameters
    ----------
    loads : pandas.DataFrame, mapping of name to (n_rows,) values, or path of a CSV
    units : of columns whose names do not end in one (``force_N``, ``force [N]``); not with a path
    decimal : mark of the numbers in a file

    Raises
    ------
    InputError
        No columns, columns of different length, or units for columns that do not exist.
    """
    if isinstance(loads, (str, os.PathLike)):
        path = Path(loads)
        if not path.is_file():
            raise InputError("no such file", key=KEY, expected="a CSV file", found=str(path), remedy="correct the path")
        return Log.read(path, decimal)
    if not hasattr(loads, "__getitem__") or not hasattr(loads, "keys"):
        raise InputError("not a log", key=KEY, expected="a pandas.DataFrame, a dict of columns, or the path of a CSV",
                         found=type(loads).__name__, remedy='give e.g. {"time_s": times, "force_N": force}')
    names = list(loads.keys())
    columns = {str(name): np.ma.asarray(loads[name]) for name in names}  # a masked cell is None, and refused
    lengths = {name: np.shape(values) for name, values in columns.items()}
    if not columns or any(len(shape) != 1 for shape in lengths.values()) or len(set(lengths.values())) > 1:
        raise InputError("the columns of the log do not fit together", key=KEY,
                         expected="one value per image in every column",
                         found=", ".join(f"{name}: {shape}" for name, shape in lengths.items()) or "no columns",
                         remedy="give columns of one length, one row per image")
    unknown = sorted(set(units or {}) - set(columns))
    if unknown:
        raise InputError("a unit for a column that does not exist", key="units",
                         expected=f"one of {', '.join(columns)}", found=unknown[0],
                         remedy="correct the name of the column")
    cells = [[_cell(value) for value in _dated(values).tolist()] for values in columns.values()]
    rows = tuple(zip(*cells, strict=True))
    table = Table(",", 0, tuple(columns), tuple((units or {}).get(name, "") for name in columns), rows,
                  tuple(range(len(rows))), ())
    return Log(LOG_IN_MEMORY, table, ".", tuple(column_notes(table, LOG_IN_MEMORY)))


def _dated(values: np.ndarray) -> np.ndarray:
    """Dates of NumPy and pandas as text, other values as they are  # (n_rows,)"""
    return np.datetime_as_string(np.asarray(values)) if values.dtype.kind == "M" else values


def _cell(value: object) -> str:
    """A number to its last digit; anything else as it prints, to be refused where it is used."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return str(value)
    return repr(value)
