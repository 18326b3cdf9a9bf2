"""Charts over iterations and frames: convergence, residual level, measured against simulated channels."""

from __future__ import annotations

import numpy as np
from matplotlib.ticker import MaxNLocator

from idic.parameters import digits_text
from idic.report.figures.axes.time_axis import label_frames
from idic.report.figures.picture import CYCLE, Colour, Picture
from idic.report.figures.style import MARKERS, look, new_figure, to_picture
from idic.report.result.fit_words import in_words_of
from idic.report.result.record import ChannelRecord, RunRecord
from idic.report.result.words import short_names

MIN_LABEL_SHARE = 0.5  # of the axis: two labels need it between their frames
LABEL_MARGIN = 0.13  # of the axis: half a label
MIN_LOG_AXIS_RATIO = 5.0  # below this ratio a logarithmic axis has hardly a labelled tick


def convergence(record: RunRecord) -> Picture | None:
    """Functional, relative values and distance in standard deviations over the iterations."""
    if not record.history:
        return None
    accepted = [h for h in record.history if h["accepted"]]
    rejected = [h for h in record.history if not h["accepted"] and h["phi"] is not None]
    if not accepted:
        return None
    with look():
        figure = new_figure(10.0, 3.1)
        functional, ratios, distances = figure.subplots(1, 3)
        functional.semilogy(
            [h["evaluation"] for h in accepted], [h["phi"] for h in accepted], "-o", color=Colour.BLUE, label="accepted"
        )
        if rejected:
            functional.semilogy(
                [h["evaluation"] for h in rejected], [h["phi"] for h in rejected], "x", color=Colour.RED,
                label="rejected"
            )
            functional.legend()
        phi = [h["phi"] for h in (*accepted, *rejected)]
        if max(phi) < MIN_LOG_AXIS_RATIO * min(phi):
            functional.set_yscale("linear")
        functional.set(title="Functional", ylabel="Φ [–]")
        names = [n for n in record.names if n in accepted[-1]["values"]]
        short = short_names(record.result["parameters"])
        for i, name in enumerate(names):
            _trace(ratios, distances, record, accepted, name, short.get(name, name), i)
        ratios.axhline(1.0, color=Colour.GREY, lw=0.7)
        ratios.set(title="Value / identified value", ylabel="ratio [–]")
        limits = distances.get_ylim()
        distances.axhspan(1e-30, 1.0, color=Colour.FAINT, alpha=0.5, lw=0)
        distances.set(ylim=limits, title="Distance from the identified value", ylabel="standard deviations [–]")
        for axis in (functional, ratios, distances):
            axis.set_xlabel("evaluation")
            axis.xaxis.set_major_locator(MaxNLocator(integer=True))
            axis.set_xlim(-0.4, max(h["evaluation"] for h in record.history) + 0.4)
            _mark_stages(axis, accepted)
        if names:
            handles, labels = ratios.get_legend_handles_labels()
            figure.legend(handles, labels, loc="outside lower center", ncols=min(6, len(labels)))
        caption = "Shaded: one standard deviation. Changes inside the band are insignificant."
        if len({h["stage"] for h in accepted}) > 1:
            caption += " Dotted: start of a stage of the schedule."
        return to_picture(figure, "convergence", "Convergence", caption)


