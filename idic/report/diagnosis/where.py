"""Figures of place, onset and side: source map, active elements, time course, amplitude over load, nested tests."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.colors import LogNorm
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from idic.report.figures.axes.time_axis import label_frames
from idic.fe import Mesh
from idic.report.evidence.volumes.shown_mesh import element_sections
from idic.report.figures.picture import Colour, Picture
from idic.report.figures.style import SEQUENTIAL, look, new_figure, show_pixels, to_picture

LEVELS = {"camera": "camera alone", "boundary": "driven edges, law kept", "camera+boundary": "both",
         "bulk": "any smooth motion"}
COLOURS = {"camera": Colour.SKY, "boundary": Colour.ORANGE, "camera+boundary": Colour.GREY, "bulk": Colour.BLUE}
MIN_COLOUR_LIMIT = 400.0  # statistic at the end of the colour bar, at least
# inches beside a map for its labels and colour bar; for a legend above
MAP_LABEL_WIDTH_INCH, MIN_LEGEND_WIDTH_INCH = 1.9, 3.2
LEGEND_ENTRY_WIDTH_INCH = 2.4  # inches of one of its entries


@dataclass(frozen=True, eq=False)
class WhereRecord:
    """All that these figures show.

    Attributes
    ----------
    reference : (ny, nx) image, or None
    outlines : (n_elements) list of polygons (k, 2) in px, one per element; of a cross-section in its own plane, mm; of
        a volume those that three sections cut out, none of an element beside them
    section : bool, whether the outlines are those of a cross-section
    since_active : (n_elements,) first frame in which the selected law acts in the enriched model, -1 never; None
    statistic : (n_elements,) of the source map, p : (n_elements,) family-wise, 1 where an element has the other sign
    source_elements : (n,) indices of elements of the source
    since : (n_elements,) first frame of the first window in which an element shows, NaN where it never does
    blind : (n_elements,) bool, elements that the images do not see
    times : (T,) abscissa of the frames, time_label : its words
    amplitude, std : (T,) px
    load : (T,) or None, load_label : its words
    onset : abscissa, or None; interval : (low, high) abscissa, or None
    shares : level -> part of the explainable excess; excess : level -> drop of chi-square beyond noise, all levels
    cracks : (m, 2) px, faces of the cracks of the enriched model in the last frame, from their beginning to the tip
    side : str; words : dict of a sentence per figure ("where", "when", "course", "side")
    """

    reference: np.ndarray | None
    outlines: list[list[np.ndarray]]
    statistic: np.ndarray
    p: np.ndarray
    source_elements: np.ndarray
    since: np.ndarray
    blind: np.ndarray
    times: np.ndarray
    time_label: str
    amplitude: np.ndarray
    std: np.ndarray
    load: np.ndarray | None
    load_label: str
    onset: float | None
    interval: tuple[float, float] | None
    shares: dict[str, float]
    excess: dict[str, float]
    side: str
    words: dict[str, str]
    section: bool = False
    since_active: np.ndarray | None = None
    cracks: tuple[np.ndarray, ...] = ()

    @staticmethod
    def sections(mesh: Mesh, nodes_px: np.ndarray, shape: tuple[int, int, int],
                 at: tuple[int, int, int]) -> list[list[np.ndarray]]:
        """Outlines of the elements of a volume (nz, ny, nx) in sections at (column, row, slice)."""
        return element_sections(mesh, nodes_px, shape, at)

    def cells(self, elements: Iterable[int]) -> list[np.ndarray]:
        """Outlines of these elements."""
        return [polygon for e in elements for polygon in self.outlines[e]]

    def values(self, elements: np.ndarray, of_elements: np.ndarray) -> np.ndarray:
        """A value per element for each of its outlines  # (n,), (n_elements,) -> (n_outlines,)"""
        return np.repeat(of_elements[elements], [len(self.outlines[e]) for e in elements])


def pictures(record: WhereRecord) -> tuple[Picture, ...]:
    """Those that have something to show."""
    candidates = (source_map(record), active_map(record), amplitude_course(record), loop(record), side_chart(record))
    return tuple(picture for picture in candidates if picture is not None)


