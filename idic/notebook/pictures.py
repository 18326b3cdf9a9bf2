"""The pictures of a result: residual map, channels, corner plot of the posterior.

Every call gives a matplotlib Figure, which a notebook shows and ``figure.savefig("name.png")`` writes.
"""

from __future__ import annotations

import io
from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from idic.run import Fields, checked_frame
from idic.notebook.posterior import Posterior, posterior_of
from idic.report import (
    DIVERGING, DPI, RESIDUAL_RANGE, Colour, bare, look, new_figure, residual_window, short_names, time_label, with_std,
)

MAP_INCH, CORNER_INCH = 6.0, 1.9  # width of a map, side of a panel
# standard deviations that hold so many % of a plane Gaussian: chi, 2 degrees
ELLIPSES = ((1.5096, "-", 68), (2.4477, "--", 95))
REACH = 3.2  # standard deviations shown on each side


class NotebookFigure(Figure):
    """A figure that a notebook shows without pyplot."""

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        with look():
            self.savefig(buffer, format="png", dpi=DPI)
        return buffer.getvalue()


class Plots:
    """``result.plot``."""

    def __init__(self, content: Mapping, fields: Fields):
        self._content, self._fields = content, fields

    def residual(self, frame: int = -1) -> Figure:
        """The residual f - g(x + u) of a frame in the reference image, over the residual of image noise alone.

        frame : later than the reference; negative: counted from the last
        """
        number = checked_frame(self._fields.experiment.model, frame, later=True)
        entry, unit = self._content["frames"][number], self._fields.experiment.recording.value_unit
        noise = _noise_level(entry)
        values = self._fields.residual(number) / (noise or 1.0)
        reach = RESIDUAL_RANGE if noise else float(np.nanpercentile(np.abs(values), 99)) or 1.0
        column_from, column_to, row_from, row_to = residual_window(values[None])
        aspect = (row_to - row_from) / (column_to - column_from)
        with look():
            figure = _figure(min(MAP_INCH, MAP_INCH / aspect) + 1.0, min(MAP_INCH * aspect, MAP_INCH) + 0.5)
            axis = figure.subplots()
            image = axis.imshow(values, cmap=DIVERGING, vmin=-reach, vmax=reach, interpolation="nearest")
            bare(axis, (column_from, column_to, row_from, row_to))
            axis.set_title(_words(number, entry, unit))
            figure.colorbar(image, ax=axis, shrink=0.85, aspect=22, pad=0.02, extend="both",
                            label="residual / σ [–]" if noise else f"residual [{unit}]")
        return figure

    def channels(self) -> Figure:
        """Every channel as measured and simulated, and their difference with a band of two standard deviations."""
        fields = self._fields
        simulated, measured, experiment = fields.simulated, fields.measured, fields.experiment
        x, stds = experiment.model.times, self._content["residual"].get("channel_noise_std", {})
        n = max(len(experiment.model.channels), 1)
        with look():
            figure = _figure(6.4, 3.6 * n)
            axes = figure.subplots(2 * n, 1, sharex=True, squeeze=False, height_ratios=(2.2, 1.0) * n)[:, 0]
            for i, channel in enumerate(experiment.model.channels):
                top, bottom = axes[2 * i:2 * i + 2]
                read, modelled = measured[:, i] / channel.shown_factor, simulated[:, i] / channel.shown_factor
                difference, std, unit = read - modelled, stds.get(channel.column), channel.shown_unit
                top.plot(x, modelled, "-", color=Colour.BLUE, label="simulated")
                top.plot(x, read, "o", color="#222222", ms=3.5, label="measured")
                label = channel.column.removesuffix(f"_{unit}").replace("_", " ")
                top.set_ylabel(f"{label} [{unit}]")
                top.legend()
                if std:
                    bottom.axhspan(-2.0 * std, 2.0 * std, color=Colour.FAINT, alpha=0.6, lw=0)
                bottom.axhline(0.0, color=Colour.GREY, lw=0.7)
                bottom.plot(x, difference, "-o", color=Colour.BLUE, lw=0.8, ms=3.5)
                reach = 1.25 * max(float(np.nanmax(np.abs(difference))), 2.0 * (std or 0.0), 1e-12)
                bottom.set(ylabel=f"difference [{unit}]", ylim=(-reach, reach))
            if not experiment.model.channels:
                axes[0].set_title("no channel is compared")
            axes[-1].set_xlabel(time_label(x))
            axes[-1].xaxis.set_major_locator(MaxNLocator(steps=[1, 2, 5, 10], integer=time_label(x) == "frame"))
            figure.align_ylabels(list(axes))
        return figure

    def corner(self, parameters: tuple[str, ...] | None = None) -> Figure:
        """The Gaussian posterior: a density for every parameter, ellipses of 68 % and 95 % for every pair.

        parameters : which of ``result.determined``, in this order; default: all of them
        """
        posterior = posterior_of(self._content, None if parameters is None else tuple(parameters))
        short = short_names(self._content["parameters"])
        n = len(posterior.names)
        with look():
            figure = _figure(CORNER_INCH * n + 0.8, CORNER_INCH * n + 0.6)
            axes = figure.subplots(n, n, squeeze=False)
            for row in range(n):
                for column in range(n):
                    axis = axes[row, column]
                    if column > row:
                        axis.set_visible(False)
                    elif column == row:
                        _density(axis, posterior, row)
                        axis.set_title(f"{short[posterior.names[row]]}\n{_value(posterior, row)}", loc="center")
                    else:
                        _ellipses(axis, posterior, column, row)
                    _label(axis, posterior, short, row, column)
            if n > 1:
                lines = [Line2D([], [], color=Colour.BLUE, ls=style, lw=1.1, label=f"{share} % of a pair")
                         for _, style, share in ELLIPSES]
                figure.legend(handles=[*lines, Patch(color=Colour.FAINT, alpha=0.7, lw=0, label="95 % of one")],
                              loc="upper right")
        return figure


