"""Planned tests on the small plate of the identification's twins: folders with all, one or none of the images."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "identify"))

from twin_bodies import PIXEL, plate  # noqa: E402
from twin_runs import ELASTIC, FORCE, GRIPS, NOISE, ORIGIN, SHAPE, THICKNESS, Twin, write_folder  # noqa: E402

from idic.virtual_tests import write_inp  # noqa: E402

TRUE = {"BODY.E": 2000.0, "BODY.nu": 0.35}
HEAD = f"""
[experiment]
{{images}}
mesh = "mesh.inp"
mesh_unit = "mm"
kind = "plane_stress"
thickness_mm = {THICKNESS}
[camera]
pixel_size_mm = {PIXEL}
origin_px = [{ORIGIN[0]}, {ORIGIN[1]}]
"""
PLAN = f"""
[design]
image_px = [{SHAPE[1]}, {SHAPE[0]}]
n_frames = 6
noise_std_gv = {NOISE}
"""
PROGRAM = """
[design.program]
grip_mm = [[0, 0], [4, 0.12], [5, 0.10]]
"""
PLASTIC = """
[material.BODY]
law = "j2_linear"
E = { value = 2000, unit = "MPa", identify = true }
nu = 0.35
yield_stress = { value = 15, unit = "MPa", identify = true }
hardening_modulus = { value = 200, unit = "MPa", identify = true }
"""


def plan_folder(folder, toml=ELASTIC + GRIPS + FORCE + PLAN + PROGRAM, images=""):
    """A folder without images and log; `toml` is everything after [camera]. Returns the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    write_inp(plate((6, 4)), folder / "mesh.inp", "plan")
    (folder / "experiment.toml").write_text(HEAD.format(images=images) + toml)
    return folder


def recorded_folder(folder, toml=ELASTIC + GRIPS + FORCE):
    """The same test made: images, loads and mesh of the twin."""
    return write_folder(folder, Twin(), toml).parent
