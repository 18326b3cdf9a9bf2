"""Images of scanning electron microscopes: size of a pixel from their tags, and the data bar below the image.

FEI (Thermo Fisher) and Zeiss write it into tags of the TIFF, JEOL into a text file beside the image. The resolution
tags of these files are those of a screen. Zeiss gives the pixel of a screen of 1024 columns, and that of the image in
newer files only: sources as in tifffile and RosettaSciIO.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tifffile

from idic.readers.delimited.text_files import text_of
from idic.readers.delimited.units import parse_unit
from idic.readers.formats.format import IMAGES, Format
from idic.remote_files import fetch

FORMAT = Format(IMAGES, "electron microscopes (FEI, Zeiss, JEOL)", (), "tifffile",
                "pixel size; data bar left out", ".txt of JEOL beside the image",
                "made; real FEI, Zeiss")
_ZEISS_SCREEN_PX = 1024
_ZEISS_PIXEL = 3  # place of the size of a pixel in m in the list without names
_MIN_BAR_SHARE, _MAX_BAR_SHARE = 0.02, 0.25  # of the rows
_MIN_BACKGROUND = 0.5  # of a row of the bar: pixels of exactly one grey value; of an image a tenth
_MAX_BELOW = 3  # rows of the image below the bar: Zeiss leaves one
_JEOL_MARK = "$$SM_MICRON_BAR"


@dataclass(frozen=True)
class Micrograph:
    """pixel_mm : (width, height) of a pixel, None where the file does not state it; bar_rows : of the data bar"""

    pixel_mm: tuple[float, float] | None
    bar_rows: int

    @property
    def note(self) -> str:
        """The rows of the data bar in words; empty without one."""
        return (f"an image of an electron microscope: the data bar, the lowest {self.bar_rows} rows, is left out"
                if self.bar_rows else "")


def micrograph(path: Path, shape: tuple[int, int], pixels: Callable[[], np.ndarray],
               tiff: tifffile.TiffFile | None = None) -> Micrograph | None:
    """What an image says of its microscope; None for other images.

    shape : (ny, nx) as stored; pixels : reads them, where only they show the bar; tiff : the open file
    """
    entries = (_fei(tiff, shape) or _zeiss(tiff, shape)) if tiff is not None else None
    entries = entries or _jeol(path, shape)
    if entries is None:
        return None
    pixel_mm, bar_rows = entries
    return Micrograph(pixel_mm, _bar_in(pixels()) if bar_rows is None else bar_rows)


def _fei(tiff: tifffile.TiffFile, shape: tuple[int, int]) -> tuple[tuple[float, float] | None, int | None] | None:
    tables = tiff.fei_metadata if tiff.is_fei else None
    if not tables:
        return None
    scan, rows = tables.get("Scan", {}), tables.get("Image", {}).get("ResolutionY")
    sizes = scan.get("PixelWidth"), scan.get("PixelHeight")
    has_sizes = all(isinstance(size, float) and size > 0.0 for size in sizes)
    is_below = isinstance(rows, int) and 0 < rows < shape[0]
    return (1e3 * sizes[0], 1e3 * sizes[1]) if has_sizes else None, shape[0] - rows if is_below else None


def _zeiss(tiff: tifffile.TiffFile, shape: tuple[int, int]) -> tuple[tuple[float, float] | None, None] | None:
    tags = tiff.sem_metadata if tiff.is_sem else None
    if not tags:
        return None
    entry, unnamed = tags.get("ap_image_pixel_size"), tags.get("", ())
    size = None
    if entry is not None and len(entry) > 2 and (unit := parse_unit(str(entry[2]))) is not None:
        size = float(entry[1]) * unit.factor
    elif len(unnamed) > _ZEISS_PIXEL:
        size = 1e3 * float(unnamed[_ZEISS_PIXEL]) * _ZEISS_SCREEN_PX / shape[1]
    return (size, size) if size else None, None


def _jeol(path: Path, shape: tuple[int, int]) -> tuple[tuple[float, float] | None, int | None] | None:
    sidecar = path.with_suffix(".txt")
    if not sidecar.is_file():
        return None
    with sidecar.open("rb") as stream:
        head = stream.read(1 << 16)
    if _JEOL_MARK.encode() not in head:
        return None
    fetch(sidecar)
    entries = dict(re.findall(r"^(\$+\w+)\s+(.*?)\s*$", text_of(head, sidecar, "images")[0], re.MULTILINE))
    size = [int(number) for number in entries.get("$CM_FULL_SIZE", "").split() if number.isdigit()]
    marker = re.fullmatch(r"([\d.]+)\s*([a-zµμ]+)", entries.get("$$SM_MICRON_MARKER", ""))
    unit = parse_unit(marker[2]) if marker else None
    bar_px = float(entries[_JEOL_MARK]) if re.fullmatch(r"[\d.]+", entries.get(_JEOL_MARK, "")) else 0.0
    bar_px *= shape[1] / size[0] if len(size) == 2 and size[0] else 1.0
    pixel = float(marker[1]) * unit.factor / bar_px if unit is not None and bar_px > 0.0 else None
    rows = round(size[1] * shape[1] / size[0]) if len(size) == 2 and size[0] else shape[0]
    return (pixel, pixel) if pixel else None, shape[0] - rows if 0 < rows < shape[0] else None


def _bar_in(image: np.ndarray) -> int:
    """Rows at the lower edge most of whose pixels have one grey value, of the background or of a frame; 0 without."""
    most = int(_MAX_BAR_SHARE * len(image))
    is_bar = [_share_of_one_value(row) > _MIN_BACKGROUND for row in image[:-most - 2:-1]]
    start = next((k for k in range(min(_MAX_BELOW + 1, len(is_bar))) if is_bar[k]), 0)
    rows = next((k for k in range(start, len(is_bar)) if not is_bar[k]), len(is_bar))
    return rows if rows - start >= _MIN_BAR_SHARE * len(image) and rows <= most else 0


def _share_of_one_value(row: np.ndarray) -> float:
    """Of the pixels of a row those that have its most frequent grey value."""
    return float(np.unique(row, return_counts=True)[1].max()) / len(row)
