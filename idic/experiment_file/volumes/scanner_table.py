"""[scanner] as scanner, scale and noise of an experiment on volumes; the mesh must lie in the volume."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.experiment_file.schema.cameras import ScannerTable
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.experiment_file.tables.lengths import Lengths
from idic.experiment_file.volumes.scans import ScanFiles, size_in_words
from idic.fe import Mesh
from idic.images import Scanner, VolumeStack
from idic.readers import factor_between

MAX_SIZE_RATIO = 1.02  # of the stated voxel to that of the files
UNIT_RATIO = 300.0  # of mesh to volume, or the other way: a unit is wrong
AXES = ("+col", "+row", "+slice")
MIN_SEEN_SHARE = 0.5  # of the nodes within the volume


def scanner_scale(config: ExperimentFile, stack: VolumeStack, file: Path) -> Lengths:
    """Scale and scanner of volumes; everything is in mm.

    Raises
    ------
    InputError
        The size of a voxel is missing, contradicts the files, or the mesh has no unit of length.
    """
    table, notes = config.scanner or ScannerTable(), []
    of_files = stack.voxel_mm if isinstance(stack, ScanFiles) else None
    voxel = table.sides
    if voxel is None and of_files is None:
        raise InputError("the size of a voxel is not known", file=file, key="scanner.voxel_mm",
                         expected="its side in mm; three of different sides, along column, row and slice",
                         found="no such key, and files without it",
                         remedy="write e.g. voxel_mm = 0.012 under [scanner]")
    if voxel is None:
        voxel = of_files
        notes.append("size of a voxel by the files: " + " x ".join(f"{side:.6g}" for side in voxel) + " mm")
    elif of_files is not None:
        ratio = np.array(voxel) / np.array(of_files)
        if np.maximum(ratio, 1.0 / ratio).max() > MAX_SIZE_RATIO:
            hint = " (µm taken as mm?)" if np.abs(np.log10(ratio) - np.rint(np.log10(ratio))).max() < 0.01 else ""
            raise InputError("the size of a voxel differs from that in the files", file=file, key="scanner.voxel_mm",
                             expected=" x ".join(f"{side:.6g}" for side in of_files) + " mm, as the files state",
                             found=" x ".join(f"{side:.6g}" for side in voxel) + f" mm{hint}",
                             remedy="correct it, or leave voxel_mm out")
    axes, origin = table.axes or AXES, table.origin_px
    if table.axes is None:
        notes.append("scanner.axes not given: mesh x along the columns, y along the rows, z along the slices")
    if origin is None:
        origin = [0.0, 0.0, 0.0]
        notes.append("scanner.origin_px not given: the mesh origin is the middle of the first voxel")
    mesh_unit = config.experiment.mesh_unit or "mm"
    if mesh_unit == "px":
        raise InputError("a mesh in px on volumes", file=file, key="experiment.mesh_unit",
                         expected="a unit of length", found='"px"',
                         remedy="multiply every length of the mesh by voxel_mm, and leave mesh_unit out")
    factor = factor_between(mesh_unit, "mm", file=file, key="experiment.mesh_unit")
    try:
        scanner = Scanner.from_table(voxel, origin, axes)
    except InputError as error:
        raise InputError(error.what, file=file, key=error.key, expected=error.expected, found=error.found,
                         remedy=error.remedy) from None
    return Lengths("mm", factor, scanner, tuple(notes), mesh_unit)


def check_in_volume(mesh: Mesh, scanner: Scanner, shape: tuple[int, int, int], file: Path) -> None:
    """InputError if the mesh lies outside the volume, or its unit is not that of the voxels.

    Most of the mesh must be seen: where it is not, axes are swapped or the origin is wrong.
    """
    px = scanner.project(mesh.nodes)
    low, high, farthest = px.min(axis=0), px.max(axis=0), np.array(shape)[::-1] - 1.0
    ratio = float(np.max((high - low) / farthest))
    span = ", ".join(f"{name} {a:.0f} to {b:.0f}" for name, a, b in zip(("column", "row", "slice"), low, high,
                                                                        strict=True))
    inside = ((px >= -0.5) & (px <= farthest + 0.5)).all(axis=1)
    expected = f"most nodes within {size_in_words(shape)}"
    share = f"{100.0 * inside.mean():.0f} % of them; the mesh spans {span}"
    if ratio > UNIT_RATIO or ratio < 1.0 / UNIT_RATIO:
        raise InputError("mesh and voxels have different units", file=file, key="scanner.voxel_mm", expected=expected,
                         found=share, remedy=f"the mesh is {ratio:.3g} times as large as the volume: give voxel_mm in "
                         "mm (12 µm are 0.012) and mesh_unit as the mesh file has it")
    if inside.mean() > MIN_SEEN_SHARE:
        return
    order = [int(np.argmin(np.abs(np.ptp(px, axis=0)[k] - farthest))) for k in range(3)]
    swapped = sorted(order) == [0, 1, 2] and order != [0, 1, 2]
    remedy = ("the sides of the mesh fit the volume in another order: check scanner.axes" if swapped
              else "check origin_px, axes, voxel_mm and mesh_unit; `idic check` draws the mesh in the volume")
    raise InputError("the mesh lies outside the volume", file=file, key="scanner", expected=expected, found=share,
                     remedy=remedy)
