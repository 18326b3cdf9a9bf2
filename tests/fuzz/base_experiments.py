"""Small experiments that are well formed, and between them use most keys of experiment.toml."""

from __future__ import annotations

import tomllib
from functools import lru_cache
from pathlib import Path

import numpy as np
import tifffile

from experiment_file.small_experiment import TOML, write_experiment
from scratch import lasting_folder

GRIPS = (
    TOML.replace(
        'kind = "plane_stress"',
        """kind = "plane_stress"
reference = "frame_000.tif"
exclude_frames = [2]
mask = "mask.tif"
frame_interval_s = 1.0
first_frame_s = 0.0""",
    ).replace(
        'uy = { column = "grip_um", noise_std = 0.2 }',
        """
uy = { column = "grip_um", identify_offset = true, corrections = [ { kind = "slip", start_s = 1.0, course = "ramp" },
       { kind = "compliance", column = "force_kN" }, { kind = "misalignment", towards = "x" } ] }""",
    )
    + """
[sets]
EDGE = { where = "x > 3.9 and y > 0.5" }
RIM = { boundary = "outer" }
[[channel]]
column = "grip_um"
simulated = { displacement = "TOP", component = "y", minus = "BOTTOM" }
[[dof]]
name = "camera.rotation_deg"
value = 0.1
bounds = [-1.0, 1.0]
[[dof]]
name = "channel.force_kN.scale"
prior = { mean = 1.0, std = 0.01 }
[[stage]]
free = ["SPECIMEN.E"]
max_iterations = 3
[[stage]]
free = "all"
[options]
interpolation = "cubic"
lowpass_px = 0.5
edge_margin_px = 2
brightness = "patch"
patch_px = 30.0
weighting = "paper"
alpha = 0.02
max_iterations = 1
tolerance = 0.05
substeps = 1
perturbation = 1e-4
element_order = "as_given"
step_limit = 0.5
"""
)

CAMERAS = (
    TOML.replace(
        "[camera]",
        """[[camera]]
name = "left"
k1 = 1e-9
centre_px = [30.0, 25.0]""",
    ).replace(
        "noise_std_gv = 2.0",
        """noise_std_gv = 2.0
[[camera]]
name = "right"
images = ["right/*.tif"]
matrix_px_per_unit = [[10.0, 0.0], [0.0, -10.0]]
origin_px = [12.0, 41.0]
noise_std_gv = 2.5
plane = ["x", "y"]
""",
    )
    + """
[[heterogeneity]]
set = "SPECIMEN"
form = "inclusion"
centre_mm = [2.0, 1.5]
radius_mm = 0.8
stiffness = { value = 0.9, identify = true }
[options]
max_iterations = 1
"""
)

WARM = (
    TOML.replace("nu = 0.3", 'nu = 0.3\nalpha = { value = 2e-5, unit = "1/K", identify = true }')
    + """
[[boundary]]
temperature = { course = [[0.0, 20.0], [3.0, 40.0]] }
[[boundary]]
pressure = { value = 1.0, unit = "MPa", edges = "RIGHT", follower = true }
[options]
max_iterations = 1
"""
)

VIRTUAL = (
    TOML.split("[[boundary]]")[0].replace(
        'mesh = "mesh.inp"\nmesh_unit = "mm"',
        "mesh = { roi_px = [10, 10, 50, 40], element_px = 10, holes_px = [[30, 25, 6]] }",
    )
    + """
[sets]
LOW = { where = "y < 0.9" }
[[boundary]]
nodes = "RIGHT"
u = { virtual = "bspline", modes = 4, time_modes = 3 }
[[boundary]]
nodes = "LEFT"
u = { virtual = "polynomial", modes = 2, time_modes = 2 }
[options]
max_iterations = 1
"""
)

