"""The files of a virtual test: numbered images, the log, the truth."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np
import tifffile

from idic.errors import InputError

IMAGES = "images"
LOADS = "loads.csv"
SCANS = "scans"


def empty_folder(out: Path | str, place: str = IMAGES) -> Path:
    """Make the folder of a new experiment, and in it that of the images.

    Raises
    ------
    InputError
        The folder is not empty: virtual images never overwrite measured ones.
    """
    folder = Path(out)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(
            f"{folder} is not empty",
            key="--out",
            expected="a new or empty folder",
            found=f"{folder} with files in it" if folder.is_dir() else "a file",
            remedy="choose another folder or remove it",
        )
    (folder / place).mkdir(parents=True, exist_ok=True)
    return folder


def write_images(folder: Path, images: Iterable[np.ndarray], place: str = IMAGES) -> list[str]:
    """Write images one by one as ``images/frame_000.tif`` (or into the folder `place`); returns the file names."""
    names = []
    for k, image in enumerate(images):
        names.append(f"frame_{k:03d}.tif")
        tifffile.imwrite(folder / place / names[-1], image)
    return names


def write_scan(path: Path, planes: Iterator[np.ndarray], shape: tuple[int, int, int], dtype: np.dtype,
               voxel_mm: np.ndarray) -> None:
    """Write the scan of a volume as an ImageJ stack, plane by plane.

    shape : (nz, ny, nx); dtype : uint8 or uint16; voxel_mm : (3,) along x, y, z
    """
    dx, dy, dz = (float(side) for side in voxel_mm)
    tifffile.imwrite(path, planes, shape=shape, dtype=dtype, imagej=True, resolution=(1.0 / dx, 1.0 / dy),
                     metadata={"axes": "ZYX", "spacing": dz, "unit": "mm"})


def write_loads(folder: Path, times: np.ndarray, columns: Mapping[str, np.ndarray],
                units: Mapping[str, str] | None = None) -> None:
    """Write ``loads.csv``: frame, time_s and one column per channel, one row per image.

    units : of columns whose names do not end in one; they go into a row of units
    """
    with (folder / LOADS).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["frame", "time_s", *columns])
        if units:
            writer.writerow(["", "s", *(units.get(name, "") for name in columns)])
        for k, time in enumerate(times):
            writer.writerow([k, f"{time:.15g}", *(f"{values[k]:.8g}" for values in columns.values())])


def write_truth(folder: Path, parameters: Mapping[str, float], noise_std_gv: float, **more) -> None:
    """Write ``truth.json`` (`idic example`)."""
    truth = {"parameters": dict(parameters), "noise_std_gv": noise_std_gv} | more
    (folder / "truth.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
