"""A strip whose hole is not where the mesh has it: the truth on a fine mesh of its own, the folder that a user has."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from idic.fe.march import march
from idic.fe.model import Constraints, Model, Reaction, Section
from idic.images.camera import Camera
from idic.images.pattern import dense_speckle
from idic.materials.core.compilation import compile as compile_law
from idic.virtual_tests.experiment_files import write_images, write_loads
from idic.virtual_tests.meshes import strip_with_hole, write_inp
from idic.virtual_tests.render import Sensor, clean_image, painted, record

LENGTH, WIDTH, RADIUS, THICKNESS = 24.0, 16.0, 3.0, 2.0  # mm, as in the user's mesh
PIXEL, SHAPE, ORIGIN = 0.1, (190, 270), (134.3, 94.6)
NOISE, FORCE_NOISE = 1.5, 10.0  # GV of 255, N: 1/1000 of the largest force
TRUTH = {"sheet.E": 70000.0, "sheet.nu": 0.3}

TOML = f"""
[experiment]
images = "images/*.tif"
loads = "loads.csv"
mesh = "mesh.inp"
mesh_unit = "mm"
kind = "plane_stress"
thickness_mm = {THICKNESS}
[camera]
pixel_size_mm = {PIXEL}
origin_px = [{ORIGIN[0]}, {ORIGIN[1]}]
centre_px = [{ORIGIN[0]}, {ORIGIN[1]}]
noise_std_gv = NOISE
[material.sheet]
law = "elastic"
E = {{ value = 60e3, unit = "MPa", identify = true }}
nu = {{ value = 0.35, identify = true }}
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


CAMERA = Camera.from_table(PIXEL, ORIGIN, centre=ORIGIN)


@dataclass(frozen=True)
class OpenHole:
    """What really happened: centre and radius of the hole (mm), camera, motion of the grip (mm)."""

    centre: tuple[float, float] = (0.0, 0.0)
    radius: float = RADIUS
    camera: Camera = CAMERA
    grip: tuple[float, ...] = tuple(0.04 * k for k in range(5))
    seed: int = 0
    truth: dict = field(default_factory=lambda: dict(TRUTH))


def true_mesh(twin: OpenHole):
    """quad8, nowhere the user's nodes; the hole is moved by a map that ends on the circle inscribed in the strip."""
    mesh = strip_with_hole(LENGTH, WIDTH, twin.radius, "quad8", around=7, radial=10, beside=4, grading=1.5)
    distance = np.hypot(*mesh.nodes.T)
    share = np.clip((0.5 * WIDTH - distance) / (0.5 * WIDTH - twin.radius), 0.0, 1.0)
    return replace(mesh, nodes=mesh.nodes + share[:, None] * np.array(twin.centre))


def motion(twin: OpenHole):
    """Mesh, displacements (n_frames, n_nodes, 2) mm and force (n_frames,) N"""
    mesh = true_mesh(twin)
    left, right = mesh.node_sets["LEFT"], mesh.node_sets["RIGHT"]
    dofs = np.concatenate([2 * right, 2 * right + 1, 2 * left, 2 * left + 1])
    basis = np.zeros((len(dofs), 1))
    basis[:len(right)] = 1.0
    model = Model(mesh=mesh, kind="plane_stress", thickness=THICKNESS, channels=(Reaction(2 * right),),
                  sections=(Section("sheet", compile_law("elastic", None), mesh.element_sets["sheet"]),),
                  constraints=Constraints(dofs, basis, np.array(twin.grip)[:, None]))
    values = {"sheet": np.array([twin.truth["sheet.E"], twin.truth["sheet.nu"]])}
    states = [(s.u.copy(), s.channels[0]) for s in march(model, values, np.arange(len(twin.grip), dtype=float))]
    return mesh, np.array([u for u, _ in states]), np.array([f for _, f in states])


def write_folder(folder, twin: OpenHole, more: str = "", cell: str = "quad4"):
    """The experiment of a user who knows nothing of `twin`'s hole and camera; `more` ends experiment.toml."""
    mesh, u, force = motion(twin)
    speckle = dense_speckle(np.random.default_rng(5), 1.6, 20.0, 235.0, extent_px=420.0)
    texture, sensor = painted(speckle, twin.camera), Sensor(SHAPE, noise_std=NOISE, background=25.0)
    rng = np.random.default_rng(50 + twin.seed)
    (folder / "images").mkdir(parents=True)
    write_images(folder, (record(clean_image(x, mesh.nodes, mesh.blocks, twin.camera, texture, sensor), sensor, rng)
                          for x in u))
    write_loads(folder, np.arange(len(u), dtype=float),
                {"force_N": force + FORCE_NOISE * rng.standard_normal(len(force)), "grip_mm": np.array(twin.grip)})
    write_inp(strip_with_hole(LENGTH, WIDTH, RADIUS, cell, around=4, radial=6, beside=2), folder / "mesh.inp", "strip")
    (folder / "experiment.toml").write_text(TOML.replace("NOISE", f"{sensor.total_noise_std:.4f}", 1) + more)
    return folder / "experiment.toml"


def free(*names: str) -> str:
    """[[dof]] tables: these are free, from what the file says of them."""
    return "".join(f'[[dof]]\nname = "{name}"\n' for name in names)
