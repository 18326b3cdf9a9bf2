"""Curves along a cross-section seen from above: motion and sensitivities, where a map would be a line in the image."""

from __future__ import annotations

import numpy as np
from matplotlib.cm import viridis
from matplotlib.figure import Figure

from idic.report.figures.picture import CYCLE, Colour, Picture
from idic.report.figures.style import look, new_figure, to_picture
from idic.report.result.record import EDGE, FrameView, RunRecord
from idic.report.result.words import short_names

COMPONENTS = ("columns", "rows (down)", "height")


def is_profile(record: RunRecord) -> bool:
    """Whether the camera sees the edges of a section."""
    return any(cell == EDGE for cell, _ in record.cells)


def displacements(record: RunRecord) -> Picture | None:
    """Motion along the section and rise of some frames, over the image column."""
    if record.fields is None or record.nodes_px is None:
        return None
    data, (nodes, column) = record.fields, places(record)
    curves = {"motion along the section [px]": data.u_px[:, :, 0]} | dict(data.extra)
    with look():
        figure = new_figure(10.0, 3.0)
        axes = np.atleast_1d(figure.subplots(1, len(curves)))
        for axis, (name, values) in zip(axes, curves.items(), strict=True):
            for k, frame in enumerate(data.frames):
                axis.plot(column, np.asarray(values)[k, nodes], color=viridis(0.1 + 0.8 * k / len(data.frames)),
                          label=f"frame {frame}")
            axis.set(xlabel="column [px]", ylabel=name)
            _mark_image(axis, record)
        axes[-1].legend()
        return to_picture(figure, "displacements", "Motion along the section",
                      "The modelled side with the identified values. Dotted: end of the image.")


def sensitivities(record: RunRecord) -> Picture | None:
    """Sensitivity of every free parameter along the section, each relative to its largest value."""
    data = record.sensitivities
    if data is None or not len(data.names) or record.nodes_px is None:
        return None
    nodes, column = places(record)
    moving = [k for k in range(data.phi_px.shape[2]) if np.abs(data.phi_px[:, nodes, k]).max() > 0.0]
    short = short_names(record.result["parameters"])
    with look():
        figure = new_figure(10.0, 3.4)
        axes = np.atleast_1d(figure.subplots(1, len(moving), sharey=True))
        for axis, k in zip(axes, moving, strict=True):
            for i, name in enumerate(data.names):
                phi = data.phi_px[i, nodes, k]
                largest = float(np.abs(phi).max())
                axis.plot(column, phi / (largest or 1.0), color=CYCLE[i % len(CYCLE)],
                          label=f"{short.get(name, name)} per {data.steps[i]}: {largest:.2g} px")
            axis.set(xlabel="column [px]", title=COMPONENTS[k])
            axis.legend(fontsize=7.0)
            _mark_image(axis, record)
        axes[0].set_ylabel("sensitivity / its maximum [–]")
        return to_picture(figure, "sensitivities", f"Sensitivities, frame {data.frame}",
                      "How far the pattern moves (heights over the size of a pixel) when one parameter changes by the "
                      "step stated. The test does not separate parameters whose curves have the same shape in all "
                      "frames.")


def height_profile(figure: Figure, record: RunRecord, view: FrameView) -> None:
    """Height of one frame, measured and simulated, and the residual below; means over the image rows."""
    profile, level = view.profile, np.nan if record.noise_level is None else record.noise_level[view.frame]
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.0, 1.0))
    above.plot(profile.column, profile.measured, color=Colour.GREY, lw=2.6, label="measured")
    above.plot(profile.column, profile.measured + profile.misfit, color=Colour.ORANGE, lw=1.1, label="simulated")
    above.set_ylabel(f"height [{record.value_unit}]")
    above.legend()
    if np.isfinite(level):
        band = np.where(profile.rows > 0, 2.0 * level / np.sqrt(np.maximum(profile.rows, 1)), np.nan)
        below.fill_between(profile.column, -band, band, color=Colour.FAINT, lw=0, label="95 % of noise alone")
        below.legend()
    below.plot(profile.column, profile.misfit, color=Colour.ORANGE, lw=0.9)
    below.set(xlabel="column [px]", ylabel=f"residual [{record.value_unit}]")


def places(record: RunRecord) -> tuple[np.ndarray, np.ndarray]:
    """The nodes of the section in the order of their column, and the columns  # (n,), (n,) px"""
    nodes = np.unique(np.concatenate([np.ravel(conn) for _, conn in record.cells]))
    column = record.nodes_px[nodes, 0]
    order = np.argsort(column, kind="stable")
    return nodes[order], column[order]


def _mark_image(axis, record: RunRecord) -> None:
    """Where the image ends."""
    if record.reference is None:
        return
    low, high = axis.get_xlim()
    for edge in (0.0, record.reference.shape[1] - 1.0):
        if low < edge < high:
            axis.axvline(edge, color=Colour.GREY, ls=":", lw=1.0)
