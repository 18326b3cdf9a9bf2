"""The increments of a rate-dependent law: chosen by an error estimate, so that the answer does not depend on the frames.

A strip with a hole of a viscoplastic body, pulled to 5 % in 16 frames. The truth is marched on a finer mesh of
quadratic elements with 24 increments per frame and rendered pixel by pixel; the model knows nothing of either.
"""

from dataclasses import replace

import numpy as np
import pytest

from idic.experiment_file.load import load_experiment
from idic.fe.march import march
from idic.fe.model import Constraints, Model, Reaction, Section
from idic.identify.in_memory import identify
from idic.images.camera import Camera
from idic.images.pattern import dense_speckle
from idic.materials.core.compilation import compile as compile_law
from idic.virtual_tests.experiment_files import write_images, write_loads
from idic.virtual_tests.meshes import strip_with_hole, write_inp
from idic.virtual_tests.render import Sensor, clean_image, painted, record

LENGTH, WIDTH, RADIUS, PIXEL, NOISE = 20.0, 10.0, 2.0, 0.1, 1.0
SHAPE, ORIGIN = (120, 240), (20.0, 60.0)
N_FRAMES, TRUE_INCREMENTS, FORCE_NOISE = 16, 24, 0.1
TRUTH = {"E": 2000.0, "nu": 0.35, "yield_stress": 20.0, "hardening_modulus": 300.0, "eta": 2000.0, "m": 1.0}
TOML = f"""
[experiment]
images = "images/*.tif"
loads = "loads.csv"
mesh = "mesh.inp"
kind = "plane_stress"
thickness_mm = 1.0

[camera]
pixel_size_mm = {PIXEL}
origin_px = [{ORIGIN[0]}, {ORIGIN[1]}]
noise_std_gv = {np.hypot(NOISE, 12**-0.5):.4f}

[material.BODY]
law = "viscoplastic"
E = {{ value = 1900, unit = "MPa", identify = true }}
nu = 0.35
yield_stress = {{ value = 22, unit = "MPa", identify = true }}
hardening_modulus = {{ value = 250, unit = "MPa", identify = true }}
eta = {{ value = 1700, unit = "MPa s", identify = true }}
m = 1.0

[[boundary]]
nodes = "LEFT"
ux = 0.0
uy = 0.0

[[boundary]]
nodes = "RIGHT"
ux = {{ column = "grip_mm" }}
uy = 0.0

[[channel]]
column = "force_N"
simulated = {{ reaction = "RIGHT", component = "x" }}
noise_std = {FORCE_NOISE}
"""


def write_folder(folder):
    """The recording and its experiment.toml."""
    mesh = strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", 4, 5, 4, name="BODY")
    left, right = mesh.node_sets["LEFT"], mesh.node_sets["RIGHT"]
    dofs = np.concatenate([2 * right, 2 * right + 1, 2 * left, 2 * left + 1])
    basis = np.zeros((len(dofs), 1))
    basis[:len(right)] = 1.0
    times = np.linspace(0.0, 16.0, N_FRAMES + 1)
    grip = 0.05 * LENGTH * times / times[-1]
    law = compile_law("viscoplastic")
    model = Model(mesh=mesh, kind="plane_stress", sections=(Section("BODY", law, mesh.element_sets["BODY"]),),
                  thickness=1.0, constraints=Constraints(dofs, basis, grip[:, None]), channels=(Reaction(2 * right),))
    values = np.array([TRUTH[name] for name in law.spec.parameter_names])
    states = [(s.u.copy(), s.channels[0]) for s in march(model, {"BODY": values}, times, substeps=TRUE_INCREMENTS)]
    camera = Camera.from_table(PIXEL, ORIGIN)
    texture = painted(dense_speckle(np.random.default_rng(7), 1.6, 30.0, 225.0, extent_px=400.0), camera)
    rng = np.random.default_rng(11)
    sensor, clean = Sensor(SHAPE, noise_std=NOISE, background=30.0), Sensor(SHAPE, background=30.0)
    (folder / "images").mkdir(parents=True)
    write_images(folder, (record(clean_image(u, mesh.nodes, mesh.blocks, camera, texture, clean), sensor, rng)
                          for u, _ in states))
    force = np.array([f for _, f in states]) + FORCE_NOISE * rng.standard_normal(len(times))
    write_loads(folder, times, {"force_N": force, "grip_mm": grip})
    write_inp(strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", 2, 3, 2, name="BODY"), folder / "mesh.inp", "twin")
    (folder / "experiment.toml").write_text(TOML)
    return folder / "experiment.toml"
