"""One look for all figures: no pyplot, no global state, colours that the colour-blind can tell apart."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from idic.report.figures.layout import MeasuredOnce
from idic.path_names import path_name

# Okabe & Ito, https://jfly.uni-koeln.de/color/
BLUE, ORANGE, GREEN, RED, PURPLE, SKY, BLACK = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#CC79A7",
    "#56B4E9",
    "#222222",
)
CYCLE = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, BLACK)
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
GREY, FAINT = "#6b7280", "#d5d8dd"
DIVERGING, SEQUENTIAL = "RdBu_r", "viridis"
DPI = 150
JPEG_QUALITY = 72
WEBP_QUALITY = 65  # of a map in the page: noise is half of the size of a JPEG that looks the same
WEBP_EFFORT = 2  # of a chart without loss: the size of 4 in less time
PNG_COMPRESSION = 3  # of a PNG: zlib's 6 takes twice as long for a tenth
N_COLOURS = 256  # of a map as PNG: a quarter of the size
EVEN = Image.Quantize.FASTOCTREE  # the median cut takes the colours of a bar from the map beside it
CSS_DPI = 96  # pixels per inch of a page in a browser
PAGE_PX = 550  # of a picture that is no figure of this module

RC = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titleweight": "regular",
    "axes.labelsize": 9.0,
    "axes.edgecolor": GREY,
    "axes.labelcolor": BLACK,
    "axes.linewidth": 0.7,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": FAINT,
    "grid.linewidth": 0.5,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": BLACK,
    "ytick.labelcolor": BLACK,
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


@dataclass(frozen=True)
class Picture:
    """A finished figure: file name (no ending), title, caption, and the image."""

    name: str
    title: str
    caption: str
    png: bytes  # or another `format`
    format: str = "png"
    light: bytes = b""  # a WebP for the page: a third of the size; the file stays one that every program opens

    @property
    def data_uri(self) -> str:
        kind = "webp" if self.light else self.format
        return f"data:image/{kind};base64," + base64.b64encode(self.light or self.png).decode("ascii")

    @property
    def width_px(self) -> int:
        """Width at which its letters are as large as those of the page; a small screen scrolls."""
        return PAGE_PX if self.format != "png" else round(int.from_bytes(self.png[16:20], "big") * CSS_DPI / DPI)


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


def webp(pixels: np.ndarray, exact: bool) -> bytes:
    """A picture for the page (rows, columns, 3 or more of 8 bits); exact : without loss."""
    buffer, image = io.BytesIO(), Image.fromarray(np.asarray(pixels)[..., :3])
    if exact:
        image.save(buffer, "webp", lossless=True, method=WEBP_EFFORT)
    else:
        image.save(buffer, "webp", quality=WEBP_QUALITY)
    return buffer.getvalue()
