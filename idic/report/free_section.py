"""The identified model compared with a free measurement of a cross-section: motion from the height images alone."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from idic.report.figures.maps import noise_units
from idic.report.figures.profiles import places
from idic.report.figures.picture import Colour, Picture
from idic.report.figures.style import look, new_figure, to_picture
from idic.report.result.record import RunRecord


def free_motion(record: RunRecord) -> Picture | None:
    """Residual of the model and of a free measurement along the section, and how far the two lie apart."""
    free_fit, data = record.free_fields, record.residuals
    if free_fit is None or free_fit.rise is None or data is None or free_fit.frames != data.frames:
        return None
    (nodes, column), units = places(record), noise_units(record)
    unit = record.value_unit if units is None else "σ"
    scale = np.ones(len(free_fit.frames)) if units is None else units
    floor = None if record.practice is None else record.practice.floor
    with look():
        figure = new_figure(10.0, 5.6)
        axes = figure.subplots(3, len(free_fit.frames), sharex=True, sharey="row", squeeze=False)
        for k, frame in enumerate(free_fit.frames):
            pair = data.identified[k] / scale[k], free_fit.residuals[k] / scale[k]
            for residual, colour, name in zip(pair, (Colour.ORANGE, Colour.BLUE), ("identified", "free"), strict=True):
                axes[0, k].plot(_column_means(residual), color=colour, lw=0.8, label=name)
            title = f"frame {frame}: rms {_rms(pair[0]):.2f}, free {_rms(pair[1]):.2f} {unit}"
            axes[0, k].set_title(title, fontsize=8.5)
            _difference(axes[1, k], column, free_fit.difference_px[k, nodes, 0], floor and floor.free_px)
            _difference(axes[2, k], column, free_fit.rise[k, nodes], floor and floor.free_rise)
            axes[2, k].set_xlabel("column [px]")
        axes[0, 0].legend(fontsize=7.0)
        for row, text in enumerate((f"mean residual [{unit}]", "free − identified,\nalong the section [px]",
                                    f"free − identified,\nheight [{record.value_unit}]")):
            axes[row, 0].set_ylabel(text)
        return to_picture(figure, "free_dic", "Identified model and free measurement", _free_caption(record))


def _difference(axis: Axes, column: np.ndarray, values: np.ndarray, noise: float | None) -> None:
    if noise is not None:
        axis.axhspan(-2.0 * noise, 2.0 * noise, color=Colour.FAINT, lw=0)
    axis.plot(column, values, color=Colour.BLUE)


def _free_caption(record: RunRecord) -> str:
    free_fit, floor = record.free_fields, None if record.practice is None else record.practice.floor
    frames = {entry["frame"]: entry for entry in record.result.get("frames", ()) if entry.get("chi2_dof") is not None}
    pairs = [f"frame {k}: {frames[k]['chi2_dof']:.3f} and {chi2:.3f}"
             for k, chi2 in zip(free_fit.frames, free_fit.chi2_dof, strict=True) if k in frames]
    text = ("Above: residuals, mean over the image rows. Below: motion along the section and height, found without law "
            "and load from the simulated ones; differences shorter than "
            f"{free_fit.length_px:.0f} px are smoothed. No law can reduce the residual of the free measurement.")
    if floor is not None and floor.free_px is not None and floor.free_rise is not None:
        text += (f" Grey: two standard deviations of noise alone, {floor.free_px:.2g} px and {floor.free_rise:.2g} "
                 f"{record.value_unit}.")
    return text + (f" χ² per pixel, identified and free: {'; '.join(pairs)}." if pairs else "")


def _column_means(residual: np.ndarray) -> np.ndarray:
    """Mean over the rows that were compared, NaN where there is none  # (ny, nx) -> (nx,)"""
    compared = np.isfinite(residual)
    count = compared.sum(axis=0)
    return np.where(count > 0, np.where(compared, residual, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(np.square(values))))
