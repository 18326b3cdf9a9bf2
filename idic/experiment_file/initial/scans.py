"""Scans among the files of a folder, and where the specimen lies in the first of them."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path

import numpy as np
import scipy

from idic.errors import InputError
from idic.experiment_file.initial.found import IMAGE_SUFFIXES
from idic.experiment_file.volumes.scans import ScanFiles, open_scans
from idic.readers import patterns_of

MIN_SLICES = 8  # of a TIFF or a folder of images that is taken for a scan: films of a test are one file
MIN_FOLDERS = 3  # of slices: two folders of images are two cameras
SUFFIXES = {".vgi", ".mhd", ".mha", ".nrrd", ".nhdr", ".npy", ".tif", ".tiff"}  # HDF5 needs the name of a dataset
_MASK = re.compile(r"mask|(?<![a-z])roi(?![a-z])", re.IGNORECASE)
BINS = 96  # along the longest side, of the scan that is looked at
MIN_SEPARATION = 0.75  # of the variance that two classes explain: of one Gaussian class it is 2 / pi = 0.64
MIN_AREA_SHARE = 0.2  # of the largest section: of a block the edge is at half of it, a cylinder loses 2 % of its width
MAX_SIDE_RATIO = 1.1  # between mesh and specimen along the three axes
CLEAR_SIDE_RATIO = 1.03  # by which another order of the axes has to fit better than the given one


def find_scans(folder: Path, files: Sequence[Path]) -> ScanFiles | None:
    """The largest group of files or folders that are scans of one test; None where there is none."""
    groups: dict[tuple, list[Path]] = defaultdict(list)
    for path in files:
        if path.suffix.lower() in SUFFIXES and not _MASK.search(path.stem):
            groups[path.parent, path.suffix].append(path)
    for path in sorted(path for depth in ("*", "*/*") for path in folder.glob(depth) if path.is_dir()):
        if path.suffix == ".zarr":
            groups[path.parent, ".zarr"].append(path)
        elif _n_images(path) >= MIN_SLICES:
            groups[path.parent, "slices", re.sub(r"\d+", "#", path.name)].append(path)
    groups = {key: paths for key, paths in groups.items() if len(paths) >= (MIN_FOLDERS if len(key) == 3 else 2)}
    for _, paths in sorted(groups.items(), key=lambda item: -len(item[1])):
        scans = _opened(folder, paths)
        if scans is not None:
            return scans
    return None


def mask_among(folder: Path, files: Sequence[Path], scans: ScanFiles) -> str | None:
    """The first volume of the size of the scans whose name says that it is a mask."""
    for path in files:
        if path.suffix.lower() in SUFFIXES and _MASK.search(path.stem):
            name = path.relative_to(folder).as_posix()
            try:
                if open_scans(folder, [name], file=folder, key="mask").shape == scans.shape:
                    return name
            except InputError:
                continue
    return None


def _n_images(folder: Path) -> int:
    return sum(path.suffix.lower() in IMAGE_SUFFIXES for path in folder.iterdir())


def _opened(folder: Path, paths: Sequence[Path]) -> ScanFiles | None:
    try:
        scans = open_scans(folder, [path.relative_to(folder).as_posix() for path in paths], file=folder, key="volumes")
    except InputError:
        return None
    return scans if scans.shape[0] >= MIN_SLICES and scans.n_frames == len(paths) else None


def pattern_of(folder: Path, scans: ScanFiles) -> str | list[str]:
    """What `volumes` names these scans by."""
    paths = list(dict.fromkeys(entry.path for entry in scans.entries))
    if any(path.is_dir() for path in paths):
        place = paths[0].parent.relative_to(folder).as_posix()
        shared = re.sub(r"\d+", "*", paths[0].name)
        return shared if place == "." else f"{place}/{shared}"
    patterns = patterns_of(folder, paths)
    return patterns[0] if len(patterns) == 1 else patterns


@dataclass(frozen=True)
class PlaceInScan:
    """How the mesh would lie on the specimen.

    order : axis of the volume (0 column, 1 row, 2 slice) along mesh x, y, z; side_mm : of a voxel along column, row and
    slice; origin_px : column, row and slice of the mesh origin
    """

    order: tuple[int, int, int]
    side_mm: np.ndarray
    origin_px: np.ndarray


def specimen_box(scans: ScanFiles, frame: int = 0) -> tuple[np.ndarray, np.ndarray] | None:
    """First and last (column, row, slice) of what is brighter than the air around; None where no air is seen."""
    step = max(1, -(-max(scans.shape) // BINS))
    nz, ny, nx = (n // step * step for n in scans.shape)
    slices = [np.mean(np.asarray(scans.block(frame, slice(z, z + step), slice(0, ny), slice(0, nx)), float)
                      .reshape(step, ny // step, step, nx // step, step), axis=(0, 2, 4)) for z in range(0, nz, step)]
    smooth = scipy.ndimage.gaussian_filter(np.array(slices), 2.0, mode="nearest")
    limit, separation = _two_classes(smooth)
    inside = smooth > limit
    if separation < MIN_SEPARATION:
        return None
    low, high = np.zeros(3), np.zeros(3)
    for axis in range(3):
        area = inside.sum(axis=tuple(k for k in range(3) if k != axis))
        filled = np.flatnonzero(area > MIN_AREA_SHARE * area.max())
        low[2 - axis], high[2 - axis] = step * filled[0] - 0.5, step * (filled[-1] + 1) - 0.5
    return low, high


def _two_classes(values: np.ndarray) -> tuple[float, float]:
    """The limit between two classes of values (Otsu 1979, doi:10.1109/TSMC.1979.4310076), and the share of the variance
    that they explain."""
    count, edges = np.histogram(values, 128)
    middle = 0.5 * (edges[1:] + edges[:-1])
    below, total = np.cumsum(count), count.sum()
    first = np.cumsum(count * middle)
    with np.errstate(divide="ignore", invalid="ignore"):
        between = np.nan_to_num((first[-1] * below / total - first) ** 2 / (below * (total - below)))
    best = int(np.argmax(between))
    return float(edges[best + 1]), float(between[best] / max(values.var(), 1e-300))


def place_in_scan(low_mm: np.ndarray, high_mm: np.ndarray, box: tuple[np.ndarray, np.ndarray],
                  side_mm: np.ndarray | None) -> PlaceInScan | None:
    """The place of a mesh whose sides are those of the specimen, its axes upwards along those of the volume.

    low_mm, high_mm : (3,) of the mesh; box : of `specimen_box`; side_mm : (3,) of a voxel, None: not known
    """
    size = np.asarray(high_mm) - low_mm
    sides = np.ones(3) if side_mm is None else np.asarray(side_mm, float)
    spread = {}
    for order in permutations(range(3)):
        ratio = size / ((box[1] - box[0]) * sides)[list(order)]
        worst = ratio.max() / ratio.min() if side_mm is None else np.exp(np.abs(np.log(ratio)).max())
        spread[order] = float(worst), float(np.exp(np.log(ratio).mean()))
    best = min(spread, key=lambda order: spread[order][0])
    straight = (0, 1, 2)
    order = straight if spread[straight][0] < CLEAR_SIDE_RATIO * spread[best][0] else best
    if spread[order][0] > MAX_SIDE_RATIO:
        return None
    sides = sides * (spread[order][1] if side_mm is None else 1.0)
    axes, origin = list(order), np.zeros(3)
    middle_px, middle_mm = 0.5 * (box[0] + box[1]), 0.5 * (np.asarray(low_mm) + high_mm)
    origin[axes] = middle_px[axes] - middle_mm / sides[axes]
    return PlaceInScan(order, sides, origin)
