"""One look for all figures: no pyplot, no global state, colours that the colour-blind can tell apart."""

from __future__ import annotations

import io

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from idic.path_names import path_name
from idic.report.figures.layout import MeasuredOnce
from idic.report.figures.picture import DPI, PNG_COMPRESSION, Colour, Picture, webp

MARKERS = ("o", "s", "^", "D", "v", "P", "X")
DIVERGING, SEQUENTIAL = "RdBu_r", "viridis"
N_COLOURS = 256  # of a map as PNG: a quarter of the size
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
    return Picture(file, title, caption, sharp.getvalue(), light=webp(pixels, exact=not as_photo))