def source_map(record: WhereRecord) -> Picture | None:
    """Source elements on the image of the specimen, coloured by the frame from which they show; blind zones hatched."""
    if not len(record.source_elements):
        return None
    low, high, (width, height) = _extent(record, record.source_elements)
    width = max(width, MIN_LEGEND_WIDTH_INCH)
    with look():
        figure = new_figure(width, height)
        axis = figure.subplots()
        if record.reference is not None:
            show_pixels(axis, record.reference, cmap="gray", alpha=0.75)
        strong = np.flatnonzero((record.p < 0.01) & (record.statistic > 0.1 * record.statistic.max()))
        norm = LogNorm(max(0.1 * record.statistic.max(), 1.0), max(record.statistic.max(), MIN_COLOUR_LIMIT))
        cloud = PolyCollection(record.cells(strong), array=record.values(strong, record.statistic), cmap=SEQUENTIAL,
                               norm=norm, alpha=0.75, linewidths=0)
        axis.add_collection(cloud)
        since = record.since[record.source_elements]
        colours = Colour.RED, Colour.ORANGE, Colour.GREEN, Colour.SKY, Colour.BLUE, Colour.GREY
        for frame, colour in zip(np.unique(since[np.isfinite(since)]), colours, strict=False):
            axis.add_collection(PolyCollection(record.cells(record.source_elements[since == frame]),
                                               facecolors="none", edgecolors=colour, linewidths=1.6,
                                               label=f"source element, from frame {int(frame)}"))
        for crack in record.cracks:
            axis.plot(*crack.T, color="black", linewidth=2.4, label="crack, last frame")
            axis.plot(*crack[-1], "o", color="black", markersize=6)
        if record.blind.any():
            axis.add_collection(PolyCollection(record.cells(np.flatnonzero(record.blind)),
                                               facecolors="none", edgecolors=Colour.GREY, hatch="////", linewidths=0.0,
                                               label="blind: no pixels"))
        _frame_axis(axis, record, low, high)
        figure.legend(loc="outside upper left", ncols=max(int(width / LEGEND_ENTRY_WIDTH_INCH), 1))
        figure.colorbar(cloud, ax=axis, label="Σ z² of the stiffness score of an element", shrink=0.8, aspect=30,
                        pad=0.01)
        return to_picture(figure, "diagnosis_where", "Adjoint source map", record.words.get("where", ""),
                          as_photo=record.reference is not None)


def _extent(record: WhereRecord, required: np.ndarray) -> tuple[np.ndarray, np.ndarray, tuple[float, float]]:
    """Corners of the shown region, and width and height of the figure, inches; always : elements that must be in it"""
    elements = range(record.blind.size)
    if record.section and not record.blind.all():
        elements = np.union1d(np.flatnonzero(~record.blind), required)
    corners = np.concatenate(record.cells(elements))
    low, high = corners.min(axis=0), corners.max(axis=0)
    if record.section:
        return low, high, (10.0, 3.4)
    wide, tall = (float(x) for x in high - low)
    height = float(np.clip(9.0 * tall / wide, 2.2, 5.5))
    return low, high, (min(height * wide / tall + MAP_LABEL_WIDTH_INCH, 10.0), height + 0.8)


def _frame_axis(axis, record: WhereRecord, low: np.ndarray, high: np.ndarray) -> None:
    if record.section:
        axis.add_collection(PolyCollection(record.cells(range(len(record.outlines))), facecolors="none",
                                           edgecolors=Colour.FAINT, linewidths=0.4, zorder=0))
        margin = 0.03 * (high - low)
        axis.set(xlim=(low[0] - margin[0], high[0] + margin[0]), ylim=(low[1] - margin[1], high[1] + margin[1]),
                 xlabel="along the section [mm]", ylabel="across it [mm]")
    else:
        margin = 0.03 * float((high - low).max())
        axis.set(xlim=(low[0] - margin, high[0] + margin), ylim=(high[1] + margin, low[1] - margin),
                 aspect="equal", xlabel="column [px]", ylabel="row [px]")
    axis.grid(False)


def active_map(record: WhereRecord) -> Picture | None:
    """Elements in which the selected law acts, coloured by the first frame in which it does."""
    if record.since_active is None or not (record.since_active >= 0).any():
        return None
    acting = np.flatnonzero(record.since_active >= 0)
    low, high, size = _extent(record, acting)
    with look():
        figure = new_figure(*size)
        axis = figure.subplots()
        if record.reference is not None:
            show_pixels(axis, record.reference, cmap="gray", alpha=0.75)
        cloud = PolyCollection(record.cells(acting), array=record.values(acting, record.since_active).astype(float),
                               cmap=SEQUENTIAL, edgecolors="white", linewidths=0.3)
        earliest, latest = record.since_active[acting].min(), record.since_active[acting].max()
        cloud.set_clim(earliest, max(latest, earliest + 1))
        axis.add_collection(cloud)
        _frame_axis(axis, record, low, high)
        verb = record.words.get("active", "acts")
        figure.colorbar(cloud, ax=axis, label=f"{verb} since frame", shrink=0.8, aspect=30, pad=0.01,
                        ticks=MaxNLocator(8, integer=True))
        return to_picture(figure, "diagnosis_active", "Active elements of the selected law",
                      f"The law acts in {len(acting)} of {len(record.since_active)} elements of the enriched model, in "
                      f"the first ones from frame {earliest} on.", as_photo=record.reference is not None)


