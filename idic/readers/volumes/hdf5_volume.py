"""Volumes in HDF5 files of beamlines: ``path.h5::dataset``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from idic.errors import InputError
from idic.readers.volumes.entry import VolumeEntry, damaged, no_axes, volume_entry
from idic.readers.volumes.voxels import Chunks, RawPlanes, VoxelSource
from idic.remote_files import fetch

_MAX_LINKS = 8  # in a row
_MAX_NAMES = 6  # in a message
_SIDES_UM = "element_size_um"  # attribute, z y x


def hdf5_entries(path: Path, dataset: str = "") -> list[VolumeEntry]:
    """The one scan of a dataset; without a name, of the only one with three axes.

    The attribute ``element_size_um`` (z, y, x) gives the size of a voxel where it is there.

    Raises
    ------
    InputError
        The file is damaged, the dataset is not there, not the only one, in another file, or with a filter that h5py
        does not have.
    """
    try:
        with h5py.File(path, "r") as file:
            name = dataset.strip("/") or _only(file, path)
            values = _dataset(file, name, path)
            if values.ndim != 3:
                raise no_axes(path, f"{name} has {values.ndim} axes {values.shape}",
                              "save one scan per dataset, with axes z, y, x")
            _check_storage(values, name, path)
            sides = values.attrs.get(_SIDES_UM)
            voxel_mm = None if sides is None else [1e-3 * float(side) for side in np.ravel(sides)]
            if voxel_mm is not None and len(voxel_mm) != 3:
                raise no_axes(path, f"{_SIDES_UM} with {len(voxel_mm)} values", "correct the attribute")
            return [volume_entry(path, _source(values, name, path), values.shape, values.dtype, voxel_mm,
                                 part=f"::{name}")]
    except InputError:
        raise
    except Exception as error:  # damaged files raise many types
        raise damaged(path, error) from error


def _source(values: h5py.Dataset, name: str, path: Path) -> VoxelSource:
    if values.chunks is None:
        offset = values.id.get_offset()
        if offset is not None:
            return RawPlanes(path, values.shape, values.dtype, (offset,))
    chunk = values.chunks or (1, *values.shape[1:])  # compact storage
    return Chunks(values.shape, values.dtype, chunk, _Hdf5Chunks(path, name, chunk),
                  ("hdf5", str(path), name, path.stat().st_mtime_ns))


@dataclass(frozen=True)
class _Hdf5Chunks:
    """Reads one chunk."""

    path: Path
    name: str
    chunk: tuple[int, int, int]

    def __call__(self, place: tuple[int, int, int]) -> np.ndarray:
        fetch(self.path)
        with h5py.File(self.path, "r") as file:
            values = file[self.name][tuple(slice(k * n, (k + 1) * n)
                                           for k, n in zip(place, self.chunk, strict=True))]
        return values.astype(values.dtype.newbyteorder("="), copy=False)


def _only(file: h5py.File, path: Path) -> str:
    """The name of the only dataset with three axes; external links are not followed."""
    names: list[str] = []

    def visit(name: str, item: h5py.HLObject) -> None:
        if isinstance(item, h5py.Dataset) and item.ndim == 3:
            names.append(name)

    file.visititems(visit)
    if len(names) != 1:
        listed = f": {', '.join(names[:_MAX_NAMES])}" if names else ""
        raise InputError("not one volume", file=path, key="volumes", expected="a dataset with axes z, y, x",
                         found=f"{len(names)} with three axes{listed}",
                         remedy=f'name it, e.g. volumes = "{path.name}::{names[0] if names else "entry/data/data"}"')
    return names[0]


def _dataset(file: h5py.File, name: str, path: Path) -> h5py.Dataset:
    """The dataset of a name whose links stay in the file."""
    item = file[_place(file, name, path, _MAX_LINKS)]
    if not isinstance(item, h5py.Dataset):
        raise _no_dataset(path, name, f"a group that holds {', '.join(sorted(item)[:_MAX_NAMES]) or 'nothing'}")
    return item


def _place(file: h5py.File, name: str, path: Path, n_links: int) -> str:
    """The path of an object without links in it."""
    place = ""
    parts = [part for part in name.split("/") if part not in ("", ".")]
    for k, part in enumerate(parts):
        group = file[place or "/"]
        if not isinstance(group, h5py.Group):
            raise _no_dataset(path, name, f"{place} holds values")
        links, key = group.id.links, part.encode()  # of a high-level group, `in` opens the file that a link names
        if not links.exists(key):
            raise _no_dataset(path, name, f"{place or '/'} holds {', '.join(sorted(group.keys())[:_MAX_NAMES])}")
        kind = links.get_info(key).type
        if kind == h5py.h5l.TYPE_EXTERNAL:
            raise _elsewhere(path, f"{name} is a link into {links.get_val(key)[0].decode(errors='replace')}")
        if kind == h5py.h5l.TYPE_SOFT:
            if n_links == 0:
                raise _no_dataset(path, name, "links that lead to each other")
            target = links.get_val(key).decode()
            start = "" if target.startswith("/") else f"{place}/"
            return _place(file, "/".join([start + target, *parts[k + 1:]]), path, n_links - 1)
        place = f"{place}/{part}"
    return place


def _check_storage(values: h5py.Dataset, name: str, path: Path) -> None:
    if values.external:
        raise _elsewhere(path, f"{name} lies in {values.external[0][0]}")
    if values.is_virtual:
        raise _elsewhere(path, f"{name} is put together from {values.virtual_sources()[0].file_name}")
    plist = values.id.get_create_plist()
    filters = [plist.get_filter(k) for k in range(plist.get_nfilters())]
    missing = [str(entry[3].decode(errors="replace") or entry[0]) for entry in filters
              if not h5py.h5z.filter_avail(entry[0])]
    if missing:
        raise InputError("the dataset has a filter that h5py does not have", file=path, key="volumes",
                         expected="no compression, gzip, lzf or szip", found=missing[0],
                         remedy="write the file anew without it: h5repack -f NONE IN OUT (with the HDF5 plugin of the "
                                "filter)")


def _elsewhere(path: Path, finding: str) -> InputError:
    return InputError("the dataset lies in another file", file=path, key="volumes", expected="a dataset of the file",
                      found=finding, remedy="give the file that holds it, or copy it into this one (h5repack, h5copy)")


def _no_dataset(path: Path, name: str, finding: str) -> InputError:
    return InputError("no such dataset", file=path, key="volumes", expected=name, found=finding,
                      remedy="correct the name behind ::")
