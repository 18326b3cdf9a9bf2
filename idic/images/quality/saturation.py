"""Saturated pixels: those at the largest grey value that the sensor has, whatever depth the file has.

A camera of 10, 12 or 14 bits is stored in 16: its largest value is that of its own bits, in the lower or the upper
ones of the file.
"""

from __future__ import annotations

import numpy as np

SENSOR_BITS = (10, 12, 14)


def saturated_share(image: np.ndarray, region: np.ndarray) -> float | None:
    """Share of the pixels of a region at the largest value of the sensor; None where the image has no such value.

    image : (ny, nx), unsigned; of floats no limit is known.  region : (ny, nx) bool, True on the specimen.
    """
    if image.dtype.kind != "u" or not region.any():
        return None
    return float((image[region] >= largest_value(image)).mean())


def largest_value(image: np.ndarray) -> int:
    """The largest grey value that the sensor has, by that of its image: of its bits, else of those of the file."""
    top, file_max = int(image.max()), int(np.iinfo(image.dtype).max)
    bits = file_max.bit_length()
    sensor_maxima = [(1 << n) - 1 for n in SENSOR_BITS if n < bits]
    shifted = [value << (bits - value.bit_length()) for value in sensor_maxima]  # of which the lower bits are 0
    return top if top in sensor_maxima or top in shifted else file_max


def sensor_levels(image: np.ndarray) -> float:
    """Number of grey levels of the sensor, in those of the file: of the fewest bits that hold all values, of a camera
    of 12 bits in the lower ones of 16 those of 12.

    image : (ny, nx), unsigned, or of floats in grey values
    """
    bits = 8 * image.dtype.itemsize if image.dtype.kind == "u" else 16
    return 2.0 ** next((n for n in (8, *SENSOR_BITS) if n < bits and image.max() < 2**n), bits)
