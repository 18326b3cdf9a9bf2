"""Frame after frame: the image with the simulated mesh on it, and the residual; a slider in the page."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.image import AxesImage, imsave

from idic.parameters import digits_text
from idic.report.figures.maps import RESIDUAL_RANGE, residual_window
from idic.report.figures.profiles import height_profile, is_profile
from idic.report.figures.picture import JPEG_QUALITY, Colour, Picture, webp
from idic.report.figures.style import DIVERGING, look, new_figure, picked, show_pixels
from idic.report.result.record import FrameView, RunRecord
from idic.report.result.words import number_text

VIEW_WIDTH_INCH = 5.0  # inch; two stand side by side on a wide screen
MAX_VIEW_HEIGHT_INCH = 4.2
DPI = 100
OUTLINE_WIDTH_PT = 0.35


@dataclass(frozen=True)
class Slide:
    """One frame of the slider: its pictures, and a line of words."""

    frame: int
    words: str
    pictures: tuple[Picture, ...]


@dataclass(frozen=True)
class _Sheet:
    """A figure that is laid out once; from frame to frame only its image and its lines change."""

    figure: Figure
    artist: AxesImage
    lines: LineCollection | None = None
    window: tuple[float, float, float, float] | None = None

    def picked(self, values: np.ndarray) -> np.ndarray:
        """The pixels of a map that its image shows."""
        return picked(values, self.window, self.artist.axes, DPI)[0]


Sheets = dict[tuple, _Sheet]  # by what decides on their layout


def slides(record: RunRecord) -> tuple[Slide, ...]:
    """One per frame of ``record.views``."""
    if record.nodes_px is None:
        return ()
    views = [view for view in record.views if view.profile is not None or not is_profile(record)]
    sheets: Sheets = {}
    return tuple(_slide(record, view, sheets) for view in views)


def _slide(record: RunRecord, view: FrameView, sheets: Sheets) -> Slide:
    with look():
        pictures = [_image(record, view, sheets) if view.profile is None else _profile(record, view)]
        if view.residual is not None and np.isfinite(view.residual).any():
            pictures.append(_residual(record, view, sheets))
    return Slide(view.frame, _words(record, view.frame), tuple(pictures))


def _words(record: RunRecord, frame: int) -> str:
    entry = next((f for f in record.result.get("frames", ()) if f.get("frame") == frame), {})
    parts = [f"frame {frame}"] + ([entry["label"]] if entry.get("label") else [])
    if record.times is not None and record.time_label_unit == "s":
        parts.append(f"{record.times[frame]:.4g} s")
    for channel in record.channels:
        parts.append(f"{channel.name} {channel.measured[frame]:.4g}, simulated {channel.simulated[frame]:.4g}")
    if entry.get("rms_gv") is not None and not entry.get("reference"):
        parts.append(f"rms residual {digits_text(entry['rms_gv'], zeros=True)} {record.value_unit}")
    if entry.get("chi2_dof") is not None:
        parts.append(f"χ² {number_text(entry['chi2_dof'], 0.01)}")
    if entry.get("status") not in (None, "ok"):
        parts.append(entry["status"])
    return " · ".join(parts)


def _profile(record: RunRecord, view: FrameView) -> Picture:
    figure = new_figure(VIEW_WIDTH_INCH, MAX_VIEW_HEIGHT_INCH)
    height_profile(figure, record, view)
    return _jpeg(figure, f"frame_{view.frame:04d}", "height, mean over the image rows")


def _image(record: RunRecord, view: FrameView, sheets: Sheets) -> Picture:
    """The frame in its own pixels with the elements where the simulation has moved them."""
    finite = view.image[np.isfinite(view.image)]
    low, high = np.percentile(finite, (0.5, 99.5)) if len(finite) else (0.0, 1.0)
    corners = [view.nodes_px[cell[:3 if kind.startswith("tri") else 4]]
               for kind, cells in record.cells for cell in cells]
    key = ("image", view.image.shape)
    if key not in sheets:
        sheets[key] = _image_sheet(view.image)
    sheet = sheets[key]
    sheet.artist.set(data=sheet.picked(view.image), clim=(low, max(high, low + 1e-12)))
    sheet.lines.set_segments([np.concatenate([polygon, polygon[:1]]) for polygon in corners])
    return _jpeg(sheet.figure, f"frame_{view.frame:04d}", "image, simulated mesh")


def _image_sheet(image: np.ndarray) -> _Sheet:
    rows, columns = image.shape
    figure, axis = _axis(columns / rows)
    artist = show_pixels(axis, image, dpi=DPI, cmap="gray", interpolation="nearest")
    lines = axis.add_collection(LineCollection([], colors=Colour.ORANGE, linewidths=OUTLINE_WIDTH_PT))
    axis.set(xlim=(-0.5, columns - 0.5), ylim=(rows - 0.5, -0.5))
    return _Sheet(figure, artist, lines)


def _residual(record: RunRecord, view: FrameView, sheets: Sheets) -> Picture:
    levels = record.noise_level
    sigma = np.nan if levels is None else levels[view.frame]
    sigma = sigma if np.isfinite(sigma) else (np.nan if levels is None else np.nanmedian(levels))
    is_scaled = bool(np.isfinite(sigma))
    reach = RESIDUAL_RANGE if is_scaled else float(np.nanpercentile(np.abs(view.residual), 99)) or 1.0
    window, scaled = residual_window(view.residual[None]), view.residual / (sigma if is_scaled else 1.0)
    key = (*window, is_scaled, reach)
    if key not in sheets:
        unit = "residual / σ [–]" if is_scaled else f"residual [{record.value_unit}]"
        sheets[key] = _residual_sheet(scaled, window, reach, unit)
    sheet = sheets[key]
    sheet.artist.set_data(sheet.picked(scaled))
    return _jpeg(sheet.figure, f"left_{view.frame:04d}", "residual in the reference image")


def _residual_sheet(scaled: np.ndarray, window: tuple[float, float, float, float], reach: float, label: str) -> _Sheet:
    column_from, column_to, row_from, row_to = window
    figure, axis = _axis((column_to - column_from) / (row_to - row_from))
    artist = show_pixels(axis, scaled, window, DPI, cmap=DIVERGING, vmin=-reach, vmax=reach, interpolation="nearest")
    axis.set(xlim=(column_from, column_to), ylim=(row_to, row_from))
    figure.colorbar(artist, ax=axis, location="bottom", shrink=0.7, aspect=30, pad=0.02, extend="both", label=label)
    return _Sheet(figure, artist, window=window)


def _axis(aspect: float):
    height = min(VIEW_WIDTH_INCH / aspect + 0.5, MAX_VIEW_HEIGHT_INCH)
    figure = new_figure(min(VIEW_WIDTH_INCH, (height - 0.5) * aspect + 0.6), height)
    axis = figure.subplots()
    axis.set(xticks=[], yticks=[], aspect="equal")
    axis.grid(False)
    for spine in axis.spines.values():
        spine.set_visible(False)
    return figure, axis


def _jpeg(figure, name: str, title: str) -> Picture:
    buffer = io.BytesIO()
    figure.set_dpi(DPI)
    figure.canvas.draw()  # savefig lays out and draws twice, to the same end
    pixels = figure.canvas.buffer_rgba()
    imsave(buffer, pixels, format="jpeg", dpi=DPI, pil_kwargs={"quality": JPEG_QUALITY, "optimize": True})
    figure.set_layout_engine("none")  # it is laid out
    return Picture(name, title, "", buffer.getvalue(), "jpeg", light=webp(pixels, exact=False))
