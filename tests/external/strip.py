"""Experiment folders that are simulated from outside: a homogeneous strip with known truth."""

from __future__ import annotations

import shutil
import sys
from functools import lru_cache
from pathlib import Path

import numpy as np
from external.strange_solver import LENGTH, THICKNESS, WIDTH

from idic.fe import make_mesh, raise_order
from idic.images import Camera, dense_speckle
from idic.virtual_tests import Sensor, clean_image, painted, record, write_images, write_inp, write_loads

TRUTH = {"E": 2000.0, "nu": 0.35}
GRIP = np.array([0.0, 0.03, 0.06, 0.09, 0.12])
TIMES = np.array([10.0, 11.0, 12.0, 13.0, 14.0])  # s: the deck's clock starts at the reference
PIXEL, ORIGIN, SHAPE, NOISE, FORCE_NOISE = 0.06, (69.3, 44.6), (90, 140), 2.0, 0.5

TOML = """
[experiment]
images = "images/*.tif"
loads = "loads.csv"
mesh = "mesh.inp"
kind = "plane_stress"
thickness_mm = {thickness}
[camera]
pixel_size_mm = {pixel}
origin_px = [{column}, {row}]
axes = ["+col", "-row"]
noise_std_gv = {noise}
[material.BODY]
law = "external"
E = {{ value = 1.2, unit = "GPa", identify = true }}
nu = {{ value = 0.25, identify = true }}
[[boundary]]
nodes = "RIGHT"
ux = {{ column = "grip_mm"{grip} }}
[[channel]]
column = "force_N"
simulated = {{ reaction = "RIGHT", component = "x" }}
noise_std = 0.5
[solver]
kind = "external"
template = "strip.deck.template"
files = ["nodes.txt", "strange_solver.py"]
command = ["{python}", "-S", "strange_solver.py", "{{deck}}"]
reader = "csv"
{solver}
"""
DECK = """E {BODY.E}
nu {BODY.nu:.9e}
{TABLE.boundary.RIGHT.x}
"""


def strip_mesh(cells=(6, 4)):
    """quad8 cells, sets LEFT and RIGHT."""
    xs, ys = np.linspace(-LENGTH / 2, LENGTH / 2, cells[0] + 1), np.linspace(-WIDTH / 2, WIDTH / 2, cells[1] + 1)
    nodes = np.array([(x, y) for x in xs for y in ys])
    at = np.arange(len(nodes)).reshape(len(xs), len(ys))
    conn = [[at[i, j], at[i + 1, j], at[i + 1, j + 1], at[i, j + 1]] for i in range(cells[0]) for j in range(cells[1])]
    sets = {"LEFT": at[0], "RIGHT": at[-1]}
    return raise_order(make_mesh(nodes, [("quad4", np.array(conn))], node_sets=sets,
                                 element_sets={"BODY": np.arange(len(conn))}))


@lru_cache(maxsize=1)
def _clean_images():
    mesh, camera, sensor = strip_mesh(), Camera.from_table(PIXEL, ORIGIN), Sensor(SHAPE, background=25.0)
    texture = painted(dense_speckle(np.random.default_rng(7), 1.6, 20.0, 235.0, extent_px=300.0), camera)
    x, y = mesh.nodes.T
    u = [np.stack([g / LENGTH * (x + LENGTH / 2), -TRUTH["nu"] * g / LENGTH * y], axis=1) for g in GRIP]
    return [clean_image(motion, mesh.nodes, mesh.blocks, camera, texture, sensor) for motion in u]


def write_strip(folder: Path, solver: str = "", more: str = "", grip: str = "", deck: str = DECK) -> Path:
    """The experiment folder; `solver` goes into [solver], `more` behind it, `grip` into the drive."""
    mesh, rng = strip_mesh(), np.random.default_rng(3)
    sensor = Sensor(SHAPE, noise_std=NOISE, background=25.0)
    (folder / "images").mkdir(parents=True)
    write_images(folder, (record(image, sensor, rng) for image in _clean_images()))
    force = TRUTH["E"] * GRIP / LENGTH * WIDTH * THICKNESS + FORCE_NOISE * rng.standard_normal(len(GRIP))
    write_loads(folder, TIMES, {"force_N": force, "grip_mm": GRIP})
    write_inp(mesh, folder / "mesh.inp", "strip")
    rows = zip(mesh.node_labels, mesh.nodes, strict=True)
    (folder / "nodes.txt").write_text("".join(f"{label} {px!r} {py!r}\n" for label, (px, py) in
                                              ((label, map(float, point)) for label, point in rows)))
    shutil.copyfile(Path(__file__).with_name("strange_solver.py"), folder / "strange_solver.py")
    (folder / "strip.deck.template").write_text(deck)
    (folder / "experiment.toml").write_text(TOML.format(
        thickness=THICKNESS, pixel=PIXEL, column=ORIGIN[0], row=ORIGIN[1], noise=f"{sensor.total_noise_std:.4f}",
        grip=grip, python=sys.executable, solver=solver) + more)
    return folder