def residual_level(record: RunRecord) -> Picture | None:
    """Rms image residual per frame, before and after, in grey values (heights) and relative to noise alone."""
    if record.rms_after is None:
        return None
    with look():
        figure = new_figure(7.2, 3.2)
        axis = figure.subplots()
        x = record.abscissa
        expected, used = record.noise_level, _used(record)
        excluded = _excluded(record)
        identified = np.where(used & ~excluded, record.rms_after, np.nan)
        if expected is not None and len(expected) == len(x):
            axis.plot(x, expected, color=Colour.FAINT, lw=5.0, solid_capstyle="butt",
                      label=in_words_of(record.result, "camera noise alone"))
        if record.rms_before is not None:
            axis.plot(x, record.rms_before, "--", color=Colour.ORANGE, marker="s", ms=3, label="starting values")
        axis.plot(x, identified, "-o", color=Colour.BLUE, ms=3.5, label="identified values")
        axis.set(ylabel=f"rms residual [{record.value_unit}]")
        _frame_axis(axis, record)
        start = np.where(used & ~excluded, np.nan if record.rms_before is None else record.rms_before, np.nan)
        finite = np.concatenate([v[np.isfinite(v)] for v in (identified, start)])
        used = used | excluded  # those of the user are no discovery: they get no ring
        top = 1.15 * (finite.max() if len(finite) else np.nanmax(record.rms_after))
        axis.set_ylim(0.0, top)
        _mark_left_out(axis, record, used, top)
        if expected is not None:
            sigma = float(np.nanmedian(expected))
            second = axis.secondary_yaxis("right", functions=(lambda y: y / sigma, lambda s: s * sigma))
            second.set_ylabel("rms residual / noise alone [–]")
        figure.legend(loc="outside upper left", ncols=4)
        return to_picture(
            figure,
            "residual_level",
            "Image residual per frame",
            "Grey: residual of camera noise alone, after interpolation and low-pass. Red: frames that are lost or that "
            "the model does not explain; a triangle stands for a residual beyond the axis, its value next to it.",
        )


def _used(record: RunRecord) -> np.ndarray:
    """Frames that took part and are explained  # (n_frames,) bool"""
    statuses = [f.get("status", "ok") for f in record.result.get("frames", ())] or ["ok"] * record.n_frames
    return np.array([s not in ("lost", "unexplained") for s in statuses])


def _frame_axis(axis, record: RunRecord) -> None:
    """All frames from edge to edge."""
    label_frames(axis, record.time_label, record.abscissa)


def _excluded(record: RunRecord) -> np.ndarray:
    """Frames that the user has excluded  # (n_frames,) bool"""
    return np.array([f.get("status") == "excluded" for f in record.result.get("frames", ())]
                    or [False] * record.n_frames)


def _mark_left_out(axis, record: RunRecord, used: np.ndarray, top: float) -> None:
    """Red rings around lost and unexplained frames; triangles with their values where they are beyond the axis."""
    x, y = record.abscissa, record.rms_after
    out = ~used & np.isfinite(y)
    inside, beyond = out & (y < top), out & (y >= top)
    if inside.any():
        axis.plot(x[inside], y[inside], "o", mfc="none", mec=Colour.RED, ms=8, ls="none", label="lost or unexplained")
    if not beyond.any():
        return
    axis.plot(x[beyond], np.full(beyond.sum(), 0.94 * top), "^", mfc="none", mec=Colour.RED, ms=8, ls="none",
              label="lost or unexplained, beyond the axis")
    span = float(np.ptp(x)) or 1.0
    for group in _groups(np.flatnonzero(beyond), x, MIN_LABEL_SHARE * span):
        low, high = y[group].min(), y[group].max()
        text = f"{low:.3g}" if len(group) == 1 else f"{low:.3g} to {high:.3g}"
        middle = np.clip(x[group].mean(), x.min() + LABEL_MARGIN * span, x.max() - LABEL_MARGIN * span)
        axis.annotate(text, (middle, 0.94 * top), (0, -11), textcoords="offset points", color=Colour.RED, fontsize=8,
                      ha="center",
                      va="center",
                      bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5, "alpha": 0.85})


def _groups(numbers: np.ndarray, x: np.ndarray, room: float) -> list[np.ndarray]:
    """Frames whose labels would overprint stand under one label."""
    starts = np.flatnonzero(np.diff(x[numbers]) > room) + 1
    return np.split(numbers, starts)


