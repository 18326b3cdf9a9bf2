"""The figures of a diagnosis: residual before and after, ranking, parameters, excess over time, channels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from idic.report.diagnosis.record import KNOWN_ERROR_COUNTED, Curve, DiagnosisRecord
from idic.report.diagnosis.words import is_sure, name_of_best, strongest
from idic.report.figures.axes.time_axis import label_frames
from idic.report.figures.picture import Colour, Picture
from idic.report.figures.style import DIVERGING, look, new_figure, show_pixels, to_picture
from idic.report.result.words import short_names

COLOUR_LIMIT_STD = 5.0  # standard deviations at the ends of the colour bar
ONE_TEST_Z = 2.33  # of a single one-sided test at 1 %
CANDIDATES_SHOWN = 12  # candidates in the ranking
MAPS_WIDTH_SHARE = 0.87  # of the width: maps beside their colour bar


def residual_maps(record: DiagnosisRecord) -> tuple[Picture, ...]:
    """Residual in standard deviations before, after, on the held-out copy and of noise alone: a picture per camera."""
    return tuple(_residual_maps(record, camera, maps) for camera, maps in record.residuals)


def _residual_maps(record: DiagnosisRecord, camera: str, maps: Sequence[tuple[str, np.ndarray]]) -> Picture:
    """The maps of one camera with one colour bar."""
    cropped = _cropped(maps)
    ny, nx = cropped[0][1].shape
    n = len(cropped)
    columns = n if nx < 0.8 * ny else 1 if nx > 4 * ny else min(n, 2)
    rows = -(-n // columns)
    width = 10.0
    height = min(max(rows * (MAPS_WIDTH_SHARE * width / columns) * ny / nx + 0.35 * rows + 0.3, 2.4), 10.0)
    with look():
        figure = new_figure(width, height)
        axes = np.atleast_1d(figure.subplots(rows, columns)).ravel()
        for axis, (label, image) in zip(axes, cropped, strict=False):
            drawn = show_pixels(axis, image, cmap=DIVERGING, vmin=-COLOUR_LIMIT_STD, vmax=COLOUR_LIMIT_STD,
                                interpolation="nearest")
            axis.set(title=f"{label}: rms {np.sqrt(np.nanmean(image**2)):.2f} σ", xticks=[], yticks=[])
            axis.grid(False)
            for side in axis.spines.values():
                side.set_visible(False)
        for axis in axes[n:]:
            axis.set_axis_off()
        figure.colorbar(drawn, ax=list(axes), label="residual [σ of noise]", shrink=0.8, aspect=30)
        return to_picture(figure, f"diagnosis_residual{camera and '_' + camera}",
                          f"Residual of frame {record.frame} in standard deviations{camera and ', camera ' + camera}",
                          "The frame with the largest excess, or with the largest motion where the identified model "
                          "leaves more there, "
                          + ("before and with its errors of mesh and thickness counted, "
                             if KNOWN_ERROR_COUNTED in dict(maps) else
                             "before and after the enrichment, " if len(maps) > 2 else "")
                          + "and a draw of noise with an rms of 1 (independent from pixel to pixel; interpolation "
                          "smooths the noise of a residual).", as_photo=True)


def excess_course(record: DiagnosisRecord) -> Picture:
    """Held-out excess of every frame, before and after."""
    at = record.abscissa[record.excess_frames]
    with look():
        figure = new_figure(10.0, 2.9)
        axis = figure.subplots()
        axis.fill_between(at, -2 * record.excess_std, 2 * record.excess_std, color=Colour.FAINT, alpha=0.8, lw=0,
                          label="noise (95 %)")
        axis.plot(at, record.excess_before, "-o", color=Colour.ORANGE, label="before")
        if record.excess_after is not None:
            axis.plot(at, record.excess_after, "-s", color=Colour.BLUE, label="after")
        largest = float(np.max(np.abs(record.excess_before), initial=0.0))
        if largest > 20.0 * float(record.excess_std.max(initial=1.0)):
            linear = float(2.0 * record.excess_std.max())
            axis.set_yscale("symlog", linthresh=linear)
            axis.set_yticks(_decades(linear, *axis.get_ylim()))
        axis.set_ylabel("excess [–]")
        label_frames(axis, record.time_label, at)
        figure.legend(ncols=3, loc="outside upper left")
        _mark_onset(axis, record)
        return to_picture(figure, "diagnosis_excess", "Held-out excess over time",
                      "Drop of χ² by free smooth motions beyond its expectation under noise, per motion: 0 for a "
                      "complete "
                      "model. Measured on the held-out copy of the recording; where both copies judged, on each after "
                      "a fit to the other.")


def ranking(record: DiagnosisRecord) -> Picture | None:
    """Score of every candidate, and the predicted against the achieved drop of those refitted."""
    entries = [c for c in strongest(record.content, CANDIDATES_SHOWN) if c["score"] is not None]
    if not entries:
        return None
    refitted = [(row, c) for row, c in zip(range(len(entries) - 1, -1, -1), entries, strict=True) if c["refitted"]]
    with look():
        figure = new_figure(10.0, 0.34 * len(entries) + 1.5)
        score_axis, *drop_axes = figure.subplots(1, 2 if refitted else 1, sharey=True, squeeze=False)[0]
        handles = _scores(score_axis, record, entries)
        for drop_axis in drop_axes:
            for row, entry in refitted:
                for offset, key, colour in ((0.17, "predicted_chi2_drop", Colour.GREY),
                                            (-0.17, "achieved_chi2_drop", Colour.BLUE)):
                    drop_axis.barh(row + offset, max(entry[key] or 0.0, 0.0), height=0.3, color=colour)
            drop_axis.set(xlabel="drop of χ² [–]", title="Drop of χ², predicted and achieved", xlim=(0.0, None))
            drop_axis.ticklabel_format(axis="x", style="sci", scilimits=(-3, 5))
            handles += [Patch(color=Colour.GREY, label="predicted"),
                        Patch(color=Colour.BLUE, label="achieved by the refit")]
        figure.legend(handles=handles, loc="outside lower center", ncols=6)
        return to_picture(figure, "diagnosis_ranking", "Candidates",
                          f"{'Left: score' if refitted else 'Score'} of the best variant of each candidate. The dotted "
                          "line is the 1 % level of a single test; the decision is family-wise."
                          + (" Right: drop of χ² predicted by the score and achieved by the refit." if refitted else
                             " No candidate was refitted."))


def _scores(axis, record: DiagnosisRecord, entries) -> list[Patch]:
    """Bars of the scores; the entries of the legend that occur."""
    y, colours = np.arange(len(entries))[::-1], [_colour(record, c) for c in entries]
    hollow = [_in_set(record, c) for c in entries]
    axis.barh(y, [_bar(c) for c in entries], height=0.62, edgecolor=colours, linewidth=1.2,
              color=["white" if is_hollow else colour for is_hollow, colour in zip(hollow, colours, strict=True)])
    axis.axvline(ONE_TEST_Z, color=Colour.BLACK, lw=0.8, ls=":")
    largest = max([ONE_TEST_Z, *map(_bar, entries)])
    for row, entry in zip(y, entries, strict=True):
        score = entry["score"]
        axis.text(_bar(entry) + 0.01 * largest, row, f"{score:.0f}" if abs(score) >= 100.0 else f"{score:.3g}",
                  va="center", fontsize=8, color=Colour.GREY)
    axis.set(yticks=y, xlabel="score [standard deviations]", title="Score", xlim=(0.0, 1.12 * largest))
    axis.set_yticklabels([_label(record, c) for c in entries])
    names = {_best_colour(record): name_of_best(record.content), Colour.ORANGE: "significant by score",
             Colour.SKY: "significant, below the practical margin", Colour.FAINT: "not significant"}
    filled = {colour for is_hollow, colour in zip(hollow, colours, strict=True) if not is_hollow}
    return [Patch(facecolor=colour, label=name) for colour, name in names.items() if colour in filled] + [
        Patch(facecolor="white", edgecolor=_best_colour(record), label="indistinguishable")] * any(hollow)


def parameters(record: DiagnosisRecord) -> Picture | None:
    """Change of every parameter, in its standard deviations and in per cent."""
    identified, enriched = (record.content["model"][key] for key in ("parameters_before", "parameters_after"))
    names = [n for n in identified if n in enriched and identified[n]["value"] and enriched[n]["std"] is not None]
    if not names:
        return None
    labels = short_names(enriched)
    with look():
        figure = new_figure(10.0, 0.45 * len(names) + 1.2)
        axis = figure.subplots()
        y = np.arange(len(names))[::-1]
        for row, name in zip(y, names, strict=True):
            reference, scale = enriched[name]["value"], _percent_of(identified[name], enriched[name])
            for entry, colour, marker in ((identified[name], Colour.ORANGE, "o"), (enriched[name], Colour.BLUE, "s")):
                axis.errorbar(100.0 * (entry["value"] - reference) / scale, row, fmt=marker, color=colour, capsize=3,
                              xerr=100.0 * 1.96 * (entry["std"] or 0.0) / scale)
        axis.axvline(0.0, color=Colour.GREY, lw=0.7)
        axis.set(yticks=y, xlabel="deviation from the value after [%], 95 % intervals", ylim=(-0.6, len(names) - 0.4))
        axis.set_yticklabels([labels[n] for n in names])
        axis.legend(handles=[Patch(color=Colour.ORANGE, label="before"), Patch(color=Colour.BLUE, label="after")],
                    loc="best")
        return to_picture(figure, "diagnosis_parameters", "Parameters before and after",
                      "The parameters of the identified model are biased by the missing physics. The enriched model "
                      "removes the bias. Of a parameter that the enriched model leaves at zero, 100 % is the value "
                      "before.")


def _percent_of(identified: dict, enriched: dict) -> float:
    """What 100 % is: the value after; the one before of a parameter that the cause made zero (a hardening modulus
    beside a back stress)."""
    size = abs(enriched["value"])
    return size if size > enriched["std"] else max(size, abs(identified["value"]))


def channel(record: DiagnosisRecord, curve: Curve) -> Picture:
    """A channel and its residual in standard deviations before and after."""
    with look():
        figure = new_figure(10.0, 4.0)
        top, strip = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
        top.plot(record.abscissa, curve.measured, "o", color=Colour.BLACK, ms=3, label="measured")
        top.plot(record.abscissa, curve.simulated_before, "-", color=Colour.ORANGE, label="before")
        strip.axhspan(-2, 2, color=Colour.FAINT, alpha=0.8, lw=0)
        strip.plot(record.abscissa, (curve.measured - curve.simulated_before) / curve.std, "-o", color=Colour.ORANGE)
        if curve.simulated_after is not None:
            top.plot(record.abscissa, curve.simulated_after, "--", color=Colour.BLUE, label="after")
            strip.plot(record.abscissa, (curve.measured - curve.simulated_after) / curve.std, "-s", color=Colour.BLUE)
        top.set(ylabel=f"{curve.name} [{curve.unit}]")
        strip.set_ylabel("residual [σ]")
        label_frames(strip, record.time_label, record.abscissa)
        strip.yaxis.set_major_locator(MaxNLocator(4))
        top.legend(ncols=3, loc="best")
        return to_picture(figure, f"diagnosis_{curve.name}", f"{curve.name}: measured and simulated",
                      "Below: measured minus simulated in standard deviations of a reading; the band is 95 % of noise.")


def _decades(linear: float, low: float, high: float) -> list[float]:
    """Ticks of an axis that is linear up to `linear` and logarithmic beyond: those of its linear part would overlap."""
    first = int(np.ceil(np.log10(linear)))
    powers = [10.0**k for k in range(first, int(np.floor(np.log10(max(high, -low, 10.0**first)))) + 1)]
    return [-x for x in powers[::-1] if -x >= low] + [0.0] + [x for x in powers if x <= high]


def _cropped(residuals):
    """The maps without their empty margin."""
    finite = np.any([np.isfinite(image) for _, image in residuals], axis=0)
    rows, columns = np.flatnonzero(finite.any(axis=1)), np.flatnonzero(finite.any(axis=0))
    cut = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    return [(label, image[cut]) for label, image in residuals]


def _mark_onset(axis, record: DiagnosisRecord) -> None:
    onset = record.content["mismatch"].get("onset_frame")
    if not onset:
        return
    axis.axvline(record.abscissa[onset], color=Colour.RED, lw=0.9)
    span = record.content["mismatch"].get("onset_ci")
    if span:
        axis.axvspan(record.abscissa[span[0]], record.abscissa[span[1]], color=Colour.RED, alpha=0.15, lw=0)


def _bar(entry) -> float:
    return max(entry["score"], 0.0)


def _in_set(record: DiagnosisRecord, entry) -> bool:
    return any(entry["name"] in group for group in record.content["indistinguishable"])


def _colour(record: DiagnosisRecord, entry) -> str:
    if entry["named"] or _in_set(record, entry):
        return _best_colour(record)
    return {"significant": Colour.ORANGE, "small": Colour.SKY}.get(entry["standing"], Colour.FAINT)


def _best_colour(record: DiagnosisRecord) -> str:
    """Of the selected candidate: green is for good news alone."""
    return Colour.GREEN if is_sure(record.content) else Colour.BLUE


def _label(record: DiagnosisRecord, entry) -> str:
    form = f" ({entry['form']})" if entry.get("form") else ""
    return record.titles.get(entry["name"], entry["name"].replace("_", " ")) + form


def courses(record: DiagnosisRecord) -> Picture | None:
    """Amplitude over time of every selected cause that is no material, with its band."""
    entries = record.content.get("courses") or []
    if not entries:
        return None
    with look():
        figure = new_figure(10.0, 2.6 * len(entries))
        axes = np.atleast_1d(figure.subplots(len(entries), 1, sharex=True, squeeze=False).ravel())
        for axis, entry in zip(axes, entries, strict=True):
            value, std = np.array(entry["value"]), np.array(entry["std"])
            jumps = entry["jumps"]
            axis.fill_between(record.abscissa, value - 1.96 * std, value + 1.96 * std, color=Colour.BLUE, alpha=0.25,
                              lw=0, label="95 %", step="post" if jumps else None)
            axis.plot(record.abscissa, value, "-o", color=Colour.BLUE, ms=3, label="amplitude",
                      drawstyle="steps-post" if jumps else "default")
            axis.axhline(0.0, color=Colour.GREY, lw=0.8)
            if entry["onset_frames"]:
                start, end = (record.abscissa[k] for k in entry["onset_frames"])
                axis.axvspan(start, end, color=Colour.FAINT, alpha=0.8, lw=0, label="onset")
            origin = "determined by the data" if entry["free"] else "of the candidate"
            title = record.titles.get(entry["name"], entry["name"].replace("_", " "))
            axis.set(title=f"{title}: {entry['parameter']}, course {origin}", ylabel=f"[{entry['unit'] or '–'}]")
        label_frames(axes[-1], record.time_label, record.abscissa)
        axes[0].legend(ncols=3, loc="best")
        return to_picture(figure, "diagnosis_courses", "Time course of a cause other than the material",
                          "Amplitude of the cause in every frame. A candidate acts as a ramp, a jump or in "
                          "proportion; where this leaves a residual, the time course is identified, linear between "
                          "knots or in a few jumps.")
