"""The scan of a volume as its file describes it, and checks that all formats share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.readers.delimited.units import factor_to
from idic.readers.volumes.voxels import RawPlanes, VoxelSource, truncated

DEPTHS = ("uint8", "uint16", "int16", "uint32", "int32", "float32", "float64")
_UNIT_WORDS = {"micron": "um", "microns": "um", "micrometer": "um", "micrometre": "um", "\\u00b5m": "um",
               "millimeter": "mm", "millimetre": "mm", "nanometer": "nm", "nanometre": "nm", "centimeter": "cm",
               "centimetre": "cm", "meter": "m", "metre": "m", "inches": "inch"}  # factor_to knows the symbols
_NO_UNITS = ("", "pixel", "pixels", "voxel", "voxels", "px", "none", "unknown")


@dataclass(frozen=True)
class VolumeEntry:
    """One scan: its axes are z, y, x.

    name : of the file, with the dataset or time in it; shape : (nz, ny, nx); dtype : of the grey values; voxel_mm :
    (dz, dy, dx) where the file states them; time_s : where the file states it; source : where the voxels lie
    """

    name: str
    shape: tuple[int, int, int]
    dtype: np.dtype
    voxel_mm: tuple[float, float, float] | None
    time_s: float | None
    path: Path
    source: VoxelSource = field(repr=False)

    def block(self, z: slice, y: slice, x: slice) -> np.ndarray:
        """The grey values of a block as stored, in native byte order  # (nz, ny, nx) of the slices

        Only the block is read, or the pages, strips or chunks that it touches.

        Parameters
        ----------
        z, y, x : slice
            Of whole voxels, with the meaning that they have for an array; steps are 1.

        Raises
        ------
        InputError
            The file is damaged, or has changed since it was opened.
        """
        parts = []
        for part, n in zip((z, y, x), self.shape, strict=True):
            start, stop, step = part.indices(n)
            if step != 1:
                raise ValueError(f"blocks have steps of 1, not {step}")
            parts.append(slice(start, max(start, stop)))
        if any(part.start == part.stop for part in parts):
            return np.empty([part.stop - part.start for part in parts], self.dtype)
        try:
            return self.source.read(tuple(parts))
        except InputError:
            raise
        except Exception as error:  # decoders of damaged files raise many types
            raise damaged(self.path, error) from error


def volume_entry(path: Path, source: VoxelSource, shape: Sequence[int], dtype: np.dtype,
                 voxel_mm: Sequence[float] | None = None, *, part: str = "", time_s: float | None = None
                 ) -> VolumeEntry:
    """An entry after the checks of its depth, size and voxels.

    part : what the name has behind that of the file, such as "::dataset"

    Raises
    ------
    InputError
        Grey values that idic does not read, a side of no voxel, or a file that is too short.
    """
    if dtype.name not in DEPTHS:
        raise InputError("grey values that idic does not read", file=path, key="volumes",
                         expected="unsigned integers of 8, 16 or 32 bit, integers of 16 or 32 bit, or floats of 32 or "
                                  "64 bit", found=dtype.name, remedy="convert the volume, e.g. to 16 bit")
    sides = tuple(int(n) for n in shape)
    if len(sides) != 3 or min(sides) < 2:
        raise InputError("not a volume", file=path, key="volumes", expected="at least 2 voxels along z, y and x",
                         found=" x ".join(map(str, sides)) + " (z, y, x)",
                         remedy="give the file of the whole scan, or for a scan in slices the folder that holds them")
    if isinstance(source, RawPlanes):
        check_length(source)
    return VolumeEntry(path.name + part, sides, dtype.newbyteorder("="), checked_voxel(voxel_mm, path), time_s, path,
                       source)


def check_length(source: RawPlanes) -> None:
    """InputError where the file ends before the last plane."""
    size = source.path.stat().st_size
    if size < source.end:
        raise truncated(source.path, source.end, size)


def checked_voxel(voxel_mm: Sequence[float] | None, path: Path) -> tuple[float, float, float] | None:
    """The sides of a voxel; None where the file states none; InputError where it states a size that cannot be."""
    if voxel_mm is None:
        return None
    sides = (float(voxel_mm[0]), float(voxel_mm[1]), float(voxel_mm[2]))
    if not all(math.isfinite(side) and side > 0 for side in sides):
        raise InputError("the file states a voxel size that cannot be", file=path, key="volumes",
                         expected="positive sides", found=" x ".join(f"{side:g}" for side in sides) + " mm (z, y, x)",
                         remedy="correct the header of the file")
    return sides


def mm_per(unit: str, path: Path) -> float | None:
    """Factor from a length unit of a header to mm; None for pixels and where there is none.

    Raises
    ------
    InputError
        The word is no unit of a length.
    """
    word = unit.strip().strip("\0\"' ")
    word = _UNIT_WORDS.get(word.lower(), word)
    if word.lower() in _NO_UNITS:
        return None
    factor = factor_to("mm", word)
    if factor is None:
        raise InputError("the file states its voxel size in a unit that idic does not know", file=path, key="volumes",
                         expected="mm, um, nm, cm, m or inch", found=repr(unit),
                         remedy="correct the header of the file")
    return factor


def damaged(path: Path, error: Exception) -> InputError:
    """The refusal of a file that its reader does not understand."""
    return InputError("the volume cannot be read", file=path, key="volumes",
                      expected="a file of the format that its name states",
                      found=f"{type(error).__name__}: {error}",
                      remedy="copy the file again (it is truncated, damaged or of another format), or leave it out")


def no_axes(path: Path, finding: str, remedy: str) -> InputError:
    """The refusal of axes that are not those of one volume."""
    return InputError("the axes of the file are not those of a volume", file=path, key="volumes",
                      expected="three axes z, y, x, or a fourth one of time", found=finding, remedy=remedy)
