"""Height maps of profilometers, by two libraries that must agree: each reads some formats wrongly, without a sign.

Seen with surfalize 0.19.2 and SurfaceTopography 1.27.1 on files of the instruments: .tmd differs by 1000 in all
lengths, .nms in pitch and in a constant height. Heights come in µm, the first row on top, NaN where none was measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from functools import lru_cache
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.readers.delimited.xyz_grid import XyzGrid
from idic.readers.formats.format import HEIGHTS, Format

FORMAT = Format(
    HEIGHTS, "profilometers (Sensofar, Digital Surf, Alicona, Wyko, Olympus, Keyence, Zeiss, …)",
    (".plu", ".plux", ".x3p", ".sur", ".al3d", ".opd", ".lext", ".vk3", ".vk4", ".vk6", ".vk7", ".sdf", ".tmd", ".nms",
     ".oir", ".poir", ".os3d", ".gwy", ".zmg", ".zon"),
    "surfalize and SurfaceTopography", "pitch, unit (µm), missing points, times", "height_unit = \"um\"",
    "made by layout (.plu, .plux) and surfalize; real .plu, .x3p, .al3d, .opd, .sur",
    is_extra=True)
_MAX_HEIGHT_DIFFERENCE = 1e-4  # of the range of the map: both scale the same integers
_MAX_PITCH_DIFFERENCE = 1e-6  # relative
_EARLY = {".plu": 2}  # heights by which surfalize 0.19 begins too early: it takes the size of the layer for heights
_UM_PER_UNIT = {"m": 1e6, "mm": 1e3, "µm": 1.0, "um": 1.0, "nm": 1e-3, "Å": 1e-4, "pm": 1e-6}


@dataclass(frozen=True, eq=False)
class HeightMap:
    """heights : (ny, nx) µm, NaN where missing; pitch_um : along and across the rows; time : None where unknown"""

    heights: np.ndarray
    pitch_um: tuple[float, float]
    time: datetime | None = None

    @property
    def words(self) -> str:
        """Size, pitch and range, for a message."""
        n_missing = int(np.isnan(self.heights).sum())
        return (f"{self.heights.shape[1]} x {self.heights.shape[0]} points, {self.pitch_um[0]:.6g} x "
                f"{self.pitch_um[1]:.6g} um apart, heights {np.nanmin(self.heights):.6g} to "
                f"{np.nanmax(self.heights):.6g} um, {n_missing} missing")


def height_grid(path: Path) -> tuple[XyzGrid, float | None]:
    """Grid of a map, and when it was taken in s; None where the file does not say.

    Raises
    ------
    InputError
        A library is missing or cannot read the file, or the two disagree.
    """
    return _known_grid(path, path.stat().st_mtime_ns)


def read_heights(path: Path) -> np.ndarray:
    """The heights in µm, NaN where none was measured  # (ny, nx) float32

    Raises
    ------
    InputError
        As `height_grid`.
    """
    return _agreed(path, path.stat().st_mtime_ns).heights.astype(np.float32)


@lru_cache(maxsize=4096)  # maps of a test
def _known_grid(path: Path, changed_ns: int) -> tuple[XyzGrid, float | None]:
    height_map = _agreed(path, changed_ns)
    time = height_map.time
    seconds = None if time is None else (time.replace(tzinfo=None) - datetime(1970, 1, 1)).total_seconds()
    return XyzGrid(height_map.heights.shape, height_map.pitch_um, "um", "um"), seconds


@lru_cache(maxsize=1)  # grid and heights are asked for in turn
def _agreed(path: Path, _changed_ns: int) -> HeightMap:
    with FORMAT.decoded(path):
        maps, problems = [], []
        for name, read in (("surfalize", _by_surfalize), ("SurfaceTopography", _by_surface_topography)):
            try:
                height_map = read(path)
            except ImportError:
                raise
            except Exception as problem:  # noqa: BLE001  (both raise many kinds)
                problems.append(f"{name}: {type(problem).__name__} {problem}".strip())
            else:
                maps.append(height_map)
                problems.append(f"{name}: {height_map.words}")
        agreed = _common(maps[0], maps[1], _EARLY.get(path.suffix.lower(), 0)) if len(maps) == 2 else None
        if agreed is None:
            raise InputError(f"the libraries that read {path.suffix} do not agree on this file" if maps
                             else f"neither library can read this {path.suffix} file", file=path, key="images",
                             expected="one and the same map by surfalize and SurfaceTopography",
                             found="; ".join(problems), remedy="export the map as .x3p, XYZ text or 32-bit float TIFF, "
                             "or copy the file again if it is damaged")
        return agreed


def _common(first: HeightMap, second: HeightMap, early: int) -> HeightMap | None:
    """The map on which both agree; None where they do not. early : values by which the first may be shifted."""
    if first.heights.shape != second.heights.shape or not np.isfinite(second.heights).any() or not np.allclose(
            first.pitch_um, second.pitch_um, rtol=_MAX_PITCH_DIFFERENCE, atol=0.0):
        return None
    most = _MAX_HEIGHT_DIFFERENCE * float(np.nanmax(second.heights) - np.nanmin(second.heights))
    most += float(np.finfo(np.float32).eps * np.nanmax(np.abs(second.heights)))
    if not np.isfinite(most):
        return None
    values, other_values = first.heights.ravel(), second.heights.ravel()
    if np.allclose(values, other_values, rtol=0.0, atol=most, equal_nan=True):
        return first
    if early and np.allclose(values[early:], other_values[:-early], rtol=0.0, atol=most, equal_nan=True):
        return HeightMap(second.heights, second.pitch_um, first.time)
    return None


def _by_surfalize(path: Path) -> HeightMap:
    from surfalize import Surface

    surface = Surface.load(path)
    time = surface.metadata.get("timestamp")
    return HeightMap(np.asarray(surface.data, float), (float(surface.step_x), float(surface.step_y)),
                     time if isinstance(time, datetime) else None)


def _by_surface_topography(path: Path) -> HeightMap:
    from SurfaceTopography import open_topography

    suffix = path.suffix.lower()
    with (np.errstate(over="ignore"),  # a missing point as the largest number: the other library tells
          open_topography(str(path), format="vk" if suffix.startswith(".vk") else suffix[1:]) as reader):
        topography = reader.topography()
        heights = topography.heights()  # (nx, ny), masked where missing
        if heights.ndim != 2 or topography.unit not in _UM_PER_UNIT:
            raise ValueError(f"{heights.ndim} axes, unit {topography.unit}")
        factor = _UM_PER_UNIT[topography.unit]
        sizes = [factor * float(size) / n for size, n in zip(topography.physical_sizes, heights.shape, strict=True)]
        values = np.ma.filled(np.ma.asarray(heights, float), np.nan).T
        return HeightMap(factor * values, (sizes[0], sizes[1]))
