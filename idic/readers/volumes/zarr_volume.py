"""Volumes in Zarr (versions 2 and 3) and OME-Zarr: of the latter the finest level, with its axes and scales."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from idic.errors import InputError
from idic.readers.delimited.units import factor_to
from idic.readers.volumes.entry import VolumeEntry, damaged, mm_per, no_axes, volume_entry
from idic.readers.volumes.voxels import Chunks, in_order

# Codecs that turn bytes into numbers; others, such as "pickle" of version 2, run what the file says.
_CODECS = {"blosc", "zlib", "gzip", "zstd", "lz4", "lzma", "bz2", "delta", "shuffle", "bitround", "fixedscaleoffset",
           "quantize", "packbits", "crc32", "crc32c", "adler32", "fletcher32", "bytes", "transpose",
           "sharding_indexed"}
_ONE_SCAN = "save one channel, with the axes z, y, x or t, z, y, x"
_MARKS = ("zarr.json", ".zarray", ".zgroup", ".zattrs")


@dataclass(frozen=True)
class _Axes:
    """The axes of an array: their names in its order, and size and unit of a step along each where stated."""

    names: tuple[str, ...]
    steps: tuple[float, ...] | None = None
    units: tuple[str, ...] | None = None


def is_zarr(folder: Path) -> bool:
    """Whether a folder is a Zarr array or group."""
    return any((folder / mark).is_file() for mark in _MARKS)


def zarr_entries(path: Path, dataset: str = "") -> list[VolumeEntry]:
    """The scans of a Zarr folder: one, or one per time where its axes name the time.

    dataset : path of the array in a group that holds several

    Raises
    ------
    InputError
        The folder is damaged, holds no or several volumes, has other axes, or codecs that run code.
    """
    import zarr  # here: few experiments have such files

    try:
        root = zarr.open(path, mode="r")
        array, axes = _chosen(root, dataset, path)
        _check_codecs(array, path)
    except InputError:
        raise
    except Exception as error:  # damaged metadata raises many types
        raise damaged(path, error) from error
    return _entries(array, axes, path)


def _entries(array, axes: _Axes, path: Path) -> list[VolumeEntry]:
    sizes = dict(zip(axes.names, array.shape, strict=True))
    extra = {name: n for name, n in sizes.items() if name not in "tzyx" and n > 1}
    if extra or not {"z", "y", "x"} <= sizes.keys():
        raise no_axes(path, " x ".join(f"{n} ({name})" for name, n in sizes.items()), _ONE_SCAN)
    spatial = [axes.names.index(name) for name in "zyx"]
    stored = sorted(spatial)
    shape = tuple(int(array.shape[axis]) for axis in stored)
    chunk = tuple(int(array.chunks[axis]) for axis in stored)
    voxel_mm = _voxel(axes, spatial, path)
    n_times = sizes.get("t", 1)
    interval_s = _interval(axes)
    entries = []
    for k in range(n_times):
        place = tuple(k if name == "t" else None if name in "zyx" else 0 for name in axes.names)
        decode = _ZarrChunks(path, array.path, place, chunk)
        source = in_order(Chunks(shape, array.dtype, chunk, decode, ("zarr", str(path), array.path, k, _changed(path))),
                          [stored.index(axis) for axis in spatial])
        entries.append(volume_entry(path, source, [array.shape[axis] for axis in spatial], array.dtype, voxel_mm,
                                    part=f"[{k}]" if n_times > 1 else "",
                                    time_s=k * interval_s if n_times > 1 and interval_s else None))
    return entries


@dataclass(frozen=True)
class _ZarrChunks:
    """Reads one chunk.

    place : index along axes other than space, None along those; chunk : shape along the axes of space as stored
    """

    path: Path
    dataset: str
    place: tuple[int | None, ...]
    chunk: tuple[int, int, int]

    def __call__(self, number: tuple[int, int, int]) -> np.ndarray:
        parts = iter(slice(k * n, (k + 1) * n) for k, n in zip(number, self.chunk, strict=True))
        array = _open_array(self.path, self.dataset, _changed(self.path))
        return np.asarray(array[tuple(next(parts) if index is None else index for index in self.place)])


@lru_cache(64)
def _open_array(path: Path, dataset: str, changed_ns: int):
    import zarr

    opened = zarr.open(path, mode="r")
    return opened[dataset] if dataset else opened


def _changed(path: Path) -> int:
    return path.stat().st_mtime_ns


def _chosen(root, dataset: str, path: Path):
    """The array of the volume and its axes."""
    import zarr

    if dataset:
        if dataset.strip("/") not in root:
            raise _no_array(path, f"no {dataset!r}", root)
        root = root[dataset.strip("/")]
    if isinstance(root, zarr.Array):
        return root, _axes_of_array(root)
    scales = root.attrs.get("multiscales") or (root.attrs.get("ome") or {}).get("multiscales")
    if scales:
        return _finest(root, scales[0])
    arrays = [array for _, array in root.arrays() if array.ndim in (3, 4)]
    if len(arrays) != 1:
        raise _no_array(path, f"{len(arrays)} arrays with three or four axes", root)
    return arrays[0], _axes_of_array(arrays[0])


def _no_array(path: Path, finding: str, root) -> InputError:
    names = ", ".join(sorted(getattr(root, "keys", list)())[:6])
    return InputError("not one volume", file=path, key="volumes", expected="an array with axes z, y, x",
                      found=f"{finding}; the group holds {names or 'nothing'}",
                      remedy=f'name the array, e.g. volumes = "{path.name}::NAME"')


def _axes_of_array(array) -> _Axes:
    """Axes by the names of dimensions (version 3, xarray); else z, y, x, with the time before them."""
    names = getattr(array.metadata, "dimension_names", None) or array.attrs.get("_ARRAY_DIMENSIONS")
    if names and all(isinstance(name, str) for name in names):
        return _Axes(tuple(name.lower() for name in names))
    return _Axes(tuple("tzyx"[4 - array.ndim:] if array.ndim in (3, 4) else "?" * array.ndim))


def _finest(root, multiscale: Mapping[str, Any]):
    """The first level of an OME-Zarr image and its axes."""
    level = multiscale["datasets"][0]
    array = root[level["path"]]
    listed = multiscale.get("axes")
    if not listed:
        return array, _axes_of_array(array)
    axes = [{"name": axis} if isinstance(axis, str) else axis for axis in listed]
    steps = [1.0] * array.ndim
    for transformation in [*level.get("coordinateTransformations", ()),
                           *multiscale.get("coordinateTransformations", ())]:
        if transformation.get("type") == "scale":
            steps = [step * float(scale) for step, scale in zip(steps, transformation["scale"], strict=True)]
    return array, _Axes(tuple(str(axis["name"]).lower() for axis in axes), tuple(steps),
                        tuple(str(axis.get("unit", "")) for axis in axes))


def _voxel(axes: _Axes, spatial: Sequence[int], path: Path) -> list[float] | None:
    if axes.steps is None:
        return None
    factors = [mm_per(axes.units[axis], path) for axis in spatial]
    return None if None in factors else [factor * axes.steps[axis]
                                         for factor, axis in zip(factors, spatial, strict=True)]


def _interval(axes: _Axes) -> float | None:
    if axes.steps is None or "t" not in axes.names:
        return None
    place = axes.names.index("t")
    unit = {"second": "s", "millisecond": "ms", "minute": "min", "hour": "h"}.get(axes.units[place], axes.units[place])
    factor = factor_to("s", unit) if unit else None
    return factor and factor * axes.steps[place]


def _check_codecs(array, path: Path) -> None:
    """InputError for a codec that is not known to be one of numbers."""
    unknown = sorted({name.removeprefix("numcodecs.") for name in _codecs(array.metadata.to_dict())} - _CODECS)
    if unknown:
        raise InputError("the array has a codec that idic does not run", file=path, key="volumes",
                         expected="a compression of numbers, such as blosc, zstd or gzip", found=", ".join(unknown),
                         remedy="write the array again with one of these")
    if math.prod(array.chunks) * array.dtype.itemsize > 2**31:
        raise InputError("the chunks of the array are too large", file=path, key="volumes",
                         expected="chunks of up to 2 GiB", found=f"{array.chunks} voxels",
                         remedy="write the array again with chunks of about 128 x 128 x 128 voxels")


def _codecs(metadata: Any) -> list[str]:
    """Names of all codecs, those inside others included."""
    if isinstance(metadata, Mapping):
        names = [str(metadata[key]) for key in ("id", "name") if key in metadata and
                 ("configuration" in metadata or key == "id")]
        parts = [value for key, value in metadata.items()
                 if key in ("codecs", "index_codecs", "compressor", "filters", "configuration", "compressors")]
        return names + [name for part in parts for name in _codecs(part)]
    if isinstance(metadata, list | tuple):
        return [name for part in metadata for name in ([part["name"]] if isinstance(part, Mapping) and "name" in part
                                                       else []) + _codecs(part)]
    return []