def channel(record: RunRecord, data: ChannelRecord) -> Picture:
    """One measured channel, its simulation, and their difference with a band of two standard deviations."""
    with look():
        figure = new_figure(7.2, 4.2)
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1.0))
        x = record.abscissa
        if data.started is not None:
            top.plot(x, data.started, "--", color=Colour.ORANGE, lw=1.1, label="simulated, starting values")
        top.plot(x, np.where(_excluded(record), np.nan, data.simulated), "-", color=Colour.BLUE,
                 label="simulated, identified values")
        top.plot(x, data.measured, "o", color="#222222", ms=3.5, label="measured")
        label = data.name.rsplit("_", 1)[0].replace("_", " ") if data.name.endswith("_" + data.unit) else data.name
        top.set_ylabel(f"{label} [{data.unit}]")
        top.legend()
        difference = np.where(_excluded(record), np.nan, np.asarray(data.measured) - np.asarray(data.simulated))
        if data.std:
            bottom.axhspan(-2.0 * data.std, 2.0 * data.std, color=Colour.FAINT, alpha=0.6, lw=0)
        bottom.axhline(0.0, color=Colour.GREY, lw=0.7)
        bottom.plot(x, difference, "-o", color=Colour.BLUE, lw=0.8, ms=3.5)
        reach = 1.25 * max(np.nanmax(np.abs(difference), initial=0.0, where=np.isfinite(difference)),
                           2.0 * (data.std or 0.0),
                           1e-12)
        bottom.set(ylabel=f"measured − sim. [{data.unit}]", ylim=(-reach, reach))
        _frame_axis(bottom, record)
        figure.align_ylabels([top, bottom])
        band = f"±2 σ = ±{digits_text(2.0 * data.std)} {data.unit} shaded. " if data.std else ""
        return to_picture(figure, f"channel_{data.name}", f"Channel {data.name}",
                          f"{band}Below: measured minus simulated.")


def temperature(record: RunRecord) -> Picture | None:
    """Mean change of temperature over the frames, between its lowest and highest nodal value."""
    if record.temperature is None:
        return None
    lowest, mean, highest = np.asarray(record.temperature).T
    with look():
        figure = new_figure(7.2, 2.8)
        axis = figure.subplots()
        axis.fill_between(record.abscissa, lowest, highest, color=Colour.FAINT, alpha=0.8, lw=0,
                          label="lowest to highest node")
        axis.plot(record.abscissa, mean, "-o", color=Colour.BLUE, ms=3.5, label="mean of the nodes")
        axis.set(ylabel="change [K]")
        _frame_axis(axis, record)
        axis.legend()
        return to_picture(figure, "temperature", "Temperature",
                          "Change since the reference frame, as given in the experiment file or identified.")


def curve_style(i: int, label: str) -> dict:
    """Colour, marker and label of curve i; the eighth has the first colour with another marker."""
    return {"color": CYCLE[i % len(CYCLE)], "marker": MARKERS[(i + i // len(CYCLE)) % len(MARKERS)], "label": label}


def _trace(middle, right, record, accepted, name, label, i):
    style = curve_style(i, label)
    evaluations = np.array([h["evaluation"] for h in accepted])
    values = np.array([h["values"][name] for h in accepted], dtype=float)
    parameter = record.result["parameters"].get(name, {})
    final = values[-1] if parameter.get("std") is None else parameter["value"]
    if final:
        middle.plot(evaluations, values / final, **style)
    std = parameter.get("std")
    if std:
        distance = np.abs(values - final) / std
        keep = distance > 1e-6
        right.semilogy(evaluations[keep], distance[keep], **style)


def _mark_stages(axis, accepted):
    stages = [h["stage"] for h in accepted]
    for previous, stage, h in zip(stages[:-1], stages[1:], accepted[1:], strict=True):
        if previous != stage:
            axis.axvline(h["evaluation"] - 0.5, color=Colour.GREY, lw=0.8, ls=":")
