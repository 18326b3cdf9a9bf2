"""Height maps whose files state units and pitch: whether the experiment file says the same."""

from __future__ import annotations

import numpy as np

from idic.errors import InputError
from idic.images import Camera, Stack
from idic.readers import FileStack, parse_unit

MIN_TOLD = 1e-3  # relative difference of pitch and pixel size: less is the rounding of a typed number
MAX_DIFFERENCE = 0.05  # more is no calibration of the instrument: another unit, objective or resolution
HEIGHT_UNITS = ("m", "mm", "um", "nm")  # of `height_unit`


def check_height_unit(stack: Stack, height_unit: str | None, file, key: str) -> None:
    """InputError where the files state another unit of the heights than `height_unit`; None: they are no heights."""
    if not isinstance(stack, FileStack) or stack.grid is None:
        return
    unit = stack.grid.height_unit
    if unit is None or height_unit is None or parse_unit(unit) == parse_unit(height_unit):
        return
    alike = [name for name in HEIGHT_UNITS if parse_unit(name) == parse_unit(unit)]
    raise InputError("the unit of the heights differs from that in the files", file=file, key=key,
                     expected=f"height_unit = {height_unit!r}", found=f"{unit} in {stack.labels[0]}",
                     remedy=f'write height_unit = "{alike[0]}"' if alike
                     else f"export the heights in one of {', '.join(HEIGHT_UNITS)}")


def pitch_in_words(stack: Stack) -> str | None:
    """The pitch that the files state, as the value of a key; None where they state none."""
    pitch_mm = stack.grid.pitch_mm if isinstance(stack, FileStack) and stack.grid is not None else None
    return None if pitch_mm is None else f"{pitch_mm[0]:.6g}"


def pitch_notes(stack: Stack, camera: Camera, section: bool, file) -> list[str]:
    """A note where the pitch of the files is not quite the size of a pixel of the camera.

    section : of a cross-section, in which only the direction of x counts

    Raises
    ------
    InputError
        They differ by more than a calibration of the instrument explains.
    """
    if not isinstance(stack, FileStack) or stack.grid is None or (pitch_mm := stack.grid.pitch_mm) is None:
        return []
    pixel_mm = np.linalg.norm(np.linalg.inv(camera.matrix), axis=0)  # along a row, along a column
    pairs = list(zip(("along", "across"), pitch_mm, pixel_mm, strict=True))
    if section:
        pairs = [pairs[int(np.argmax(np.abs(camera.matrix[:, 0])))]]
    name, pitch, pixel = max(pairs, key=lambda pair: abs(pair[2] / pair[1] - 1.0))
    words = f"{pitch:.6g} mm {name} the rows in {stack.labels[0]}"
    if abs(pixel / pitch - 1.0) > MAX_DIFFERENCE:
        raise InputError("the size of a pixel differs from the pitch of the height images", file=file,
                         key="camera.pixel_size_mm", expected=words, found=f"{pixel:.6g} mm",
                         remedy="write the pitch as pixel_size_mm; a grid with two pitches needs matrix_px_per_unit")
    if abs(pixel / pitch - 1.0) > MIN_TOLD:
        return [f"the camera has {pixel:.6g} mm per pixel, the files state {words}: the camera's value is used"]
    return []
