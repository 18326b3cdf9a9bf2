"""Records of ZwickRoell machines (.zs2 of testXpert II and III), by zs2decode.

A record lies in `SingleGroupDataBlock`: arrays by the number of their channel, whose name stands in the definitions of
the channels, in the language of the program. The file states no unit of them that is documented.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from idic.errors import InputError
from idic.readers.delimited.log_table import Table
from idic.readers.formats.format import LOADS, Format
from idic.readers.instruments.channel_table import Channel, table_of

FORMAT = Format(LOADS, "ZwickRoell testXpert", (".zs2",), "zs2decode", "names, time",
                "units; one specimen per file",
                "made by zs2decode; none real", is_extra=True)
_MANAGER, _BLOCK = "ChannelManager", "SingleGroupDataBlock"
Chunk = Sequence[Any]  # address, name, type, value


def read_zs2(path: Path) -> tuple[Table, list[str]]:
    """The table, and notes on it.

    Raises
    ------
    InputError
        zs2decode is missing, the file is damaged, or it holds no record or those of several specimens.
    """
    with FORMAT.decoded(path):
        from zs2decode import parser

        chunks = parser.parse_chunks(parser.data_stream_to_chunks(parser.load(str(path))))
        values = _by_place(chunks)
    names = {number: values.get((*place[:-1], "Name", "Text")) for place, number in values.items()
             if place[-1] == "ID" and _MANAGER in place}
    blocks: dict[tuple[str, ...], dict[object, np.ndarray]] = {}
    for place, array in values.items():
        if place[-1] == "DataArray" and _BLOCK in place:
            block = place[:place.index(_BLOCK) + 1]
            blocks.setdefault(block, {})[values.get((*place[:-1], "TrsChannelId"))] = np.asarray(array, float)
    filled = {place: block for place, block in blocks.items() if any(map(len, block.values()))}
    if len(filled) != 1:
        raise InputError("the file holds the records of several specimens" if filled else "the file holds no record",
                         file=path, key="loads", expected="the record of one specimen",
                         found=f"{len(filled)} records", remedy="save the specimen in a file of its own, or export its "
                         "record as text")
    (place, block), = filled.items()
    time_at = values.get((*place, "IndexTimeChannel"))
    titles = [str(names.get(number) or f"channel {number}") for number in block]
    channels = [Channel("time_s" if k == time_at else title, "", array)
                for k, (title, array) in enumerate(zip(titles, block.values(), strict=True)) if len(array)]
    longest = max(len(channel.values) for channel in channels)
    short = [channel.name for channel in channels if len(channel.values) < longest]
    notes = [f"{path.name}: the file states no units: write them, e.g. {{ column = \"{channels[-1].name}\", unit = "
             '"N" }, and compare a value with the printed record']
    if isinstance(time_at, int) and time_at < len(titles):
        notes.append(f"{path.name}: its channel of time, {titles[time_at]}, is read as time_s, in s")
    if short:
        notes.append(f"{path.name}: not read is {', '.join(short)}: shorter than the other channels")
    return table_of([channel for channel in channels if len(channel.values) == longest], path), notes


def _by_place(chunks: Sequence[Chunk]) -> dict[tuple[str, ...], Any]:
    """The value of every chunk by the names of the sections around it and its own."""
    place: list[str] = []
    values: dict[tuple[str, ...], Any] = {}
    for _, name, kind, value in chunks:
        if kind == "DD":
            place.append(name)
        elif kind == "end":
            place.pop()
        else:
            values[(*place, name)] = value
    return values
