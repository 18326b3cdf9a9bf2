"""One look for all figures: no pyplot, no global state, colours that the colour-blind can tell apart."""

from __future__ import annotations

import io

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from PIL import Image

from idic.path_names import path_name
from idic.report.figures.layout import MeasuredOnce
from idic.report.figures.picture import DPI, PNG_COMPRESSION, Colour, Picture, webp

MARKERS = ("o", "s", "^", "D", "v", "P", "X")
DIVERGING, SEQUENTIAL = "RdBu_r", "viridis"
N_COLOURS = 256  # of a map as PNG: a quarter of the size
SAMPLES_PER_PX = 2  # of a map along a pixel of the picture: fewer could beat with the texture
EVEN = Image.Quantize.FASTOCTREE  # the median cut takes the colours of a bar from the map beside it

RC = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titleweight": "regular",
    "axes.labelsize": 9.0,
    "axes.edgecolor": Colour.GREY,
    "axes.labelcolor": Colour.BLACK,
    "axes.linewidth": 0.7,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": Colour.FAINT,
    "grid.linewidth": 0.5,
    "xtick.color": Colour.GREY,
    "ytick.color": Colour.GREY,
    "xtick.labelcolor": Colour.BLACK,
    "ytick.labelcolor": Colour.BLACK,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "lines.linewidth": 1.4,
    "lines.markersize": 4.0,
    "figure.facecolor": "white",
    "svg.hashsalt": "idic",
    "svg.fonttype": "path",
    "mathtext.default": "regular",
}


def look():
    """Context in which every figure is made."""
    return matplotlib.rc_context(RC)


def new_figure(width: float, height: float, kind: type[Figure] = Figure) -> Figure:
    """A figure of `width` x `height` inch with constrained layout; call inside :func:`look`."""
    figure = kind(figsize=(width, height), layout=MeasuredOnce(w_pad=0.06, h_pad=0.06))
    FigureCanvasAgg(figure)
    return figure


def show_pixels(axis: Axes, values: np.ndarray, window: tuple[float, float, float, float] | None = None, dpi: int = DPI,
                **look_of_map) -> AxesImage:
    """Draw a map of pixels on axes, cut to a window and no finer than the picture can show it.

    Matplotlib holds several arrays of the size of an image while it draws.

    values : (ny, nx); window : columns from, to, rows from, to; look_of_map : for ``imshow``
    """
    samples, extent = picked(values, window, axis, dpi)
    return axis.imshow(samples, extent=extent, **look_of_map)


def picked(values: np.ndarray, window: tuple[float, float, float, float] | None, axis: Axes, dpi: int = DPI):
    """Every n-th pixel of a map in a window, and their extent (left, right, bottom, top)."""
    column_from, column_to, row_from, row_to = window or (-0.5, values.shape[1] - 0.5, -0.5, values.shape[0] - 0.5)
    first_column, first_row = max(int(column_from + 0.5), 0), max(int(row_from + 0.5), 0)
    cut = values[first_row : int(np.ceil(row_to + 0.5)), first_column : int(np.ceil(column_to + 0.5))]
    spec = axis.get_subplotspec()
    panels = (1, 1) if spec is None else spec.get_gridspec().get_geometry()
    room_px = SAMPLES_PER_PX * dpi * np.asarray(axis.figure.get_size_inches()) / panels[::-1]  # width, height
    step = max(int(min(cut.shape[1] / room_px[0], cut.shape[0] / room_px[1])), 1)
    samples = cut[step // 2 :: step, step // 2 :: step]
    x, y = first_column - 0.5, first_row - 0.5
    return samples, (x, x + step * samples.shape[1], y + step * samples.shape[0], y)


def to_picture(figure: Figure, name: str, title: str, caption: str, as_photo: bool = False) -> Picture:
    """The picture of a figure; as_photo : it is a map, whose noise may lose a little in the page."""
    figure.set_dpi(DPI)
    figure.canvas.draw()  # savefig lays out and draws twice, to the same end
    pixels, sharp = figure.canvas.buffer_rgba(), io.BytesIO()  # type: ignore[attr-defined]
    if as_photo:
        few = Image.fromarray(np.asarray(pixels)[..., :3]).quantize(N_COLOURS, EVEN, dither=Image.Dither.NONE)
        few.save(sharp, "png", dpi=(DPI, DPI), compress_level=PNG_COMPRESSION)
    else:
        Image.fromarray(np.asarray(pixels)[..., :3]).save(sharp, "png", dpi=(DPI, DPI), compress_level=PNG_COMPRESSION)
    file = path_name(name).replace("%", "_")  # a page links to it
    picture = Picture(file, title, caption, sharp.getvalue(), light=webp(pixels, exact=not as_photo))
    figure.clear()  # its parts hold each other, and their arrays, until Python looks for cycles
    return picture
