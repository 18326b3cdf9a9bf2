"""The free curve of a diagnosis with its band."""

from __future__ import annotations

import numpy as np

from idic.report.diagnosis.record import DiagnosisRecord
from idic.report.figures.picture import Colour, Picture
from idic.report.figures.style import look, new_figure, to_picture

WIDTH_95 = 1.96


def free_curve(record: DiagnosisRecord) -> Picture | None:
    """Values at the knots with their 95 % band; None where no free law was offered."""
    entry = record.content["free_form"]
    if not entry:
        return None
    at, value = np.asarray(entry["at"]), np.asarray(entry["value"], dtype=float)
    half = WIDTH_95 * np.array([np.nan if std is None else std for std in entry["std"]], dtype=float)
    with look():
        figure = new_figure(6.4, 3.6)
        axis = figure.subplots()
        axis.fill_between(at, value - half, value + half, color=Colour.BLUE, alpha=0.25, lw=0, label="95 %")
        axis.plot(at, value, "-o", color=Colour.BLUE, ms=3, label=entry["title"])
        axis.set(xlabel=entry["axes"][0], ylabel=entry["axes"][1],
                 xscale="log" if entry["axes"][0].startswith("relaxation time") else "linear")
        axis.legend(loc="best")
        fits = "describes the recording for the most part" if entry["describes"] else "does not describe the recording"
        return to_picture(figure, "diagnosis_free_form", f"{entry['title'].capitalize()} of {entry['material']}",
                          f"Refitted on one copy of the recording, judged on the other: it {fits} "
                          f"({100.0 * (entry['share'] or 0.0):.3g} % of the explainable residual). Shaded: 95 % at the "
                          "knots, from noise, what the law leaves, and the smoothness prior, which decides where the "
                          "test hardly reaches. No named law has this form; the curve is no cause.")
