"""The scans of a test by their pattern: every file or folder that matches is a scan, in the order of the names."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path, PurePosixPath

from idic.errors import InputError
from idic.path_names import path_inside
from idic.readers.paths import natural_key, recorded_order
from idic.readers.volumes.entry import VolumeEntry
from idic.readers.volumes.meta_image import meta_image_entries
from idic.readers.volumes.npy import npy_entries
from idic.readers.volumes.nrrd_volume import nrrd_entries
from idic.readers.volumes.slices import is_slices, slice_entries
from idic.readers.volumes.tiff_volume import tiff_entries
from idic.readers.volumes.vgi import vgi_entries
from idic.readers.volumes.zarr_volume import is_zarr, zarr_entries
from idic.remote_files import fetch


def _hdf5_entries(path: Path, name: str) -> list[VolumeEntry]:
    from idic.readers.volumes.hdf5_volume import hdf5_entries  # h5py is loaded where such a file is read

    return hdf5_entries(path, name)


_READERS: dict[str, Callable[[Path], list[VolumeEntry]]] = {
    ".tif": tiff_entries, ".tiff": tiff_entries, ".vgi": vgi_entries, ".mhd": meta_image_entries,
    ".mha": meta_image_entries, ".nrrd": nrrd_entries, ".nhdr": nrrd_entries, ".npy": npy_entries}
_WITH_PARTS = dict.fromkeys((".h5", ".hdf5", ".hdf", ".nxs"), _hdf5_entries)
_HEADERS = {".vol": (".vgi",), ".raw": (".mhd", ".nhdr")}  # of files that hold voxels only
_EXPECTED = ("TIFF stacks, folders of slices, .vgi, .mhd, .mha, .nrrd, .nhdr, .npy, Zarr folders, or HDF5 files with "
             "::dataset")
SAME_VOXEL = 1e-4  # relative: a tenth of a voxel over a thousand


def volume_entries(folder: Path, pattern: str | Sequence[str], *, file: Path | None = None, key: str = "volumes"
                   ) -> tuple[VolumeEntry, ...]:
    """The scans that match one or several patterns, by their headers: no voxel is read.

    Parameters
    ----------
    folder : path
        The experiment folder, to which the patterns are relative.
    pattern : str or sequence of str
        ``scans/*.tif``, ``scans/*`` (folders of slices), ``scan.h5::entry/data`` (a dataset), ``scans/*.zarr``.
    file, key
        Where the pattern stands, for messages.

    Returns
    -------
    tuple of VolumeEntry
        All of one size and depth; files of one pattern in the natural order of their names.

    Raises
    ------
    InputError
        Nothing matches, a file is no volume that idic reads, or the scans differ in size, depth or voxel size.
    """
    entries = []
    for text in [pattern] if isinstance(pattern, str) else pattern:
        names, sign, dataset = text.partition("::")
        for path in _matches(folder, names, file=file, key=key):
            entries += _entries_of(path, dataset if sign else "", bool(sign))
    if not entries:
        raise InputError("no scan is given", file=file, key=key, expected=_EXPECTED, found="an empty list",
                         remedy='give a pattern, e.g. volumes = "scans/*.tif"')
    _check_alike(entries, key)
    return tuple(entries)


def _matches(folder: Path, pattern: str, *, file, key) -> list[Path]:
    """Files and folders that match, in recorded order."""
    path_inside(folder, pattern, file=file, key=key)
    parts = PurePosixPath(pattern.replace("\\", "/")).parts
    start = folder
    while parts and os.path.exists(start / parts[0]):  # names as they stand, brackets included
        start, parts = start / parts[0], parts[1:]
    try:
        paths = list(start.glob("/".join(parts))) if parts else [start]
    except (ValueError, NotImplementedError) as problem:
        raise InputError("not a usable pattern", file=file, key=key, expected='a pattern such as "scans/*.tif"',
                         found=f"{pattern!r}: {problem}", remedy="correct the pattern") from None
    scans = [path for path in paths if not path.name.startswith(".") and _is_scan(path)]
    scans = [path for path in scans if path.suffix.lower() not in _HEADERS or _header(path) not in scans]
    if not scans:
        names = sorted((path.name for path in start.iterdir()), key=natural_key)[:5] if start.is_dir() else []
        raise InputError("no scans match the pattern", file=file, key=key,
                         expected=f"files or folders that match {pattern!r} in {folder}: {_EXPECTED}",
                         found=f"{start.name}/ holds {', '.join(names)}" if names else "none",
                         remedy='correct the pattern, e.g. volumes = "scans/*.tif"')
    return recorded_order(scans, folder)


def _is_scan(path: Path) -> bool:
    """Whether a match of a pattern is meant as a scan: a file, or a folder of Zarr or slices."""
    return path.is_file() or (path.is_dir() and (is_zarr(path) or is_slices(path)))


def _header(path: Path) -> Path | None:
    """The header beside a file of voxels."""
    return next((path.with_suffix(suffix) for suffix in _HEADERS[path.suffix.lower()]
                 if path.with_suffix(suffix).is_file()), None)


def _entries_of(path: Path, dataset: str, has_dataset: bool) -> list[VolumeEntry]:
    suffix = path.suffix.lower()
    if path.is_dir():
        if is_zarr(path):
            return zarr_entries(path, dataset)
        return slice_entries(path)
    fetch(path)
    if suffix in _WITH_PARTS:
        return _WITH_PARTS[suffix](path, dataset)
    if suffix in _HEADERS:
        header = _header(path)
        if header is None:
            raise InputError("the volume has no header", file=path, key="volumes",
                             expected=" or ".join(path.with_suffix(name).name for name in _HEADERS[suffix]),
                             found="no such file beside it",
                             remedy="put the header beside it; or write one, such as an .mhd of MetaImage with "
                                    "DimSize, ElementSpacing, ElementType and ElementDataFile")
        path, suffix = header, header.suffix.lower()
    if has_dataset or suffix not in _READERS:
        raise InputError("no dataset in a file of this format" if suffix in _READERS
                         else "not a format of volumes that idic reads", file=path, key="volumes", expected=_EXPECTED,
                         found=f"::{dataset} behind {path.name}" if suffix in _READERS else suffix or "no suffix",
                         remedy="correct the pattern, or save the scans as TIFF stacks")
    return _READERS[suffix](path)


def _check_alike(entries: Sequence[VolumeEntry], key: str) -> None:
    """InputError where scans differ in size, depth or voxel size."""
    first = entries[0]
    for entry in entries[1:]:
        if entry.shape != first.shape:
            raise InputError("the volumes differ in size", file=entry.path, key=key,
                             expected=f"{_size(first)} voxels (z, y, x), as {first.name}", found=_size(entry),
                             remedy="crop all volumes alike, or leave this file out of the pattern")
        if entry.dtype != first.dtype:
            raise InputError("the volumes differ in depth", file=entry.path, key=key,
                             expected=f"{first.dtype}, as {first.name}", found=str(entry.dtype),
                             remedy="save all volumes with one depth and one window of grey values")
        sides, reference = entry.voxel_mm, first.voxel_mm
        if (sides is None) != (reference is None) or (sides is not None and any(
                abs(a - b) > SAME_VOXEL * b for a, b in zip(sides, reference, strict=True))):
            raise InputError("the volumes differ in the size of a voxel", file=entry.path, key=key,
                             expected=f"{_voxel(first)} (z, y, x), as {first.name}", found=_voxel(entry),
                             remedy="reconstruct all scans with one voxel size; or correct the header")


def _size(entry: VolumeEntry) -> str:
    return " x ".join(map(str, entry.shape))


def _voxel(entry: VolumeEntry) -> str:
    return "no size" if entry.voxel_mm is None else " x ".join(f"{side:g}" for side in entry.voxel_mm) + " mm"
