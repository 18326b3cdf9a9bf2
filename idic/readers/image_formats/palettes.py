"""Grey values of images that are stored with a palette: a grey ramp, perhaps with some colours of an overlay, behind
the ramp or among its entries."""

from __future__ import annotations

import numpy as np

MAX_OVERLAY_SHARE = 0.02  # of the pixels: text and scale bars; a picture in false colours has more
_MIN_RAMP = 16  # entries: fewer are a drawing
OVERLAY_NOTE = ("some pixels are in the colours of an overlay and have the grey values of its palette: leave text and "
                "scale bars out with a mask")


def grey_of_palette(indices: np.ndarray, palette: np.ndarray) -> tuple[np.ndarray, int] | None:
    """Grey values, and the number of pixels in a colour; None for an image in colours.

    A pixel in a colour has its index as grey value.

    Parameters
    ----------
    indices : array (ny, nx) of unsigned integers
    palette : array (n, 3) uint8, red, green and blue of every entry
    """
    is_grey = (palette == palette[:, :1]).all(axis=1)
    if is_grey.all():
        return palette[indices, 0], 0
    n_coloured = int(np.count_nonzero(~is_grey[indices]))
    ramp = palette[:np.argmin(is_grey), 0].astype(int)  # the grey entries before the first colour
    is_ramp = len(ramp) >= _MIN_RAMP and 2 * len(ramp) >= len(palette) <= 256 and (np.diff(ramp) > 0).all()
    n_own_values = np.count_nonzero(is_grey & (palette[:, 0] == np.arange(len(palette))))  # entry 7 has the value 7
    is_ramp |= len(palette) == 256 and 2 * n_own_values >= len(palette)  # with colours in between, as Zeiss has them
    if not is_ramp or n_coloured > MAX_OVERLAY_SHARE * indices.size:
        return None
    values = np.where(is_grey, palette[:, 0], np.arange(len(palette))).astype(np.uint8)
    return values[indices], n_coloured