def amplitude_course(record: WhereRecord) -> Picture | None:
    """Amplitude of the mismatch and the load over time; the band is the interval of the onset."""
    if not record.amplitude.any():
        return None
    with look():
        figure = new_figure(10.0, 3.2)
        axis = figure.subplots()
        sign = np.sign(record.amplitude[np.argmax(np.abs(record.amplitude))])
        a = sign * record.amplitude
        axis.fill_between(record.times, a - 2 * record.std, a + 2 * record.std, color=Colour.BLUE, alpha=0.2, lw=0)
        axis.plot(record.times, a, "-o", color=Colour.BLUE, label="mismatch (95 %)")
        axis.axhline(0.0, color=Colour.GREY, lw=0.7)
        if record.interval is not None:
            low, high = record.interval
            width = 0.004 * np.ptp(record.times)
            axis.axvspan(low - width, high + width, color=Colour.ORANGE, alpha=0.35, lw=0, label="onset (95 %)")
            axis.axvline(record.onset, color=Colour.RED, lw=1.0)
        axis.set_ylabel("motion [px rms]")
        label_frames(axis, record.time_label, record.times)
        lines, labels = axis.get_legend_handles_labels()
        if record.load is not None:
            load_axis = axis.twinx()
            load_axis.plot(record.times, record.load, color=Colour.GREY, lw=1.0, ls="--", label=record.load_label)
            load_axis.set_ylabel(record.load_label)
            load_axis.grid(False)
            load_axis.spines["right"].set_visible(True)
            more = load_axis.get_legend_handles_labels()
            lines, labels = lines + more[0], labels + more[1]
        figure.legend(lines, labels, loc="outside upper left", ncols=4)
        return to_picture(figure, "diagnosis_when", "Onset of the mismatch", record.words.get("when", ""))


def loop(record: WhereRecord) -> Picture | None:
    """Amplitude of the mismatch over the load: reversible or permanent."""
    if record.load is None or not record.amplitude.any():
        return None
    with look():
        figure = new_figure(6.0, 3.6)
        axis = figure.subplots()
        sign = np.sign(record.amplitude[np.argmax(np.abs(record.amplitude))])
        axis.errorbar(record.load, sign * record.amplitude, 2 * record.std, fmt="none", ecolor=Colour.FAINT, zorder=1)
        axis.plot(record.load, sign * record.amplitude, color=Colour.GREY, lw=0.8, zorder=2)
        dots = axis.scatter(record.load, sign * record.amplitude, c=record.times, cmap=SEQUENTIAL, s=18, zorder=3)
        axis.axhline(0.0, color=Colour.GREY, lw=0.7)
        axis.set(xlabel=record.load_label, ylabel="mismatch [px rms]")
        figure.colorbar(dots, ax=axis, label=record.time_label)
        return to_picture(figure, "diagnosis_loop", "Mismatch over load", record.words.get("course", ""))


def side_chart(record: WhereRecord) -> Picture | None:
    """Share of the explainable excess that each level of the nested tests recovers."""
    levels = [name for name in LEVELS if np.isfinite(record.shares.get(name, np.nan))]
    if not levels:
        return None
    with look():
        figure = new_figure(8.0, 0.42 * len(levels) + 1.2)
        axis = figure.subplots()
        for row, name in enumerate(reversed(levels)):
            share = record.shares[name]
            axis.barh(row, 100.0 * share, color=COLOURS[name], height=0.6,
                      edgecolor=Colour.RED if name == record.side else "none", linewidth=1.5)
            axis.annotate(f"{100.0 * share:.0f} %", (100.0 * max(share, 0.0), row), (4, 0), va="center",
                          textcoords="offset points", fontsize=8)
        axis.set_yticks(range(len(levels)), [LEVELS[name] for name in reversed(levels)])
        axis.set(xlabel="share of what any smooth motion explains [%]", xlim=(0, 115))
        axis.grid(False, axis="y")
        if record.side in LEVELS:
            figure.legend(handles=[Patch(facecolor="none", edgecolor=Colour.RED, label="responsible side")],
                          loc="outside upper right")
        return to_picture(figure, "diagnosis_side", "Nested tests of the side", record.words.get("side", ""))
