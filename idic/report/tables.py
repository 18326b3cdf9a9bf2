"""Tables of a run as CSV text, to be read by other programs: plain numbers, one header line, units in it."""

from __future__ import annotations

import csv
import io

import numpy as np

from idic.report.fields.tables import gauge_tables
from idic.report.result.record import RunRecord

PARAMETER_COLUMNS = (
    "name",
    "unit",
    "start",
    "value",
    "std",
    "std_noise",
    "std_model",
    "systematic_std",
    "discretisation_bias",
    "ci95_low",
    "ci95_high",
    "status",
)


def parameters(record: RunRecord) -> str:
    """One row per parameter: unit, start, value, standard deviations and their parts, bias, interval, status."""
    rows = []
    for name, p in record.result["parameters"].items():
        low, high = p.get("ci95") or (None, None)
        rows.append(
            (
                name,
                p.get("unit", ""),
                p.get("start"),
                p.get("value"),
                p.get("std"),
                p.get("std_noise"),
                p.get("std_model"),
                p.get("systematic_std"),
                p.get("discretisation_bias"),
                low,
                high,
                parameter_status(record, name),
            )
        )
    return _csv(PARAMETER_COLUMNS, rows)


def parameter_status(record: RunRecord, name: str) -> str:
    """identified | locked | not determined | at bound"""
    p = record.result["parameters"][name]
    if name in {i["name"] for i in record.result.get("not_identifiable", ())}:
        return "not determined"
    if name in record.result.get("at_bound", ()):
        return "at bound"
    return "identified" if p.get("free") else "locked"


def frames(record: RunRecord) -> str:
    """One row per frame: time, status, residuals, every channel measured and simulated in the unit of its column."""
    timed = record.time_label_unit == "s"  # else the abscissa is the number of the frame once more
    header = ["frame", *([record.time_label.replace(" ", "_")] if timed else []), "label", "status", "rms_before_gv",
              "rms_gv",
              "chi2_dof"]
    for channel in record.channels:
        header += [f"{channel.name}_measured", f"{channel.name}_simulated"]
    rows = []
    for k, f in enumerate(record.result.get("frames", ())):
        start_rms = None if record.rms_before is None else record.rms_before[k]
        row = [
            f.get("frame", k),
            *([f"{record.abscissa[k]:.15g}"] if timed else []),  # milliseconds of 1.7e9 s since 1970, too
            f.get("label"),
            f.get("status"),
            start_rms,
            f.get("rms_gv"),
            f.get("chi2_dof"),
        ]
        for channel in record.channels:
            row += [channel.measured[k], channel.simulated[k]]
        rows.append(row)
    return _csv(header, rows)


def iterations(record: RunRecord) -> str:
    """One row per evaluated point: stage, whether it was accepted, functional, damping, values."""
    header = ["evaluation", "stage", "accepted", "phi", "damping", *record.names]
    rows = [
        [
            h.get("evaluation"),
            h.get("stage"),
            h.get("accepted"),
            h.get("phi"),
            h.get("damping"),
            *(h["values"].get(n) for n in record.names),
        ]
        for h in record.history
    ]
    return _csv(header, rows)


def correlation(record: RunRecord) -> str:
    """Correlation coefficients of the identified parameters, one row each."""
    table = record.result.get("correlation", {})
    names = list(table.get("names", ()))
    return _csv(["name", *names], [[n, *row] for n, row in zip(names, table.get("matrix", ()), strict=False)])


CRACK_VALUES = ("length_mm", "K_I", "K_II", "J")
CRACK_UNITS = {"length_mm": "", "K_I": "_MPa_sqrt_m", "K_II": "_MPa_sqrt_m", "J": "_N_per_mm"}


def cracks(record: RunRecord) -> str:
    """One row per crack and frame: length, stress intensity factors and J, each with its standard deviation."""
    names = [f"{value}{part}" for value in CRACK_VALUES for part in ("", "_std")]
    header = [f"{value}{CRACK_UNITS[value]}{part}" for value in CRACK_VALUES for part in ("", "_std")]
    rows = [[name, frame, *(entry[column][k] for column in names)]
            for name, entry in record.result.get("cracks", {}).items() for k, frame in enumerate(entry["frames"])]
    return _csv(["crack", "frame", *header], rows)


def all_tables(record: RunRecord) -> dict[str, str]:
    """File name → CSV text."""
    return {
        "parameters.csv": parameters(record),
        "frames.csv": frames(record),
        "iterations.csv": iterations(record),
        "correlation.csv": correlation(record),
    } | ({"cracks.csv": cracks(record)} if record.result.get("cracks") else {}) | {
        name: _csv(header, rows) for name, (header, rows) in gauge_tables(record).items()}


def _csv(header, rows) -> str:
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([_cell(v) for v in row] for row in rows)
    return buffer.getvalue()


def _cell(value):
    if value is None:
        return ""
    if isinstance(value, (float, np.floating)):
        return f"{float(value):.10g}" if np.isfinite(value) else ""
    return value
