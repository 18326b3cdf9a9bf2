"""Readings of the gauges, as CSV files and as rows of the page."""

from __future__ import annotations

import numpy as np

from idic.measure import Reading, readings
from idic.model import Gauge
from idic.path_names import path_name
from idic.report.result.record import RunRecord
from idic.report.result.words import number_text

SHOWN = {"extensometer": ("strain", "elongation"), "probe": ("u_x", "u_y", "strain_xx", "strain_yy", "strain_xy"),
         "circle": ("u_x", "u_y", "strain_xx", "strain_yy", "strain_xy")}


def gauge_tables(record: RunRecord) -> dict[str, tuple[list[str], list[list]]]:
    """File name -> (header, rows): ``gauges.csv``, one row per frame, and a file per line cut."""
    if record.series is None or not record.gauges:
        return {}
    found = {}
    plain = [gauge for gauge in record.gauges if gauge.kind != "line"]
    if plain:
        found["gauges.csv"] = _over_frames(record, [own for gauge in plain for own in readings(record.series, gauge)])
    for gauge in record.gauges:
        if gauge.kind == "line":
            found[f"line_{path_name(gauge.name)}.csv"] = _line(record, gauge)
    return found


def gauge_rows(record: RunRecord) -> list[dict]:
    """Rows of the page: what each gauge reads in the last frame of the series."""
    if record.series is None:
        return []
    rows = []
    for gauge in record.gauges:
        if gauge.kind == "line":
            continue
        for own in readings(record.series, gauge):
            if own.quantity in SHOWN[gauge.kind]:
                rows.append(_row(gauge, own))
    return rows


def _row(gauge: Gauge, own: Reading) -> dict:
    std = None if own.std is None or not np.isfinite(own.std[-1]) else float(own.std[-1])
    measured = None if own.measured is None or not np.isfinite(own.measured[-1]) else float(own.measured[-1])
    simulated = float(own.simulated[-1]) if np.isfinite(own.simulated[-1]) else None
    both = None if measured is None or simulated is None else measured - simulated
    return {"name": gauge.name, "kind": gauge.kind, "quantity": own.quantity.replace("_", " "),
            "unit": "" if own.unit == "-" else own.unit, "measured": number_text(measured, std),
            "std": number_text(std, std),
            "simulated": number_text(simulated, std), "difference": number_text(both, std)}


def _over_frames(record: RunRecord, found: list[Reading]) -> tuple[list[str], list[list]]:
    header, columns = _frame_columns(record)
    for own in found:
        stem = f"{own.gauge.name}.{_with_unit(own)}"
        for part, values in (("simulated", own.simulated), ("measured", own.measured), ("measured_std", own.std)):
            if values is not None:
                header.append(f"{stem}_{part}")
                columns.append(list(values))
    return header, [list(row) for row in zip(*columns, strict=True)]


def _line(record: RunRecord, gauge: Gauge) -> tuple[list[str], list[list]]:
    """One row per frame and sample; samples beside the specimen are left out."""
    series, unit = record.series, record.series.unit
    found, places = readings(series, gauge), gauge.places
    along = np.hypot(*(places - places[0]).T)
    header, columns = _frame_columns(record)
    header += [f"s_{unit}", f"x_{unit}", f"y_{unit}"]
    parts = [(f"{_with_unit(own)}_{part}", values) for own in found
             for part, values in (("simulated", own.simulated), ("measured", own.measured), ("measured_std", own.std))
             if values is not None]
    inside = np.flatnonzero(np.isfinite(found[0].simulated[0]))
    rows = [[*(column[k] for column in columns), along[i], *places[i], *(values[k, i] for _, values in parts)]
            for k in range(len(series.frames)) for i in inside]
    return header + [name for name, _ in parts], rows


def _frame_columns(record: RunRecord) -> tuple[list[str], list[list]]:
    frames = list(record.series.frames)
    if record.time_label_unit == "s":
        return ["frame", "time_s"], [frames, [record.times[k] for k in frames]]
    return ["frame"], [frames]


def _with_unit(own: Reading) -> str:
    return own.quantity if own.unit == "-" else f"{own.quantity}_{own.unit}"
