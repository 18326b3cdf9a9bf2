"""A flat plate with two holes before one or two cameras: rendered images, the mesh, and the poses that are known.

The images come from ray tracing of one square and a speckle in space; the holes are dark discs of its texture.
"""

from __future__ import annotations

import numpy as np
import tifffile

from idic.fe import Block, make_mesh
from idic.virtual_tests import Rig, Scene, Sensor, grid_cells, SolidSpeckle, write_inp

SHAPE, PIXEL_MM, NOISE_GV, DARK_GV = (160, 240), 0.1, 2.0, 20.0
HALF = np.array([10.0, 6.0])  # mm
HOLES, RADIUS = np.array([[-6.0, -1.0, 0.0], [5.0, 2.0, 0.0]]), 1.5
CORNERS = np.array([[-10.0, -6.0, 0.0], [10.0, -6.0, 0.0], [10.0, 6.0, 0.0], [-10.0, 6.0, 0.0]])
TOML = """[experiment]
images = "left/*.tif"
mesh = "mesh.inp"
kind = "plane_stress"
thickness_mm = 1.0

{cameras}
[material.ALL]
law = "elastic"
E = {{ value = 70, unit = "GPa", identify = true }}
nu = 0.3

[[boundary]]
nodes = "LEFT"
ux = 0.0
uy = 0.0
"""


def pair(tilt_deg=0.0, angles=(-12.0, 12.0)):
    """The cameras, both on the same side; tilt_deg : of all about the mesh's y axis."""
    return Rig.around(SHAPE, PIXEL_MM, 200.0, [angle + tilt_deg for angle in angles]).cameras


def hole(camera, k, rng=None, radius=False):
    """A line of `holes`, the pixel up to 5 px from the middle."""
    px = camera.project(HOLES[k:k + 1])[0] + (3.0 if rng is None else rng.uniform(-5.0, 5.0, 2))
    more = f", radius_mm = {RADIUS}" if radius else ""
    return f"{{ centre_mm = {HOLES[k].tolist()}, px = {px.tolist()}{more} }}"


def edge(camera, first, second, off_px=3.0):
    """A line of `edges`, the pixels some px off the corners."""
    ends = CORNERS[[first, second]]
    return f"{{ points_mm = {ends.tolist()}, points_px = {(camera.project(ends) + off_px).tolist()} }}"


def alignment(holes=(), edges=(), more=""):
    return f"alignment = {{ holes = [{', '.join(holes)}], edges = [{', '.join(edges)}]{more} }}\n"


def write_plate(folder, cameras, tables, seed=0):
    """The folder: two equal images per camera; tables : lines of each [[camera]]."""
    speckle = SolidSpeckle.drawn(np.random.default_rng(seed), 1.6 * PIXEL_MM)
    noise = np.random.default_rng(seed + 1000)

    def texture(points):
        away = np.linalg.norm(points[:, None] - HOLES, axis=2).min(axis=1)
        return np.where(away < RADIUS, DARK_GV, speckle.value(points))

    scene = Scene(CORNERS, [Block("quad4", np.array([[0, 1, 2, 3]]), 0)], closed=False)
    text = ""
    for number, (camera, table) in enumerate(zip(cameras, tables, strict=True)):
        name = ("left", "right")[number]
        (folder / name).mkdir(parents=True, exist_ok=True)
        image = scene.image(0.0 * CORNERS, camera, texture, Sensor(SHAPE, background=DARK_GV))
        for frame in range(2):
            seen = np.clip(np.rint(image + NOISE_GV * noise.standard_normal(SHAPE)), 0, 255).astype(np.uint8)
            tifffile.imwrite(folder / name / f"f{frame}.tif", seen)
        text += (f'[[camera]]\nname = "{name}"\nmodel = "pinhole"\ncalibration = "cal.json"\n'
                 f"noise_std_gv = {NOISE_GV}\n" + (f'images = "{name}/*.tif"\n' if number else "") + table + "\n")
    Rig(tuple(cameras), SHAPE).write_calibration(folder / "cal.json")
    s, t = np.linspace(-HALF[0], HALF[0], 7), np.linspace(-HALF[1], HALF[1], 5)
    nodes = np.stack(np.meshgrid(s, t, indexing="ij"), axis=2).reshape(-1, 2)
    mesh = make_mesh(nodes, [("quad4", grid_cells(6, 4, 1))], node_sets={"LEFT": np.flatnonzero(nodes[:, 0] < -9.9)})
    write_inp(mesh, folder / "mesh.inp", "plate")
    (folder / "experiment.toml").write_text(TOML.format(cameras=text), encoding="utf-8")
    return folder


def placement_error(true, found):
    """The six numbers of ``placement.*`` that would bring a placed camera to the true one  # (6,) deg, mm"""
    seen = found.effective
    turn, shift = seen.rotation.T @ true.rotation, seen.rotation.T @ (true.translation_mm - seen.translation_mm)
    skew = 0.5 * (turn - turn.T)
    vector = np.degrees(np.array([skew[2, 1], skew[0, 2], skew[1, 0]]))  # small
    return np.append(vector, shift - found.pivot_mm + turn @ found.pivot_mm)
