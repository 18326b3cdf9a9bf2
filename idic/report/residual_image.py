"""The residual of one frame as a small picture of its own: blue below and red above zero."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image

MAX_MAP_PX = 900  # width of the picture
RANGE = 4.0  # standard deviations of the noise: full colour


def residual_png(image: np.ndarray, std: float) -> bytes:
    """A PNG of the part of the image that has a residual; transparent where there is none.

    Parameters
    ----------
    image : (ny, nx) grey values, NaN where there is no residual
    std : of the noise, grey values
    """
    compared = np.isfinite(image)
    rows, columns = np.flatnonzero(compared.any(axis=1)), np.flatnonzero(compared.any(axis=0))
    if len(rows):
        part = np.s_[rows[0]:rows[-1] + 1, columns[0]:columns[-1] + 1]
        image, compared = image[part], compared[part]
    scaled = np.clip(np.nan_to_num(image) / (RANGE * std), -1.0, 1.0)
    low, high = np.clip(-scaled, 0.0, 1.0), np.clip(scaled, 0.0, 1.0)
    colours = np.stack([1.0 - low, 1.0 - 0.8 * (low + high), 1.0 - high, compared], axis=-1)  # (ny, nx, 4)
    picture = Image.fromarray(np.round(255 * colours).astype(np.uint8), "RGBA")
    if picture.width > MAX_MAP_PX:
        height = max(round(picture.height * MAX_MAP_PX / picture.width), 1)
        picture = picture.resize((MAX_MAP_PX, height), Image.Resampling.BOX)
    file = io.BytesIO()
    picture.save(file, "PNG")
    return file.getvalue()
