"""Virtual tests before cameras with a lens: the truth on a finer mesh, images by ray tracing, another mesh for the
user."""

import json

import numpy as np

from idic.fe import Constraints, Body, Reaction, Section, march
from idic.images import PinholeCamera, PlacedCamera, RigidMotion, rotation_of
from idic.laws import compile as compile_law
from idic.virtual_tests import (
    Rig, Sensor, strip_with_hole, traced_images, write_images, write_inp, write_loads,
)

LENGTH, WIDTH, RADIUS = 28.0, 16.0, 3.0
TRUTH = {"sheet.E": 70e3, "sheet.nu": 0.3, "sheet.yield_stress": 200.0, "sheet.hardening_modulus": 1500.0}
GRIP = np.concatenate([np.linspace(0.0, 0.04, 3)[:-1], np.linspace(0.04, 0.1, 4)[:-1], np.linspace(0.1, 0.9, 4)])
INCREMENTS = 8  # of the truth per frame; of the user 4: a frame at a time is wrong by 1e-3 mm once the sheet yields
SHAPE, PIXEL = (130, 200), 0.15

TOML = """
[experiment]
images = "images/*.tif"
loads = "loads.csv"
mesh = "mesh.inp"
kind = "plane_stress"
thickness_mm = {thickness}

{camera}
noise_std_gv = {noise}

[material.sheet]
law = "j2_linear"
E = {{ value = 60e3, unit = "MPa", identify = true }}
nu = {{ value = 0.35, identify = true, bounds = [0.0, 0.49] }}
yield_stress = {{ value = 230, unit = "MPa", identify = true }}
hardening_modulus = {{ value = 1200, unit = "MPa", identify = true }}

[[boundary]]
nodes = "LEFT"
ux = 0.0
uy = 0.0
[[boundary]]
nodes = "RIGHT"
ux = {{ column = "grip_displacement_mm", noise_std = 0.0002 }}
uy = 0.0

[[channel]]
column = "force_N"
simulated = {{ reaction = "RIGHT", component = "x" }}
noise_std = 10.0

[options]
substeps = 4
{more}
"""


def lens(distance, angles=(0.0, 0.0, 0.0), k1=-0.1):
    focal = distance / PIXEL
    ny, nx = SHAPE
    return PinholeCamera(focal, 1.002 * focal, 0.5 * (nx - 1) + 2.3, 0.5 * (ny - 1) - 1.7, k1=k1,
                         rotation=rotation_of(angles) @ Rig.FROM_ABOVE, translation_mm=[0.3, -0.2, distance])


def true_motion(thickness, grip=GRIP, mesh=None):
    """Displacements (n_frames, n_nodes, 3) mm with the thickness change, force (n_frames,) N, and the true mesh."""
    mesh = strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", 5, 7, 4) if mesh is None else mesh
    left, right = mesh.node_sets["LEFT"], mesh.node_sets["RIGHT"]
    dofs = np.concatenate([2 * right, 2 * right + 1, 2 * left, 2 * left + 1])
    basis = np.zeros((len(dofs), 1))
    basis[:len(right)] = 1.0
    times = np.arange(len(grip), dtype=float)
    fine = np.linspace(0.0, times[-1], INCREMENTS * (len(grip) - 1) + 1)
    law = compile_law("j2_linear", "finite")
    model = Body(mesh=mesh, kind="plane_stress", sections=(Section("sheet", law, mesh.element_sets["sheet"]),),
                  thickness=thickness, constraints=Constraints(dofs, basis, np.interp(fine, times, grip)[:, None]),
                  channels=(Reaction(2 * right),), surface_side=1)
    values = np.array([TRUTH[f"sheet.{name}"] for name in law.spec.parameter_names])
    states = [(s.seen_u.copy(), s.channels[0]) for s in march(model, {"sheet": values}, fine)
              if s.frame % INCREMENTS == 0]
    return mesh, np.array([u for u, _ in states]), np.array([f for _, f in states])


def write_traced_images(folder, mesh, placed, u, sensor, rng):
    """The recording of a plane mesh with speckle by ray tracing; u : (n_frames, n_nodes, 2|3) mm"""
    write_images(folder, traced_images(mesh, None, placed, u, sensor, rng))


def write_plane_test(folder, camera, thickness=2.0, noise=2.0, table="", more="", rigid=None, seed=0, known=None,
                     user=(4, 6, 3), truth=None):
    """An experiment folder; rigid : (n_frames, 6) deg, mm of the specimen; known : the camera that the file tells."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "images").mkdir()
    mesh, u, force = true_motion(thickness) if truth is None else truth
    rng = np.random.default_rng(seed)
    motion = None
    if rigid is not None:
        names = ("rotation_x", "rotation_y", "rotation_z", "t_x", "t_y", "t_z")
        motion = RigidMotion(names, names, np.asarray(rigid).T, np.ones(6))
    placed = PlacedCamera(camera, motion=motion)
    write_traced_images(folder, mesh, placed, u, Sensor(SHAPE, noise_std=noise, background=25.0), rng)
    Rig((known or camera,), SHAPE).write_calibration(folder / "cal.json")
    write_loads(folder, np.arange(float(len(u))), {
        "force_N": force + 10.0 * rng.standard_normal(len(force)),
        "grip_displacement_mm": GRIP + 0.0002 * rng.standard_normal(len(GRIP))})
    write_inp(strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", *user), folder / "mesh.inp", "strip")
    text = TOML.format(thickness=thickness, camera=table or pinhole_table(known or camera), more=more,
                       noise=round(float(np.sqrt(noise**2 + 1 / 12)), 4))
    (folder / "experiment.toml").write_text(text)
    return folder


def pinhole_table(camera):
    return ('[camera]\nmodel = "pinhole"\ncalibration = "cal.json"\n'
            f"rotation = {json.dumps(camera.rotation.tolist())}\n"
            f"translation_mm = {json.dumps(camera.translation_mm.tolist())}")


def scores(result, truth=TRUTH):
    """(found - true) / std of every parameter."""
    return {name: (result["parameters"][name]["value"] - value) / result["parameters"][name]["std"]
            for name, value in truth.items()}
