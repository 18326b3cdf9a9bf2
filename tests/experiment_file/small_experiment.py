"""A small, complete experiment folder for the tests: 4 images, a log, a mesh of 4 x 3 quadrilaterals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tifffile

from idic.experiment_file import load_experiment as load_with_its_defaults

TOML = """
[experiment]
title = "small"
images = "images/*.tif"
loads = "loads.csv"
mesh = "mesh.inp"
mesh_unit = "mm"
kind = "plane_stress"
thickness_mm = 2.0

[camera]
pixel_size_mm = 0.1
origin_px = [10.0, 40.0]
axes = ["+col", "-row"]
noise_std_gv = 2.0

[material.SPECIMEN]
law = "elastic"
E = { value = 70, unit = "GPa", identify = true, bounds = [10, 200], prior = { mean = 70, std = 5 } }
nu = 0.3

[[boundary]]
nodes = "BOTTOM"
ux = 0.0
uy = 0.0

[[boundary]]
nodes = "TOP"
ux = 0.0
uy = { column = "grip_um", noise_std = 0.2 }

[[channel]]
column = "force_kN"
simulated = { reaction = "TOP", component = "y" }
noise_std = 0.005
"""

LOADS = """frame,time_s,force_kN,grip_um
0,0.0,0.000,0.1
1,1.0,0.100,5.0
2,2.0,0.200,10.0
3,3.0,0.300,15.0
"""


def inp_text(element_type: str = "CPS4") -> str:
    """4 x 3 quadrilaterals of 1 mm; node labels from 101, element labels from 1001; sets BOTTOM, TOP, surface RIGHT."""
    lines = ["** a comment", "*NODE"]
    lines += [f"{101 + 5 * j + i}, {float(i)}, {float(j)}, 0.0" for j in range(4) for i in range(5)]
    lines.append(f"*ELEMENT, TYPE={element_type}, ELSET=SPECIMEN")
    for j in range(3):
        for i in range(4):
            a = 101 + 5 * j + i
            lines.append(f"{1001 + 4 * j + i}, {a}, {a + 1}, {a + 6}, {a + 5}")
    lines += ["*NSET, NSET=BOTTOM, GENERATE", "101, 105, 1", "*NSET, NSET=TOP", "116, 117, 118,", "119, 120",
              "*ELSET, ELSET=LAST", "1004, 1008, 1012", "*SURFACE, NAME=RIGHT, TYPE=ELEMENT", "LAST, S2"]
    return "\n".join(lines) + "\n"


def write_experiment(folder: Path, toml: str = TOML) -> Path:
    """The folder with everything in it."""
    (folder / "images").mkdir(parents=True)
    generator = np.random.default_rng(1)
    for k in range(4):
        tifffile.imwrite(folder / "images" / f"frame_{k:03d}.tif", generator.integers(0, 256, (50, 60), dtype=np.uint8))
    (folder / "loads.csv").write_text(LOADS)
    (folder / "mesh.inp").write_text(inp_text())
    (folder / "experiment.toml").write_text(toml)
    return folder


def change(folder: Path, name: str, old: str, new: str) -> None:
    """Replace text in a file of the folder; the text must be there."""
    path = folder / name
    text = path.read_text()
    assert old in text, f"{old!r} is not in {name}"
    path.write_text(text.replace(old, new, 1))


def load_experiment(path, overrides=None):
    """Elements as the mesh file has them: tests count its nodes."""
    return load_with_its_defaults(path, {"options.element_order": "as_given"} | (overrides or {}))


def load(folder: Path, old: str = "", new: str = "", overrides=None):
    """The experiment of the folder after a change of its file."""
    if old:
        change(folder, "experiment.toml", old, new)
    return load_experiment(folder, overrides)
