"""Time axes without the pauses in which nothing is recorded: a pause is drawn as a break, not to scale."""

from __future__ import annotations

import numpy as np
from matplotlib import rcParams
from matplotlib.ticker import FixedLocator, MaxNLocator

MIN_FRAMES = 5  # of a test that can have a pause
MIN_PAUSE_SHARE = 0.2  # of the whole time: a shorter pause leaves the rest legible
MIN_PAUSE_RATIO = 4.0  # over the longest step that is none: steps that grow by less are a schedule
MIN_PAUSE_STEPS = 10.0  # over the usual step
BREAK_SHARE = 0.06  # of the time without pauses, that a break takes on the paper
N_TICKS = 8  # of all parts together


def pauses(times: np.ndarray) -> list[tuple[float, float]]:
    """Begin and end of the long times without a frame."""
    times = np.unique(np.asarray(times, dtype=float)[np.isfinite(times)])
    if len(times) < MIN_FRAMES:
        return []
    steps = np.diff(times)
    is_long = (steps > MIN_PAUSE_SHARE * np.ptp(times)) & (steps > MIN_PAUSE_STEPS * np.median(steps))
    if not is_long.any() or steps[is_long].min() < MIN_PAUSE_RATIO * steps[~is_long].max():
        return []
    return [(float(times[k]), float(times[k + 1])) for k in np.flatnonzero(is_long)]


def label_frames(axis, label: str, times: np.ndarray) -> None:
    """Label, limits, ticks and breaks of an axis along which frames lie; after all is plotted.

    times : (n_frames,) s, or numbers of frames, of which the label ends with "frame"
    """
    axis.set_xlabel(label)
    times, by_number = np.asarray(times, dtype=float), label.endswith("frame")
    breaks = pauses(times)
    if not breaks:
        margin = 0.03 * float(np.ptp(times)) or 0.5
        axis.set_xlim(float(np.min(times)) - margin, float(np.max(times)) + margin)
        axis.xaxis.set_major_locator(MaxNLocator(integer=by_number, steps=[1, 2, 5, 10]))
        return
    corners = np.array([np.min(times), *(time for pause in breaks for time in pause), np.max(times)])
    recorded_s = float(np.ptp(times)) - sum(end - begin for begin, end in breaks)
    widths = np.diff(corners)
    widths[1::2] = BREAK_SHARE * recorded_s
    places = np.concatenate([[0.0], np.cumsum(widths)])
    least = recorded_s / 100.0  # beyond the ends the axis goes on to scale
    margin_before, margin_after = max(widths[0], least), max(widths[-1], least)
    outer_times = np.concatenate([[corners[0] - margin_before], corners, [corners[-1] + margin_after]])
    outer_places = np.concatenate([[-margin_before], places, [places[-1] + margin_after]])
    outer_times, places_of_times = np.unique(outer_times, return_index=True)
    outer_places = outer_places[places_of_times]
    axis.set_xscale("function", functions=(lambda t: _mapped(t, outer_times, outer_places),
                                           lambda p: _mapped(p, outer_places, outer_times)))
    margin = 0.03 * float(places[-1])
    axis.set_xlim(*_mapped(np.array([-margin, places[-1] + margin]), outer_places, outer_times))
    axis.xaxis.set_major_locator(FixedLocator(_ticks(corners, recorded_s)))
    for shared_axis in axis.get_shared_x_axes().get_siblings(axis):
        for begin, end in breaks:
            _draw_break(shared_axis, begin, end)


def _mapped(values: np.ndarray, knots: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Piecewise linear, straight on beyond the last knots."""
    values = np.asarray(values, dtype=float)
    slopes = np.diff(targets) / np.diff(knots)
    below = targets[0] + (values - knots[0]) * slopes[0]
    above = targets[-1] + (values - knots[-1]) * slopes[-1]
    inside = np.interp(values, knots, targets)
    return np.where(values < knots[0], below, np.where(values > knots[-1], above, inside))


def _ticks(corners: np.ndarray, recorded_s: float) -> list[float]:
    """Round times in the parts between the breaks, and the one frame of a part that has no more."""
    ticks: list[float] = []
    for begin, end in zip(corners[::2], corners[1::2], strict=True):
        if end - begin < recorded_s / N_TICKS:
            ticks.append(float(begin))
            continue
        n = max(round(N_TICKS * (end - begin) / recorded_s), 1)
        ticks += [float(t) for t in MaxNLocator(n, steps=[1, 2, 5, 10]).tick_values(begin, end) if begin <= t <= end]
    return ticks


def _draw_break(axis, begin: float, end: float) -> None:
    """A hatched band, and how long the pause is."""
    colour = rcParams["xtick.color"]
    axis.axvspan(begin, end, facecolor="white", edgecolor=colour, hatch="////", alpha=0.35, lw=0, zorder=3)
    axis.annotate(f"{end - begin:.3g} s", (begin, 1.0), xycoords=axis.get_xaxis_transform(), xytext=(2, -2),
                  textcoords="offset points", rotation=90, ha="left", va="top", fontsize=7, color=colour, zorder=4,
                  bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5})
