"""Tables in the terminal: an identification, its systematic errors, the constitutive laws."""

from __future__ import annotations

from collections.abc import Mapping

from rich.table import Table

MIN_SHOWN_PART = 0.01  # of a standard deviation, due to the model: its parts are shown


def result_table(result: Mapping, truth: Mapping | None = None) -> Table:
    """Free parameters: value ± standard deviation, its parts where the model has one, start, and a known truth.

    Parameters
    ----------
    result : the content of ``RUN/result.json``
    truth : the content of ``truth.json`` of an example
    """
    from idic.model import is_mode
    from idic.report import in_ratios, parts_of_std, two_digits, virtual_boundaries

    true_values = (truth or {}).get("parameters", {})
    result = result if true_values else in_ratios(result)  # of an example the truth is known in MPa
    identified = {name: entry for name, entry in result.get("parameters", {}).items() if entry.get("free")
            and not is_mode(name)}
    derived = result.get("derived", {})
    in_parts = any(_is_wider(entry) for entry in (*identified.values(), *derived.values()))
    table = Table(box=None, header_style="bold")
    for column in ("parameter", "value", "± std", *(["noise, model"] if in_parts else []), "unit", "start",
                   *(["truth", "error / std"] if true_values else [])):
        table.add_column(column, justify="left" if column in ("parameter", "unit") else "right")

    def errors(entry: Mapping) -> list[str]:
        std = entry.get("std")
        cells = ["-" if std is None else two_digits(std), "-" if std is None else parts_of_std(entry)]
        return cells if in_parts else cells[:1]

    for name, entry in identified.items():
        value, std, target = entry["value"], entry.get("std"), true_values.get(name)
        cells = [_number(value, std), *errors(entry)]
        if std is None:
            cells[:2] = ["-", "not determined"]
        row = [name, *cells, entry.get("unit", ""), _number(entry.get("start"))]
        if true_values:
            row += [_number(target), f"{(value - target) / std:+.1f}" if target is not None and std else "-"]
        table.add_row(*row)
    ends = ["-", "-"] if true_values else []
    for entry in virtual_boundaries(result):
        table.add_row(entry["name"], entry["text"], entry["std"], *(["-"] if in_parts else []), entry["unit"], "-",
                      *ends)
    for name, entry in derived.items():
        table.add_row(name, _number(entry["value"], entry.get("std")), *errors(entry), entry.get("unit", ""), "-",
                      *ends)
    return table


def _is_wider(entry: Mapping) -> bool:
    """Whether the misfit of the model is seen in a standard deviation."""
    return bool(entry.get("std_model")) and entry["std_model"] > MIN_SHOWN_PART * entry["std"]


def remarks(result: Mapping) -> list[str]:
    """Warnings below the result: a bad fit, parameters that are not determined, frames left out."""
    from idic.report import advice, between_specimens, held_stresses, in_words_of, left_out, not_explained, undetermined

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
        from idic.report import against_free, in_words_of

        free_motion = against_free(result)
        reference = ("" if free_motion is None else "; the free FE-DIC failed" if free_motion.failed
                     else f"; free FE-DIC: {free_motion.free_chi2:.2f}")
        parts.append(f"chi2 per pixel {chi2:.2f} (1: only noise is left{reference})")
        parts[-1] = in_words_of(result, parts[-1])
    return ", ".join(parts)


def systematic_table(result: Mapping) -> Table:
    """Value, standard deviation, discretisation bias and systematic spread of every free parameter and every ratio."""
    from idic.model import is_mode
    from idic.report import two_digits

    table = Table(box=None, header_style="bold")
    for column in ("parameter", "value", "± std", "mesh", "systematic", "unit"):
        text = column in ("parameter", "unit")
        table.add_column(column, justify="left" if text else "right", no_wrap=text)
    for name, entry in (result["parameters"] | result["derived"]).items():
        if entry.get("free", True) and not is_mode(name):
            errors = (entry.get(key) for key in ("std", "discretisation_bias", "systematic_std"))
            table.add_row(name, _number(entry.get("value"), entry.get("std")),
                          *("-" if error is None else two_digits(error) for error in errors), entry.get("unit", ""))
    return table


def treatments_table(result: Mapping) -> Table | str:
    """Identified values under every treatment of boundary and camera."""
    from idic.report import treatment_table

    treatments = treatment_table(result)
    if treatments is None:
        return "no other treatment of boundary and camera to compare with"
    table = Table("boundary", "camera", "status", *treatments.quantities, box=None, header_style="bold")
    for row in treatments.rows:
        table.add_row(*row)
    return table


def laws_table(laws) -> Table:
    """All laws with parameters, units, null values.

    Parameters
    ----------
    laws : iterable of idic.laws.core.law.LawSpec
    """
    from idic.laws import ELASTOPLASTIC as COMPOSED, EXPANSION

    table = Table(box=None, header_style="bold")
    for column in ("law", "kinematics", "parameter", "unit", "null", "typical"):
        table.add_column(column, no_wrap=True)
    table.add_column("meaning", overflow="fold")
    for law in laws:
        first = [law.name, ", ".join(law.kinematics)]
        for parameter in law.parameters:
            table.add_row(*first, parameter.name, parameter.unit, _number(parameter.null), _number(parameter.default),
                          parameter.description)  # fmt: skip
            first = ["", ""]
        if law.compose is not None and law.name == COMPOSED:
            _add_terms(table)
    table.add_row("every law", "", EXPANSION.name, EXPANSION.unit, _number(EXPANSION.null), _number(EXPANSION.default),
                  EXPANSION.description)  # fmt: skip
    return table


def _add_terms(table: Table) -> None:
    """The terms that the composed law may have; n counts the terms of a list from 1."""
    from idic.laws import LISTS, TEMPERATURE_TERMS, TERMS

    for term in (*TERMS.values(), *TEMPERATURE_TERMS.values()):
        head = [f"  + {term.kind}", term.group]
        stem = f"{term.group}_n" if term.group in LISTS else term.group
        for parameter in term.parameters:
            table.add_row(*head, f"{stem}_{parameter.name}", parameter.unit, _number(parameter.null),
                          _number(parameter.default), parameter.description)  # fmt: skip
            head = ["", ""]
        if not term.parameters:
            table.add_row(*head, "", "", "", "", f"{term.equation} (default)")


def number_with_std(value: float, std: float) -> tuple[str, str]:
    """A value with as many digits as its standard deviation supports, and that deviation to two digits."""
    from idic.report import two_digits

    return _number(value, std), two_digits(std)


def _number(value, std=None) -> str:
    """The value with as many digits as its standard deviation supports (two digits of it), six without one."""
    if value is None:
        return "-"
    if not std:
        return f"{value:.6g}"
    from math import floor, log10

    decimals = max(0, 1 - floor(log10(abs(std))))
    return f"{value:.{decimals}f}" if decimals < 10 else f"{value:.6g}"
