"""A finished figure, and its colours and sizes; here nothing needs Matplotlib, whose import takes half a second."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from PIL import Image



class Colour(StrEnum):
    """Of lines and marks; the first seven by Okabe and Ito, https://jfly.uni-koeln.de/color/"""

    BLUE = "#0072B2"
    ORANGE = "#E69F00"
    GREEN = "#009E73"
    RED = "#D55E00"
    PURPLE = "#CC79A7"
    SKY = "#56B4E9"
    BLACK = "#222222"
    GREY = "#6b7280"
    FAINT = "#d5d8dd"


CYCLE = tuple(Colour)[:7]  # of several curves
DPI = 150
JPEG_QUALITY = 72
WEBP_QUALITY = 65  # of a map in the page: noise is half of the size of a JPEG that looks the same
WEBP_EFFORT = 2  # of a chart without loss: the size of 4 in less time
PNG_COMPRESSION = 3  # of a PNG: zlib's 6 takes twice as long for a tenth
CSS_DPI = 96  # pixels per inch of a page in a browser
PAGE_PX = 550  # of a picture that is no figure of this module


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


def webp(pixels: np.ndarray, exact: bool) -> bytes:
    """A picture for the page (rows, columns, 3 or more of 8 bits); exact : without loss."""
    buffer, image = io.BytesIO(), Image.fromarray(np.asarray(pixels)[..., :3])
    if exact:
        image.save(buffer, "webp", lossless=True, method=WEBP_EFFORT)
    else:
        image.save(buffer, "webp", quality=WEBP_QUALITY)
    return buffer.getvalue()
