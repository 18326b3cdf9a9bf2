"""An identification in the terminal: its values, what to say of them, and its systematic errors."""

from __future__ import annotations

from collections.abc import Mapping
from math import floor, log10

from idic.model import is_mode
from idic.report.result.fit_words import against_free, in_words_of
from idic.report.result.stress_scale import held_stresses, in_ratios
from idic.report.result.words import (
    advice, between_specimens, left_out, not_explained, parts_of_std, two_digits, undetermined, virtual_boundaries,
)
from idic.report.terminal.text_table import TextTable
from idic.report.treatments import treatment_table

MIN_SHOWN_PART = 0.01  # of a standard deviation, due to the model: its parts are shown


def result_table(result: Mapping, truth: Mapping | None = None) -> TextTable:
    """Free parameters: value ± standard deviation, its parts where the model has one, start, and a known truth.

    Parameters
    ----------
    result : the content of ``RUN/result.json``
    truth : the content of ``truth.json`` of an example
    """
    true_values = (truth or {}).get("parameters", {})
    result = result if true_values else in_ratios(result)  # of an example the truth is known in MPa
    identified = {name: entry for name, entry in result.get("parameters", {}).items() if entry.get("free")
            and not is_mode(name)}
    derived = result.get("derived", {})
    in_parts = any(_is_wider(entry) for entry in (*identified.values(), *derived.values()))
    table = TextTable(("parameter", "value", "± std", *(["noise, model"] if in_parts else []), "unit", "start",
                       *(["truth", "error / std"] if true_values else [])), frozenset(("parameter", "unit")))

    def errors(entry: Mapping) -> list[str]:
        std = entry.get("std")
        cells = ["-" if std is None else two_digits(std), "-" if std is None else parts_of_std(entry)]
        return cells if in_parts else cells[:1]

    for name, entry in identified.items():
        value, std, target = entry["value"], entry.get("std"), true_values.get(name)
        cells = [number_to_std(value, std), *errors(entry)]
        if std is None:
            cells[:2] = ["-", "not determined"]
        row = [name, *cells, entry.get("unit", ""), number_to_std(entry.get("start"))]
        if true_values:
            row += [number_to_std(target), f"{(value - target) / std:+.1f}" if target is not None and std else "-"]
        table.add_row(*row)
    ends = ["-", "-"] if true_values else []
    for entry in virtual_boundaries(result):
        table.add_row(entry["name"], entry["text"], entry["std"], *(["-"] if in_parts else []), entry["unit"], "-",
                      *ends)
    for name, entry in derived.items():
        table.add_row(name, number_to_std(entry["value"], entry.get("std")), *errors(entry), entry.get("unit", ""), "-",
                      *ends)
    return table


def _is_wider(entry: Mapping) -> bool:
    """Whether the misfit of the model is seen in a standard deviation."""
    return bool(entry.get("std_model")) and entry["std_model"] > MIN_SHOWN_PART * entry["std"]


def remarks(result: Mapping) -> list[str]:
    """Warnings below the result: a bad fit, parameters that are not determined, frames left out."""
    texts = (held_stresses(result), *between_specimens(result), *advice(result), undetermined(result),
             not_explained(result),
             left_out(result))
    return [in_words_of(result, text) for text in texts if text]


def summary_line(result: Mapping) -> str:
    """Status, iterations, time and chi2 per pixel of the images in one line."""
    chi2, cost = result.get("residual", {}).get("image_chi2_dof"), result.get("cost", {})
    parts = [result.get("status", "?"), f"{result.get('iterations', '?')} iterations"]
    if cost.get("wall_s") is not None:
        parts.append(f"{cost['wall_s']:.1f} s")
    if chi2 is not None:
        free_motion = against_free(result)
        reference = ("" if free_motion is None else "; the free FE-DIC failed" if free_motion.failed
                     else f"; free FE-DIC: {free_motion.free_chi2:.2f}")
        parts.append(f"chi2 per pixel {chi2:.2f} (1: only noise is left{reference})")
        parts[-1] = in_words_of(result, parts[-1])
    return ", ".join(parts)


def systematic_table(result: Mapping) -> TextTable:
    """Value, standard deviation, discretisation bias and systematic spread of every free parameter and every ratio."""
    words = frozenset(("parameter", "unit"))
    table = TextTable(("parameter", "value", "± std", "mesh", "systematic", "unit"), words, words)
    for name, entry in (result["parameters"] | result["derived"]).items():
        if entry.get("free", True) and not is_mode(name):
            errors = (entry.get(key) for key in ("std", "discretisation_bias", "systematic_std"))
            table.add_row(name, number_to_std(entry.get("value"), entry.get("std")),
                          *("-" if error is None else two_digits(error) for error in errors), entry.get("unit", ""))
    return table


def treatments_table(result: Mapping) -> TextTable | str:
    """Identified values under every treatment of boundary and camera."""
    treatments = treatment_table(result)
    if treatments is None:
        return "no other treatment of boundary and camera to compare with"
    titles = ("boundary", "camera", "status", *treatments.quantities)
    return TextTable(titles, frozenset(titles), rows=list(treatments.rows))


def number_with_std(value: float, std: float) -> tuple[str, str]:
    """A value with as many digits as its standard deviation supports, and that deviation to two digits."""
    return number_to_std(value, std), two_digits(std)


def number_to_std(value, std=None) -> str:
    """The value with as many digits as its standard deviation supports (two digits of it), six without one."""
    if value is None:
        return "-"
    if not std:
        return f"{value:.6g}"
    decimals = max(0, 1 - floor(log10(abs(std))))
    return f"{value:.{decimals}f}" if decimals < 10 else f"{value:.6g}"
