"""A thick flat bar that necks before one camera with an ordinary lens at 300 mm; the truth by CalculiX.

Half of the thickness is modelled. The front recedes as the bar gets thinner: by 0.2 mm where it is even, by 0.5 mm in
the neck.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "fe"))
from calculix_solids import pulled, with_surfaces  # noqa: E402
from fe_bodies import grid  # noqa: E402

from idic.fe import Mesh  # noqa: E402
from idic.images import PinholeCamera, PlacedCamera, rotation_of  # noqa: E402
from idic.virtual_tests import (  # noqa: E402
    Rig, Sensor, traced_images, write_images, write_inp, write_loads,
)

LENGTH, WIDTH, HALF, WAIST = 36.0, 10.0, 3.0, 0.03  # mm; half of the thickness; narrower in the middle by this share
VALUES = {"E": 70e3, "nu": 0.3, "yield_stress": 250.0, "hardening_modulus": 350.0}  # MPa: necks at a strain of 0.25
GRIP = np.concatenate([np.linspace(0.0, 0.12, 4), np.linspace(0.12, 9.5, 9)[1:]])  # mm
PIXEL, SHAPE, DISTANCE, NOISE, FORCE_NOISE, GRIP_NOISE = 0.1, (130, 520), 300.0, 2.0, 10.0, 0.001
TRUE, USER = (18, 4, 2), (12, 3, 1)  # elements along, across, through half of the thickness
LENS = PinholeCamera(DISTANCE / PIXEL, DISTANCE / PIXEL, 205.0, 64.2, k1=-0.05, rotation=rotation_of([0.4, -0.6, 0.2]) @
                     Rig.FROM_ABOVE, translation_mm=[0.2, -0.1, DISTANCE])

TOML = """
[experiment]
images = "images/*.tif"
loads = "loads.csv"
mesh = "mesh.inp"
kind = "solid"
surface = "FRONT"

[camera]
{camera}
noise_std_gv = {noise}

[material.BODY]
law = "j2_linear"
E = {{ value = 65e3, unit = "MPa", identify = true }}
nu = 0.3
yield_stress = {{ value = 230, unit = "MPa", identify = true }}
hardening_modulus = {{ value = 420, unit = "MPa", identify = true }}

[[boundary]]
nodes = "LEFT"
ux = 0.0
uy = 0.0
[[boundary]]
nodes = "RIGHT"
ux = {{ column = "grip_mm", noise_std = 0.001 }}
uy = 0.0
[[boundary]]
nodes = "MIDDLE"
uz = 0.0

[[channel]]
column = "force_N"
simulated = {{ reaction = "RIGHT", component = "x" }}
noise_std = 10.0
"""
PINHOLE = f"""model = "pinhole"
calibration = "cal.json"
rotation = {json.dumps(LENS.rotation.tolist())}
translation_mm = {json.dumps(LENS.translation_mm.tolist())}"""


def telecentric() -> str:
    """The table of a camera that knows no distance: pixel size and origin of the reference image."""
    middle, right = LENS.project(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    slope = np.degrees(np.arctan2(right[1] - middle[1], right[0] - middle[0]))
    return (f"pixel_size_mm = {1.0 / np.linalg.norm(right - middle):.9g}\n"
            f"origin_px = [{middle[0]:.6f}, {middle[1]:.6f}]\nrotation_deg = {slope:.6f}")


def bar(n: tuple[int, int, int]) -> Mesh:
    """The bar, its front at z = 0; finer towards the middle."""
    def shape(x: np.ndarray) -> np.ndarray:
        s = 2.0 * x[:, 0] - 1.0
        along = 0.5 * LENGTH * (0.55 * s + 0.45 * s**3)
        return np.column_stack([along, WIDTH * (x[:, 1] - 0.5) * (1.0 - WAIST * np.cos(0.5 * np.pi * s) ** 2),
                                HALF * (x[:, 2] - 1.0)])

    mesh = grid("hex20", n, mapping=shape)
    x, _, z = mesh.nodes.T
    return with_surfaces(mesh, np.flatnonzero(np.abs(z) < 1e-9),
                         LEFT=np.flatnonzero(np.abs(x + 0.5 * LENGTH) < 1e-9),
                         RIGHT=np.flatnonzero(np.abs(x - 0.5 * LENGTH) < 1e-9),
                         MIDDLE=np.flatnonzero(np.abs(z + HALF) < 1e-9))


def truth(folder: Path) -> tuple[Mesh, np.ndarray, np.ndarray]:
    """Mesh, motion (n_frames, n_nodes, 3) mm and force (n_frames,) N by CalculiX."""
    mesh = bar(TRUE)
    return mesh, *pulled(folder, mesh, VALUES, GRIP, ("LEFT, 1, 2", "RIGHT, 2, 2", "MIDDLE, 3, 3"), 10)


def write_bar(folder: Path, known: tuple[Mesh, np.ndarray, np.ndarray], camera: str = PINHOLE, seed: int = 0) -> Path:
    """The experiment folder of a user with a mesh of his own; camera : the lines of its table."""
    mesh, u, force = known
    (folder / "images").mkdir(parents=True)
    rng, placed = np.random.default_rng(seed), PlacedCamera(LENS)
    sensor = Sensor(SHAPE, noise_std=NOISE, background=25.0)
    write_images(folder, traced_images(mesh, "FRONT", placed, u, sensor, rng))
    Rig((LENS,), SHAPE).write_calibration(folder / "cal.json")
    write_loads(folder, np.arange(float(len(u))), {"force_N": force + FORCE_NOISE * rng.standard_normal(len(u)),
                                                   "grip_mm": GRIP + GRIP_NOISE * rng.standard_normal(len(u))})
    write_inp(bar(USER), folder / "mesh.inp", "bar")
    (folder / "experiment.toml").write_text(TOML.format(camera=camera, noise=f"{sensor.total_noise_std:.4f}"))
    return folder / "experiment.toml"
