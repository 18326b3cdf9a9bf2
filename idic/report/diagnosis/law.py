"""Figures of the change of the model by the missing physics: parameters over growing windows, laws before and after."""

from __future__ import annotations

import numpy as np

from idic.report.diagnosis.record import DiagnosisRecord, LawPair
from idic.report.figures.axes.time_axis import label_frames
from idic.report.figures.picture import Colour, Picture
from idic.report.figures.style import look, new_figure, to_picture

MAX_PARAMETERS_SHOWN = 4  # parameters side by side
WIDTH_95 = 1.96
MAX_INTERVAL_PERCENT = 30.0  # half width of an interval that is drawn


def window_courses(record: DiagnosisRecord) -> Picture | None:
    """Every parameter over growing windows of frames: flat where the model is complete."""
    curves = record.windows[:MAX_PARAMETERS_SHOWN]
    if not curves:
        return None
    at = record.abscissa[record.excess_frames]
    with look():
        figure = new_figure(10.0, 1.7 * len(curves) + 1.0)
        axes = np.atleast_1d(figure.subplots(len(curves), 1, sharex=True))
        for axis, curve in zip(axes, curves, strict=True):
            axis.axhline(0.0, color=Colour.GREY, lw=0.7)
            _course(axis, at, curve.value_before, curve.std_before, curve.final, Colour.ORANGE, "before")
            if curve.value_after is not None:
                _course(axis, at, curve.value_after, curve.std_after, curve.final, Colour.BLUE, "after")
            axis.set(ylabel=f"{curve.name} [%]")
        label_frames(axes[-1], f"window up to {record.time_label}", at)
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper left", ncols=2)
        figure.align_ylabels(list(axes))
        reference = "of the enriched model's value" if record.excess_after is not None else "of the identified value"
        return to_picture(figure, "diagnosis_windows", "Parameters over growing windows of frames",
                      f"Deviation in per cent {reference} with 95 % intervals, fitted to the frames of the window "
                      "alone (first order). A parameter that compensates missing physics drifts; under a complete "
                      "model it is flat.")


def _course(axis, at, value, std, final, colour, label) -> None:
    """One curve; intervals wider than `MAX_INTERVAL_PERCENT` are left out."""
    scale = 100.0 / abs(final) if final else np.nan
    percent, half = scale * (value - final), WIDTH_95 * scale * std
    keep = np.isfinite(percent) & (half < MAX_INTERVAL_PERCENT)
    axis.errorbar(at[keep], percent[keep], half[keep], fmt="-o", ms=3, lw=1.2, elinewidth=0.9, color=colour,
                  label=label)


def law_curves(record: DiagnosisRecord) -> tuple[Picture, ...]:
    """Stress-strain curves before and after."""
    return tuple(_law(pair) for pair in record.laws)


def _law(pair: LawPair) -> Picture:
    with look():
        figure = new_figure(6.4, 3.6)
        axis = figure.subplots()
        strain = 100.0 * pair.strain
        axis.plot(strain, pair.stress_before, color=Colour.ORANGE, label=f"before: {pair.laws[0]}")
        axis.plot(strain, pair.stress_after, color=Colour.BLUE, label=f"after: {pair.laws[1]}")
        axis.fill_between(strain, pair.stress_before, pair.stress_after, color=Colour.FAINT, alpha=0.6, lw=0)
        axis.set(xlabel="nominal strain [%]", ylabel="nominal stress [MPa]", xlim=(0.0, strain[-1]))
        axis.legend(loc="best")
        return to_picture(figure, f"diagnosis_law_{pair.name}", f"Law of {pair.name}",
                      "Uniaxial tension of one point in the duration of the test, up to the strain that 99 % of the "
                      "nodes stay within.")
