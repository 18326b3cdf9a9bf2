"""Channels of a measuring device as the table of a log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.readers.delimited.log_table import Table


@dataclass(frozen=True, eq=False)
class Channel:
    """unit : "" where the file states none; values : (n,)"""

    name: str
    unit: str
    values: np.ndarray


def table_of(channels: Sequence[Channel], path: Path) -> Table:
    """A row per sample.

    Raises
    ------
    InputError
        There is no channel or no sample, or two channels have one name.
    """
    n_rows = len(channels[0].values) if channels else 0
    if not n_rows:
        raise InputError("the file holds no channel with samples", file=path, key="loads",
                         expected="numbers over time, force and motion among them",
                         found=", ".join(channel.name for channel in channels) or "none",
                         remedy="export the record of the test, or a CSV table")
    names = [channel.name for channel in channels]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError("a column name occurs twice", file=path, key=twice[0], expected="every name once",
                         found=", ".join(names), remedy="rename one of the channels, or export a CSV table")
    rows = tuple(zip(*([repr(float(value)) for value in channel.values] for channel in channels), strict=True))
    return Table(";", 1, tuple(names), tuple(channel.unit for channel in channels), rows,
                 tuple(range(1, n_rows + 1)), ())
