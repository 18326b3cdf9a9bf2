"""Volumes in TIFF files: plain pages, ImageJ and OME stacks, tiles, one page for a stack above 4 GB.

Planes without compression are read at their place in the file. Compressed strips and tiles are decoded one by one, and
kept while there is room.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import tifffile

from idic.errors import InputError
from idic.readers.volumes.entry import VolumeEntry, damaged, mm_per, no_axes, volume_entry
from idic.readers.volumes.voxels import Chunks, RawPlanes, VoxelSource, truncated
from idic.remote_files import fetch

_X_RESOLUTION, _Y_RESOLUTION = 282, 283
_DEPTH_AXES = "ZIQ"  # planes, images of an unnamed sequence, an axis without a meaning
_SAVE_ONE = "save one channel of one scan as a stack of planes (ImageJ: Image > Duplicate, then File > Save As > Tiff)"
_MAX_OPEN_FILES = 8  # compressed files whose lists of pages are kept, per process


def tiff_entries(path: Path) -> list[VolumeEntry]:
    """The scans of a TIFF file: one, or one per time where the file names an axis of time beside planes.

    The voxel size is that of ImageJ (resolution, spacing and unit) or OME (PhysicalSize); a resolution for prints is
    not taken for one.

    Raises
    ------
    InputError
        The file is damaged or too short, has channels, colours, different pages, or one page only.
    """
    try:
        with tifffile.TiffFile(path) as tiff:
            return _entries(tiff, path)
    except InputError:
        raise
    except Exception as error:  # tifffile raises many types on damaged files
        raise damaged(path, error) from error


def _entries(tiff: tifffile.TiffFile, path: Path) -> list[VolumeEntry]:
    series = [part for part in tiff.series if part.kind != "label"]
    if len(series) != 1:
        raise no_axes(path, f"{len(series)} groups of pages that differ: " + ", ".join(
            " x ".join(map(str, part.shape)) for part in series[:4]), _SAVE_ONE)
    scan = series[0]
    if scan.is_multifile:
        raise InputError("the pages of the volume lie in several files", file=path, key="volumes",
                         expected="one file per scan", found="an OME series of several files",
                         remedy="save the scan as one file")
    n_times, n_planes = _times_and_planes(scan, path)
    page = scan.keyframe
    ny, nx = int(page.imagelength), int(page.imagewidth)
    dtype = np.dtype(page.dtype).newbyteorder(tiff.byteorder)
    per_time = [_source(tiff, scan, range(k * n_planes, (k + 1) * n_planes), (n_planes, ny, nx), dtype, path)
                for k in range(n_times)]
    voxel_mm, interval_s = _voxel(tiff, path), _interval(tiff)
    return [volume_entry(path, source, (n_planes, ny, nx), dtype, voxel_mm, part=f"[{k}]" if n_times > 1 else "",
                         time_s=k * interval_s if n_times > 1 and interval_s else None)
            for k, source in enumerate(per_time)]


def _times_and_planes(series: tifffile.TiffPageSeries, path: Path) -> tuple[int, int]:
    """Numbers of times and of planes of each; InputError for other axes."""
    page = series.keyframe
    sizes = [(axis, int(n)) for axis, n in zip(series.axes, series.shape, strict=True) if n > 1 or axis in "YX"]
    words = " x ".join(f"{n} ({axis})" for axis, n in sizes)
    outer = [(axis, n) for axis, n in sizes if axis not in "YX"]
    if page.samplesperpixel > 1 or page.imagedepth > 1 or any(axis == "S" for axis, _ in outer):
        raise no_axes(path, f"{words}: colours, or several values per voxel", _SAVE_ONE)
    axes = "".join(axis for axis, _ in outer)
    if axes == "" or (len(axes) == 1 and axes in _DEPTH_AXES):
        return 1, outer[0][1] if outer else 1
    if axes == "T":
        raise no_axes(path, f"{words}: images of one plane at {outer[0][1]} times",
                      "state the axis as planes (ImageJ: Image > Properties, slices in place of frames), and save it")
    if axes == "TZ":
        return outer[0][1], outer[1][1]
    raise no_axes(path, words, _SAVE_ONE)


def _source(tiff: tifffile.TiffFile, series: tifffile.TiffPageSeries, numbers: range, shape: tuple[int, int, int],
            dtype: np.dtype, path: Path) -> VoxelSource:
    plane_bytes = shape[1] * shape[2] * dtype.itemsize
    if series.dataoffset is not None:
        return RawPlanes(path, shape, dtype, (series.dataoffset + numbers.start * plane_bytes,))
    size, pages = path.stat().st_size, [series.pages[k] for k in numbers]
    missing = next((k for k, page in enumerate(pages) if page is None or not page.dataoffsets), None)
    if missing is not None:
        raise InputError("a plane of the volume is missing", file=path, key="volumes",
                         expected=f"{len(pages)} planes by the header", found=f"no plane {missing}",
                         remedy="export the scan again, or leave it out")
    end = max(offset + n for page in pages
              for offset, n in zip(page.dataoffsets, page.databytecounts, strict=True))
    if end > size:
        raise truncated(path, end, size)
    page = series.keyframe
    if all(frame.is_contiguous and frame.databytecounts[0] for frame in pages) and page.is_final:
        return RawPlanes(path, shape, dtype, tuple(int(frame.dataoffsets[0]) for frame in pages))
    chunk = (1, int(page.tilelength), int(page.tilewidth)) if page.is_tiled \
        else (1, min(int(page.rowsperstrip), shape[1]), shape[2])
    pages_of_file = tuple(int(frame.index) for frame in pages)
    return Chunks(shape, dtype, chunk, _Segments(path, pages_of_file, shape, chunk),
                  ("tiff", str(path), path.stat().st_mtime_ns, numbers.start))


@dataclass(frozen=True)
class _Segments:
    """Decodes strips and tiles.

    pages : number in the file of each plane; chunk : shape of a strip or tile
    """

    path: Path
    pages: tuple[int, ...]
    shape: tuple[int, int, int]
    chunk: tuple[int, int, int]

    def __call__(self, place: tuple[int, int, int]) -> np.ndarray:
        fetch(self.path)
        plane, row, column = place
        number = row * -(-self.shape[2] // self.chunk[2]) + column
        tiff, lock = _open_tiff(self.path, self.path.stat().st_mtime_ns)
        with lock:
            page = tiff.pages[self.pages[plane]]
            tiff.filehandle.seek(page.dataoffsets[number])
            content = tiff.filehandle.read(page.databytecounts[number])
            decode, tables = page.keyframe.decode, page.jpegtables
        if len(content) < page.databytecounts[number]:
            raise truncated(self.path, page.dataoffsets[number] + page.databytecounts[number],
                            self.path.stat().st_size)
        expectation = [min((k + 1) * n, total) - k * n
                       for k, n, total in zip(place, self.chunk, self.shape, strict=True)]
        if not content:  # a sparse segment: no voxel of it is stored
            return np.zeros(expectation, page.dtype)
        segment = decode(content, number, jpegtables=tables)[0]
        voxels = segment[0, :, :, 0][: expectation[1], : expectation[2]]
        if voxels.shape != tuple(expectation[1:]):
            raise ValueError(f"a segment of {voxels.shape} voxels in place of {tuple(expectation[1:])}")
        return np.ascontiguousarray(voxels)[None]


@lru_cache(_MAX_OPEN_FILES)
def _open_tiff(path: Path, changed_ns: int) -> tuple[tifffile.TiffFile, threading.Lock]:
    """A file that stays open for the next block; `changed_ns` opens it anew where it was written again."""
    return tifffile.TiffFile(path), threading.Lock()


# size of a voxel ---------------------------------------------------------------------------------------
def _voxel(tiff: tifffile.TiffFile, path: Path) -> tuple[float, ...] | None:
    if tiff.is_ome:
        return _ome_voxel(tiff.ome_metadata or "", path)
    if not tiff.is_imagej:
        return None
    header, tags = tiff.imagej_metadata or {}, tiff.pages[0].tags
    factor = mm_per(str(header.get("unit", "")), path)
    per_unit = [tags.valueof(tag) for tag in (_Y_RESOLUTION, _X_RESOLUTION)]
    if factor is None or any(not value or not value[0] or not value[1] for value in per_unit):
        return None
    spacing = float(header.get("spacing", 1.0))  # ImageJ does not write a depth of 1
    return (factor * abs(spacing), *(factor * value[1] / value[0] for value in per_unit))


def _interval(tiff: tifffile.TiffFile) -> float | None:
    """Time between the scans of an ImageJ stack in s; None without."""
    header = tiff.imagej_metadata or {} if tiff.is_imagej else {}
    interval = float(header.get("finterval", 0.0))
    return interval if interval > 0 and str(header.get("tunit", "sec")) in ("sec", "s", "second", "seconds") else None


def _ome_voxel(text: str, path: Path) -> tuple[float, ...] | None:
    """Sides of a voxel by the first image of an OME header; None where not all three are stated."""
    pixels = next((element for element in ElementTree.fromstring(text).iter()
                   if str(element.tag).rpartition("}")[2] == "Pixels"), None)
    if pixels is None or any(pixels.get(f"PhysicalSize{axis}") is None for axis in "ZYX"):
        return None
    factors = [mm_per(pixels.get(f"PhysicalSize{axis}Unit", "um"), path) for axis in "ZYX"]
    if None in factors:
        return None
    return tuple(factor * float(pixels.get(f"PhysicalSize{axis}"))
                 for factor, axis in zip(factors, "ZYX", strict=True))