def _figure(width: float, height: float) -> Figure:
    return new_figure(width, height, NotebookFigure)


def _noise_level(entry: Mapping) -> float | None:
    """Residual of image noise alone in a frame (grey values), None where it is not known."""
    rms, chi2 = entry.get("rms_gv"), entry.get("chi2_dof")
    return rms / np.sqrt(chi2) if rms and chi2 else None


def _words(number: int, entry: Mapping, unit: str) -> str:
    rms, chi2 = entry.get("rms_gv"), entry.get("chi2_dof")
    parts = [f"frame {number}"]
    parts += [] if rms is None else [f"rms {rms:.3g} {unit}"]
    parts += [] if chi2 is None else [f"χ² per pixel {chi2:.3g}"]
    return ",  ".join(parts + ([entry["status"]] if entry["status"] != "ok" else []))


def _value(posterior: Posterior, i: int) -> str:
    return with_std(float(posterior.mean[i]), float(posterior.std[i]), posterior.units[i])


def _density(axis: Axes, posterior: Posterior, i: int) -> None:
    z = np.linspace(-REACH, REACH, 201)
    x, density = posterior.mean[i] + z * posterior.std[i], np.exp(-0.5 * z**2)
    axis.plot(x, density, color=Colour.BLUE)
    inside = np.abs(z) <= 1.96  # 95 %
    axis.fill_between(x[inside], density[inside], color=Colour.FAINT, alpha=0.7, lw=0)
    axis.set(xlim=(x[0], x[-1]), ylim=(0.0, 1.08), yticks=[])


def _ellipses(axis: Axes, posterior: Posterior, i: int, j: int) -> None:
    """Ellipses of the pair (i, j), i to the right."""
    rho = posterior.correlation[i, j]
    centre, std = posterior.mean[[i, j]], posterior.std[[i, j]]
    angles = np.linspace(0.0, 2.0 * np.pi, 181)
    circle = np.stack([np.cos(angles), rho * np.cos(angles) + np.sqrt(max(1.0 - rho**2, 0.0)) * np.sin(angles)])
    for size, style, _ in ELLIPSES:
        axis.plot(*(centre[:, None] + size * std[:, None] * circle), style, color=Colour.BLUE, lw=1.1)
    axis.plot(*centre, "+", color=Colour.ORANGE, ms=6)
    low, high = centre - REACH * std, centre + REACH * std
    axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axis.set_title(f"correlation {rho:+.2f}".replace("-", "−"), loc="center", color=Colour.GREY)


def _label(axis: Axes, posterior: Posterior, short: Mapping[str, str], row: int, column: int) -> None:
    names = [f"{short[name]} [{unit}]" if unit and unit != "-" else short[name]
             for name, unit in zip(posterior.names, posterior.units, strict=True)]
    axis.xaxis.set_major_locator(MaxNLocator(3, min_n_ticks=2))
    if row != column:
        axis.yaxis.set_major_locator(MaxNLocator(3, min_n_ticks=2))
    is_last = row == len(names) - 1
    axis.tick_params(labelbottom=is_last, labelleft=column == 0 and row > 0)
    axis.set(xlabel=names[column] if is_last else "", ylabel=names[row] if column == 0 and row > 0 else "")
