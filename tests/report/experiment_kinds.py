"""An experiment folder of every kind: what was measured, by which camera, on which mesh, with which log."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import tifffile
from report.test_advice_lines import LENS, fields, measured_sides
from experiment_file.small_experiment import LOADS, TOML, write_experiment
from volumes.tomograms import Tomograms

CAMERA = TOML[TOML.index("[camera]"):TOML.index("[material")]
MATRIX = ("[camera]\nmatrix_px_per_unit = [[10.0, 0.0], [0.0, -10.0]]\norigin_px = [10.0, 40.0]\n"
          "noise_std_gv = 2.0\n\n")
POSED = "[camera]\n" + LENS.replace("125.0", "30.0").replace("60.0", "25.0").replace(
    "[-10.0, 0.0, 300.0]", "[-2.0, 1.5, 300.0]").replace("noise_std_gv = 1.5", "noise_std_gv = 2.0")
DRIVEN = '{ column = "grip_um", noise_std = 0.2 }'


def images(folder: Path) -> Path:
    return write_experiment(folder)


def in_px(folder: Path) -> Path:
    """A mesh drawn on the image."""
    drawn = TOML.replace('mesh = "mesh.inp"\nmesh_unit = "mm"\n',
                         "mesh = { roi_px = [10, 10, 50, 40], element_px = 10 }\n")
    return write_experiment(folder, drawn.replace("origin_px = [10.0, 40.0]\n", ""))


def in_mm(folder: Path) -> Path:
    """A mesh made in mm."""
    return write_experiment(folder, TOML.replace('mesh = "mesh.inp"\nmesh_unit = "mm"\n',
                                                 "mesh = { roi_mm = [0, 0, 4, 3], element_mm = 1 }\n"))


def with_interval(folder: Path) -> Path:
    """A log with times of its own."""
    write_experiment(folder, TOML.replace('loads = "loads.csv"', 'loads = "loads.csv"\nframe_interval_s = 1.0'))
    (folder / "loads.csv").write_text(LOADS.replace("frame,", "", 1).replace("\n0,", "\n").replace("\n1,", "\n")
                                      .replace("\n2,", "\n").replace("\n3,", "\n"))
    return folder


def without_log(folder: Path) -> Path:
    text = TOML[:TOML.index("[[channel]]")].replace('loads = "loads.csv"\n', "").replace(DRIVEN, "0.01")
    return write_experiment(folder, text)


def matrix(folder: Path) -> Path:
    return write_experiment(folder, TOML.replace(CAMERA, MATRIX))


def lens(folder: Path) -> Path:
    return write_experiment(folder, TOML.replace(CAMERA, POSED))


def two_cameras(folder: Path) -> Path:
    further = CAMERA.replace("[camera]", '[[camera]]\nname = "second"\nimages = "second/*.tif"')
    write_experiment(folder, TOML.replace(CAMERA, CAMERA.replace("[camera]", "[[camera]]") + further))
    shutil.copytree(folder / "images", folder / "second")
    return folder


def two_lenses(folder: Path) -> Path:
    further = POSED.replace("[camera]", "[[camera]]").replace('"camera"', '"right"\nimages = "right/*.tif"')
    write_experiment(folder, TOML.replace(CAMERA, POSED.replace("[camera]", "[[camera]]") + further))
    shutil.copytree(folder / "images", folder / "right")
    return folder


def heights(folder: Path) -> Path:
    write_experiment(folder, TOML.replace('kind =', 'quantity = "height"\nheight_unit = "um"\nkind ='))
    rng = np.random.default_rng(2)
    for k in range(4):
        tifffile.imwrite(folder / "images" / f"frame_{k:03d}.tif", rng.normal(0, 5, (50, 60)).astype(np.float32))
    return folder


def volumes(folder: Path) -> Path:
    return Tomograms().write(folder)


def points(folder: Path) -> Path:
    return fields(folder, "jump, shifted")


def points_with_measured_sides(folder: Path) -> Path:
    return measured_sides(folder, "jump, shifted")


KINDS = {kind.__name__: kind for kind in (
    images, in_px, in_mm, with_interval, without_log, matrix, lens, two_cameras, two_lenses, heights, volumes, points,
    points_with_measured_sides)}
