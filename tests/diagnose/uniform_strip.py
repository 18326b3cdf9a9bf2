"""A uniform strip whose fibres stiffen: in tension nothing separates its law from a load cell that bends.

Motion and force are written down: strain and contraction are uniform, the stress is E e (1 + a (e / e_max)^1.5). No law
and no load cell of the library has this exponent.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from idic.images import Camera, dense_speckle
from idic.virtual_tests import Sensor, clean_image, painted, record, write_inp, write_loads
from idic.fe import make_mesh
from idic_studies.trial.scenes.recording import IMAGES

LENGTH, WIDTH, THICKNESS, PIXEL = 10.0, 5.0, 1.0, 0.08  # mm
SHAPE, ORIGIN = (76, 140), (69.6, 37.4)  # px
E, NU, STIFFENING, EXPONENT = 5000.0, 0.3, 0.058, 1.0  # MPa
STRAIN = 0.01 * np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0])
NOISE, FORCE_SHARE = 1.0, 1e-4  # grey values, of the largest force
TOML = f"""
[experiment]
images = "images/*.tif"
loads = "loads.csv"
mesh = "mesh.inp"
kind = "plane_stress"
thickness_mm = {THICKNESS}

[camera]
pixel_size_mm = {PIXEL}
origin_px = [{ORIGIN[0]}, {ORIGIN[1]}]
noise_std_gv = {np.hypot(NOISE, 12**-0.5):.4f}

[material.BODY]
law = "elastic"
E = {{ value = 4500, unit = "MPa", identify = true }}
nu = {{ value = 0.33, identify = true }}

[[boundary]]
nodes = "LEFT"
ux = 0.0

[[boundary]]
nodes = "CORNER"
uy = 0.0

[[boundary]]
nodes = "RIGHT"
ux = {{ column = "grip_mm", noise_std = 2e-4 }}

[[channel]]
column = "force_N"
simulated = {{ reaction = "RIGHT", component = "x" }}
noise_std = %s
"""


def strip():
    """Eight by four squares; CORNER : the middle of the left end."""
    x, y = np.meshgrid(np.linspace(-LENGTH / 2, LENGTH / 2, 9), np.linspace(-WIDTH / 2, WIDTH / 2, 5), indexing="ij")
    nodes = np.column_stack([x.ravel(), y.ravel()])
    first = (5 * np.arange(8)[:, None] + np.arange(4)).ravel()
    cells = np.column_stack([first, first + 5, first + 6, first + 1])
    ends = {"LEFT": np.flatnonzero(nodes[:, 0] < -LENGTH / 2 + 1e-9),
            "RIGHT": np.flatnonzero(nodes[:, 0] > LENGTH / 2 - 1e-9), "CORNER": np.array([2])}
    return make_mesh(nodes, [("quad4", cells)], node_sets=ends, element_sets={"BODY": np.arange(len(cells))})


def write_strip(folder: Path, seed: int = 0) -> Path:
    """The folder of a user who believes in Hooke's law."""
    mesh, rng = strip(), np.random.default_rng(seed)
    camera = Camera.from_table(PIXEL, ORIGIN)
    texture = painted(dense_speckle(np.random.default_rng(seed + 7), 1.6, 30.0, 225.0, extent_px=400.0), camera)
    clean, sensor = Sensor(SHAPE, background=30.0), Sensor(SHAPE, noise_std=NOISE, background=30.0)
    stretched = np.stack([mesh.nodes[:, 0] + LENGTH / 2, -NU * mesh.nodes[:, 1]], axis=1)
    images = np.array([record(clean_image(e * stretched, mesh.nodes, mesh.blocks, camera, texture, clean), sensor, rng)
                       for e in STRAIN])
    force = E * WIDTH * THICKNESS * STRAIN * (1.0 + STIFFENING * (STRAIN / STRAIN.max()) ** EXPONENT)
    std = FORCE_SHARE * force.max()
    np.save(folder / IMAGES, images)
    write_loads(folder, np.arange(float(len(STRAIN))), {
        "force_N": force + std * rng.standard_normal(len(force)),
        "grip_mm": LENGTH * STRAIN + 2e-4 * rng.standard_normal(len(force)) * (STRAIN > 0.0)})
    write_inp(mesh, folder / "mesh.inp", "strip")
    (folder / "experiment.toml").write_text(TOML % f"{std:.6g}", encoding="utf-8")
    return folder
