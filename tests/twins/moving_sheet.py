"""A sheet that is carried through the field of view of a lens while it is stretched: its motion shows the distortion.

The truth is a uniform stretch, exact without finite elements; images by ray tracing, through the inverse of the lens.
The identification uses the lens itself, at the nodes.
"""

from __future__ import annotations

import numpy as np
from twins.pinhole_twin import write_traced_images

from idic.fe import make_mesh
from idic.images import LENS_MODELS, PlacedCamera, rotation_of
from idic.virtual_tests import Patch, Rig, Sensor, mesh_patches, write_inp, write_loads

LENGTH, WIDTH, THICKNESS, DISTANCE = 24.0, 14.0, 1.0, 30.0  # mm
SHAPE, FOCAL = (100, 150), 110.0  # px: 39 degrees from the axis in a corner
TRUTH = {"sheet.E": 2000.0, "sheet.nu": 0.35}
CARRIED = np.array([[0, 0], [4, 0], [4, 2], [-4, 2], [-4, -2], [4, -2]], dtype=float)  # mm; 4 mm: 15 px
STRETCH = np.linspace(0.0, 0.03, len(CARRIED))
NOISE, FORCE_NOISE = 2.0, 1.0  # GV, N

TOML = """
[experiment]
images = "images/*.tif"
loads = "loads.csv"
mesh = "mesh.inp"
kind = "plane_stress"
thickness_mm = {thickness}

[camera]
model = "{model}"
fx_px = {camera.fx}
fy_px = {camera.fy}
cx_px = {camera.cx}
cy_px = {camera.cy}
rotation = {rotation}
translation_mm = {translation}
noise_std_gv = {noise:.4f}

[material.sheet]
law = "elastic"
E = {{ value = 1700, unit = "MPa", identify = true }}
nu = {{ value = 0.3, identify = true }}

[[boundary]]
nodes = "LEFT"
ux = {{ column = "left_mm" }}
[[boundary]]
nodes = "RIGHT"
ux = {{ column = "right_mm" }}
[[boundary]]
nodes = "BOTTOM"
uy = {{ column = "bottom_mm" }}

[[channel]]
column = "force_N"
simulated = {{ reaction = "RIGHT", component = "x" }}
noise_std = {force_noise}
"""


def sheet(n=(12, 7)):
    """quad8 cells of 2 mm, 7 px; node sets LEFT, RIGHT, BOTTOM"""
    nodes, cells = mesh_patches([Patch(lambda s, t: ((s - 0.5) * LENGTH, (t - 0.5) * WIDTH), *n)], "quad8")
    edges = {"LEFT": nodes[:, 0] < -0.499 * LENGTH, "RIGHT": nodes[:, 0] > 0.499 * LENGTH,
             "BOTTOM": nodes[:, 1] < -0.499 * WIDTH}
    return make_mesh(nodes, [("quad8", cells)], node_sets={name: np.flatnonzero(on) for name, on in edges.items()},
                     element_sets={"sheet": np.arange(len(cells))})


def motion(mesh):
    """Uniaxial tension in plane stress with the way of its surface, carried along  # (n_frames, n_nodes, 3) mm"""
    contraction, n = -TRUTH["sheet.nu"] * STRETCH, mesh.n_nodes
    return np.array([np.column_stack([e * mesh.nodes[:, 0] + x, c * mesh.nodes[:, 1] + y,
                                      np.full(n, 0.5 * THICKNESS * c)])
                     for e, c, (x, y) in zip(STRETCH, contraction, CARRIED, strict=True)])


def write_moving_sheet(folder, name, stated, free=()):
    """The experiment of a lens with its example coefficients; stated : what the file says of them where it differs;
    free : those to identify
    """
    (folder / "images").mkdir(parents=True)
    model, mesh, rng = LENS_MODELS[name], sheet(), np.random.default_rng(5)
    camera = model(FOCAL, 1.01 * FOCAL, 76.2, 48.1, rotation=rotation_of([2.0, -3.0, 1.0]) @ Rig.FROM_ABOVE,
                   translation_mm=[0.3, -0.2, DISTANCE], **model.example)
    placed, sensor, u = PlacedCamera(camera), Sensor(SHAPE, noise_std=NOISE, background=25.0), motion(mesh)
    write_traced_images(folder, mesh, placed, u, sensor, rng)
    force = TRUTH["sheet.E"] * STRETCH * WIDTH * THICKNESS
    write_loads(folder, np.arange(float(len(u))), {
        "force_N": force + FORCE_NOISE * rng.standard_normal(len(u)),
        **{f"{edge.lower()}_mm": u[:, mesh.node_sets[edge][0], k] for edge, k in
           (("LEFT", 0), ("RIGHT", 0), ("BOTTOM", 1))}})
    write_inp(mesh, folder / "mesh.inp", "sheet")
    text = TOML.format(thickness=THICKNESS, model=name, camera=camera, rotation=camera.rotation.tolist(),
                       translation=camera.translation_mm.tolist(), noise=sensor.total_noise_std,
                       force_noise=FORCE_NOISE)
    given = "".join(f"{key} = {value}\n" for key, value in (model.example | stated).items())
    free = "".join(f'[[dof]]\nname = "camera.{key}"\n' for key in free)
    (folder / "experiment.toml").write_text(text.replace("noise_std_gv", given + "noise_std_gv") + free)
    return folder / "experiment.toml"
