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
    tables = {}
    plain = [gauge for gauge in record.gauges if gauge.kind != "line"]
    if plain:
        tables["gauges.csv"] = _over_frames(
            record, [reading for gauge in plain for reading in readings(record.series, gauge)])
    for gauge in record.gauges:
        if gauge.kind == "line":
            tables[f"line_{path_name(gauge.name)}.csv"] = _line(record, gauge)
    return tables


def gauge_rows(record: RunRecord) -> list[dict]:
    """Rows of the page: what each gauge reads in the last frame of the series."""
    if record.series is None:
        return []
    rows = []
    for gauge in record.gauges:
        if gauge.kind == "line":
            continue
        for reading in readings(record.series, gauge):
            if reading.quantity in SHOWN[gauge.kind]:
                rows.append(_row(gauge, reading))
    return rows


def _row(gauge: Gauge, reading: Reading) -> dict:
    std = _last_finite(reading.std)
    measured, simulated = _last_finite(reading.measured), _last_finite(reading.simulated)
    difference = None if measured is None or simulated is None else measured - simulated
    return {"name": gauge.name, "kind": gauge.kind, "quantity": reading.quantity.replace("_", " "),
            "unit": "" if reading.unit == "-" else reading.unit, "measured": number_text(measured, std),
            "std": number_text(std, std),
            "simulated": number_text(simulated, std), "difference": number_text(difference, std)}


def _last_finite(values: np.ndarray | None) -> float | None:
    return None if values is None or not np.isfinite(values[-1]) else float(values[-1])


def _over_frames(record: RunRecord, gauge_readings: list[Reading]) -> tuple[list[str], list[list]]:
    header, columns = _frame_columns(record)
    for reading in gauge_readings:
        stem = f"{reading.gauge.name}.{_with_unit(reading)}"
        for part, values in (("simulated", reading.simulated), ("measured", reading.measured),
                             ("measured_std", reading.std)):
            if values is not None:
                header.append(f"{stem}_{part}")
                columns.append(list(values))
    return header, [list(row) for row in zip(*columns, strict=True)]


def _line(record: RunRecord, gauge: Gauge) -> tuple[list[str], list[list]]:
    """One row per frame and sample; samples beside the specimen are left out."""
    series, unit = record.series, record.series.unit
    gauge_readings, places = readings(series, gauge), gauge.places
    along = np.hypot(*(places - places[0]).T)
    header, columns = _frame_columns(record)
    header += [f"s_{unit}", f"x_{unit}", f"y_{unit}"]
    parts = [(f"{_with_unit(reading)}_{part}", values) for reading in gauge_readings
             for part, values in (("simulated", reading.simulated), ("measured", reading.measured),
                                  ("measured_std", reading.std))
             if values is not None]
    inside = np.flatnonzero(np.isfinite(gauge_readings[0].simulated[0]))
    rows = [[*(column[k] for column in columns), along[i], *places[i], *(values[k, i] for _, values in parts)]
            for k in range(len(series.frames)) for i in inside]
    return header + [name for name, _ in parts], rows


def _frame_columns(record: RunRecord) -> tuple[list[str], list[list]]:
    frames = list(record.series.frames)
    if record.time_label_unit == "s":
        return ["frame", "time_s"], [frames, [record.times[k] for k in frames]]
    return ["frame"], [frames]


def _with_unit(reading: Reading) -> str:
    return reading.quantity if reading.unit == "-" else f"{reading.quantity}_{reading.unit}"
