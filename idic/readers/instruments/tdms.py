"""Logs of LabVIEW and DIAdem (.tdms): the channels that were sampled together, with their times, by nptdms."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import numpy as np

from idic.readers.delimited.log_table import Table
from idic.readers.delimited.units import parse_unit
from idic.readers.formats.format import LOADS, Format
from idic.readers.instruments.channel_table import Channel, table_of

FORMAT = Format(LOADS, "LabVIEW, DIAdem", (".tdms",), "nptdms", "names, units, sampling, start offset",
                "units that it lacks", "made by nptdms: offsets, rates, lengths, interrupted",
                is_extra=True)
_UNIT_PROPERTIES = ("unit_string", "NI_UnitDescription", "Unit", "unit")
_OTHER_NAMES = {"Newton": "N", "Kilonewton": "kN", "Millimeter": "mm", "Seconds": "s", "Volts": "V"}


def read_tdms(path: Path) -> tuple[Table, list[str]]:
    """The table, and notes on channels that it lacks.

    Raises
    ------
    InputError
        nptdms is missing, the file is damaged, or it holds no channel with numbers.
    """
    with FORMAT.decoded(path):
        from nptdms import TdmsFile

        tdms = TdmsFile.read(path)
        groups: dict[Hashable, list[Any]] = defaultdict(list)
        text = []
        for channel in (channel for group in tdms.groups() for channel in group.channels() if len(channel)):
            if np.issubdtype(channel.dtype, np.number):
                groups[_sampling(channel)].append(channel)
            else:
                text.append(channel.name)
        is_cut = tdms.file_status.incomplete_final_segment
    notes = [f"{path.name}: not read is {', '.join(text)}: no numbers"] if text else []
    if not groups:
        return table_of([], path), notes
    chosen = max(groups.values(), key=lambda channels: (len(channels), max(map(len, channels))))
    unread = [channel for channels in groups.values() if channels is not chosen for channel in channels]
    if unread:
        notes.append(f"{path.name}: read are the {len(chosen)} channels that were sampled together; not read "
                     f"{'is' if len(unread) == 1 else 'are'} {', '.join(map(_sampled_name, unread))}: write all with "
                     "one rate and start")
    n_rows = min(map(len, chosen))
    if len({len(channel) for channel in chosen}) > 1:
        lengths = ", ".join(f"{channel.name} {len(channel)}" for channel in chosen)
        notes.append(f"{path.name}: channels of different length ({lengths}): the first {n_rows} samples are read")
    if is_cut:
        notes.append(f"{path.name}: the recording was interrupted; its last, incomplete samples are left out")
    several = len({channel.group_name for channel in chosen}) > 1
    columns = [Channel(f"{channel.group_name}/{channel.name}" if several else channel.name, _unit(channel),
                       np.asarray(channel[:n_rows], float)) for channel in chosen]
    if "wf_increment" in chosen[0].properties and not any(column.name == "time_s" for column in columns):
        columns.insert(0, Channel("time_s", "", _times(chosen[0], n_rows)))
    return table_of(columns, path), notes


def _sampling(channel: Any) -> Hashable:
    """What channels have in common that were sampled together: rate, start and offset, else group and length."""
    properties = channel.properties
    if "wf_increment" not in properties:
        return channel.group_name, len(channel)
    return tuple(str(properties.get(name)) for name in ("wf_increment", "wf_start_offset", "wf_start_time"))


def _times(channel: Any, n_rows: int) -> np.ndarray:
    """Times of the samples, from the start offset on  # (n_rows,) s"""
    properties = channel.properties
    return float(properties.get("wf_start_offset", 0.0)) + float(properties["wf_increment"]) * np.arange(n_rows)


def _sampled_name(channel: Any) -> str:
    increment = channel.properties.get("wf_increment")
    sampling = f"every {increment:g} s" if increment is not None else "without times"
    return f"{channel.group_name}/{channel.name} ({len(channel)} samples {sampling})"


def _unit(channel: Any) -> str:
    """The unit that a property states, where idic knows it; "" otherwise: the name of the channel may hold it."""
    texts = [str(channel.properties[name]).strip() for name in _UNIT_PROPERTIES if name in channel.properties]
    units = [unit for text in texts if parse_unit(unit := _OTHER_NAMES.get(text, text)) is not None]
    return next((unit for unit in units if unit), "")
