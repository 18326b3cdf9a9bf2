"""Charts of several studies: errors over start value or noise, convergence, random starts, draws, frame levels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter

from idic.report import CYCLE, MARKERS, Colour, Picture, look, new_figure, to_picture
from idic_studies.pages.case_record import CaseRecord

MIN_SHOWN_ERROR = 1e-7  # relative error that a logarithmic axis still shows
COLOURS = (*CYCLE, "#8c564b", "#7f7f7f", "#117733")  # up to ten parameters
SIGNS = (*MARKERS, "*", "<", ">")


def short(names: Sequence[str], symbols: Mapping[str, str]) -> list[str]:
    """Symbols of parameters, their own name where there is none."""
    return [symbols.get(name, name.rpartition(".")[2]) for name in names]


def convergence(record: CaseRecord, symbols: Mapping[str, str], name: str, caption: str) -> Picture:
    """Relative error of every parameter over the evaluations, rejected trials as crosses."""
    history, accepted = record.arrays["history"], record.arrays["accepted"]
    errors = np.maximum(np.abs(history / record.arrays["truth"] - 1.0), MIN_SHOWN_ERROR)
    with look():
        figure = new_figure(7.2, 3.4)
        axis = figure.subplots()
        at = np.arange(len(errors))
        for i, label in enumerate(short(record.names, symbols)):
            axis.semilogy(at[accepted], errors[accepted, i], color=COLOURS[i], marker=SIGNS[i], label=label)
            if (~accepted).any():
                axis.semilogy(at[~accepted], errors[~accepted, i], "x", color=COLOURS[i])
        axis.xaxis.set_major_locator(MaxNLocator(integer=True))
        axis.set(xlabel="evaluation", ylabel="|value / true value − 1| [–]")
        figure.legend(loc="outside right upper")
        return to_picture(figure, name, "Convergence", caption)


def errors_over(panels: Sequence[tuple[str, str, np.ndarray, Sequence[CaseRecord]]], symbols: Mapping[str, str],
                name: str, title: str, caption: str, logarithmic: Sequence[bool]) -> Picture:
    """Relative error of every parameter over the varied quantity, one panel each; open markers: not converged, or with
    a residual beyond the noise.

    panels : (heading, label of the abscissa with its unit, abscissa (n,), records); dotted: the reported std
    logarithmic : abscissa of each panel
    """
    with look():
        figure = new_figure(10.0, 3.9)
        axes = np.atleast_1d(figure.subplots(1, len(panels), sharey=True))
        # a parameter looks the same in every panel, whichever others are identified there
        looks = list(dict.fromkeys(parameter for *_, records in panels for parameter in records[0].names))
        lines = {}
        for axis, (heading, label, at, records), wide in zip(axes, panels, logarithmic, strict=True):
            order = np.argsort(at)
            at, records = np.asarray(at)[order], [records[k] for k in order]
            good = np.array([record.explained for record in records])
            for i, (parameter, text) in enumerate(zip(records[0].names, short(records[0].names, symbols), strict=True)):
                colour, sign = COLOURS[looks.index(parameter)], SIGNS[looks.index(parameter)]
                error = np.maximum(np.abs([record.relative_error[i] for record in records]), MIN_SHOWN_ERROR)
                lines[parameter], = axis.semilogy(at, error, color=colour, marker=sign, label=text)
                axis.semilogy(at[~good], error[~good], sign, mfc="white", mec=colour, ls="none", zorder=5)
                axis.semilogy(at, [record.relative_std[i] for record in records], ":", color=colour, lw=1.0)
            axis.set(title=heading, xlabel=label, xscale="log" if wide else "linear")
            if wide:
                axis.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes[0].set_ylabel("|value / true value − 1| [–]")
        figure.legend(handles=[lines[parameter] for parameter in looks], loc="outside right upper")
        return to_picture(figure, name, title, caption)


def starts(records: Sequence[CaseRecord], right: Sequence[bool], symbols: Mapping[str, str], name: str, title: str,
           caption: str) -> Picture:
    """Random starts: start values (left) and errors at the end (right), one row per start."""
    with look():
        figure = new_figure(10.0, 0.9 + 0.21 * len(records))
        start_axis, end_axis = figure.subplots(1, 2, sharey=True, width_ratios=(1.0, 1.0))
        rows = np.arange(len(records))
        for i, text in enumerate(short(records[0].names, symbols)):
            start = [record.arrays["start"][i] / record.arrays["truth"][i] for record in records]
            end = [max(abs(record.relative_error[i]), MIN_SHOWN_ERROR) for record in records]
            start_axis.semilogx(start, rows, SIGNS[i], color=COLOURS[i], label=text)
            end_axis.semilogx(end, rows, SIGNS[i], color=COLOURS[i])
        for row, (record, fine) in enumerate(zip(records, right, strict=True)):
            if not fine:
                for axis in (start_axis, end_axis):
                    axis.axhspan(row - 0.5, row + 0.5, color="#fdebdd", lw=0, zorder=0)
                end_axis.text(1.01, row, record.outcome.replace(", ", ",\n"), color=Colour.RED, fontsize=7.0, ha="left",
                                va="center", transform=end_axis.get_yaxis_transform())
        start_axis.axvline(1.0, color=Colour.GREY, lw=0.7)
        start_axis.xaxis.set_minor_formatter(NullFormatter())
        start_axis.set_xticks([0.5, 1.0, 2.0, 3.0], ["0.5", "1", "2", "3"])
        start_axis.set(title="Start", xlabel="start value / true value [–]", ylabel="start number",
                 ylim=(len(records) - 0.5, -0.5))
        start_axis.set_yticks(rows, [record.name for record in records])
        end_axis.set(title="End", xlabel="|value / true value − 1| [–]")
        figure.legend(loc="outside upper right", ncols=len(records[0].names))
        return to_picture(figure, name, title, caption)


def draws(groups: Sequence[tuple[str, np.ndarray]], names: Sequence[str], name: str, title: str,
          caption: str) -> Picture:
    """Standard deviation of (error / reported std) per parameter and noise level, with 99 % of chance.

    groups : (label, errors over std (n_draws, n_parameters)); the band holds 99 % of such figures if the reported
    standard deviations are right.
    """
    with look():
        figure = new_figure(8.4, 3.6)
        axis = figure.subplots()
        width = 0.8 / len(groups)
        for g, (label, errors) in enumerate(groups):
            low, high = chance(len(errors))
            at = np.arange(len(names)) + (g - 0.5 * (len(groups) - 1)) * width
            axis.bar(at, high - low, 0.92 * width, low, color=Colour.FAINT, label="99 % of chance" if g == 0 else None)
            axis.plot(at, errors.std(axis=0, ddof=1), MARKERS[g], color=CYCLE[g], ls="none", ms=6, label=label)
        axis.axhline(1.0, color=Colour.GREY, lw=0.8)
        axis.set_xticks(np.arange(len(names)), names)
        axis.grid(False, axis="x")
        axis.set(ylabel="std of (error / reported std) [–]", ylim=(0.0, None))
        figure.legend(loc="outside right upper")
        return to_picture(figure, name, title, caption)


def chance(n: int, part: float = 0.99) -> tuple[float, float]:
    """Interval of the sample standard deviation of `n` draws with standard deviation 1, at probability `part`."""
    from scipy.stats import chi2

    tail = 0.5 * (1.0 - part)
    low, high = (float(np.sqrt(chi2.ppf(q, n - 1) / (n - 1))) for q in (tail, 1.0 - tail))
    return low, high


def frame_levels(times: np.ndarray, lines: Sequence[tuple[str, np.ndarray, float | None]], unit: str, name: str,
                 title: str, caption: str) -> Picture:
    """Mean absolute residual over time, one line per identification; dashed: frames beyond its window.

    lines : (label, levels (n_frames,), end of its window, None for all)
    """
    with look():
        figure = new_figure(8.4, 4.2)
        axis = figure.subplots()
        shades = np.linspace(0.0, 1.0, max(len(lines), 2))
        for k, (label, levels, end) in enumerate(lines):
            is_complete = end is None
            colour = Colour.ORANGE if is_complete else _blue(shades[k])
            inside = np.ones(len(times), bool) if is_complete else times <= end
            axis.plot(times, levels, "--", color=colour, lw=0.9)
            axis.plot(times[inside], levels[inside], color=colour, lw=2.2, label=label)
            if not is_complete:
                end_frame = np.flatnonzero(inside)[-1]
                axis.plot(times[end_frame], levels[end_frame], MARKERS[k % len(MARKERS)], color=colour)
        every = np.concatenate([levels[np.isfinite(levels) & (levels > 0)] for _, levels, _ in lines])
        if every.max(initial=0.0) > 10.0 * every.min(initial=np.inf):
            axis.set_yscale("log")
        else:
            axis.set_ylim(0.0, 1.3 * every.max(initial=0.0) or None)
        axis.set(xlabel="time [s]", ylabel=f"mean |r| of a frame [{unit}]")
        if len(lines) > 1:
            figure.legend(loc="outside right upper")
        return to_picture(figure, name, title, caption)


def _blue(part: float) -> tuple[float, float, float]:
    """From light to dark blue."""
    light, dark = np.array([0.62, 0.80, 0.93]), np.array([0.0, 0.16, 0.36])
    return tuple(light + part * (dark - light))