EXTERNAL = (
    TOML.replace('law = "elastic"', 'law = "external"').replace(", noise_std = 0.2", "")
    + """
[solver]
kind = "external"
template = "deck.inp.template"
files = ["loads.csv"]
mesh = "part.inp"
element_types = { quad8 = "CPS8" }
command = ["no-such-solver", "-i", "{job}"]
reader = "calculix_dat"
timeout_s = 5
retries = 0
environment = { OMP_NUM_THREADS = "1" }
"""
)
DECK = """*INCLUDE, INPUT=part.inp
*ELASTIC
{SPECIMEN.E}, {SPECIMEN.nu:.6e}
{TIME.points}
{TABLE.boundary.TOP.y}
"""

SOLID = (
    TOML.replace('"plane_stress"\nthickness_mm = 2.0', '"solid"\nsurface = "FRONT"')
    .replace('law = "elastic"', 'law = "j2_linear"')
    .replace(
        "nu = 0.3",
        'nu = { value = 0.3, identify = true, bounds = [0.0, 0.45] }\n'
        'yield_stress = { value = 200, unit = "MPa" }\nhardening_modulus = 1000',
    )
    .replace("uy = 0.0", "uy = 0.0\nuz = 0.0")
    + """
[[boundary]]
force = { value = 1.0, edges = "FRONT", component = "z" }
[options]
max_iterations = 1
"""
)

DRAWN = VIRTUAL.replace("mesh = { roi_px = [10, 10, 50, 40], element_px = 10, holes_px = [[30, 25, 6]] }",
                        "mesh = { outline_px = [[10, 10], [50, 10], [48, 25, 50, 40], [10, 40]], element_px = 10, "
                        "holes_px = [[30, 25, 6]], edge_names = { LEFT = [4], RIGHT = [2, 3] } }")

BASES = {"drawn": DRAWN, "grips": GRIPS, "cameras": CAMERAS, "warm": WARM, "virtual": VIRTUAL, "external": EXTERNAL,
         "solid": SOLID}


@lru_cache(maxsize=None)
def base_folder(name: str) -> Path:
    """The folder of a base experiment; copied, never changed."""
    folder = write_experiment(lasting_folder("base") / name, BASES[name])
    tifffile.imwrite(folder / "mask.tif", np.full((50, 60), 255, np.uint8))
    (folder / "right").mkdir()
    for k in range(4):
        pixels = np.random.default_rng(10 + k).integers(0, 256, (50, 60), dtype=np.uint8)
        tifffile.imwrite(folder / "right" / f"r_{k}.tif", pixels)
    (folder / "deck.inp.template").write_text(DECK)
    if name == "solid":
        (folder / "mesh.inp").write_text(brick_text())
    return folder


@lru_cache(maxsize=None)
def base_tables(name: str) -> dict:
    return tomllib.loads(BASES[name])


def brick_text() -> str:
    """4 x 3 x 1 hexahedra of 1 mm; face set FRONT (z = 1)."""
    label = lambda i, j, k: 1 + i + 5 * j + 20 * k  # noqa: E731
    lines = ["*NODE"] + [f"{label(i, j, k)}, {i}.0, {j}.0, {k}.0" for k in range(2) for j in range(4) for i in range(5)]
    lines.append("*ELEMENT, TYPE=C3D8, ELSET=SPECIMEN")
    for j in range(3):
        for i in range(4):
            corners = [label(i + a, j + b, k) for k in (0, 1) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
            lines.append(", ".join(map(str, (1 + i + 4 * j, *corners))))
    bottom, top = ([label(i, j, k) for k in range(2) for i in range(5)] for j in (0, 3))
    lines += [
        "*NSET, NSET=BOTTOM",
        ", ".join(map(str, bottom)),
        "*NSET, NSET=TOP",
        ", ".join(map(str, top)),
        "*SURFACE, NAME=FRONT, TYPE=ELEMENT",
        "SPECIMEN, S2",
    ]
    return "\n".join(lines) + "\n"
