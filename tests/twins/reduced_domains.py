"""Experiments of which the camera sees a part: the whole specimen between its grips, or a reduced domain.

    folder = write_case(path, "plate", "virtual", clean=clean_images("plate"))     # an experiment folder
    draw = redrawn(load_experiment(folder), clean, seed=3)                         # the same with new noise

The truth is computed on a finer mesh of the whole specimen (circular hole, quad8) and rendered by `idic.virtual`, which
shares no code with the correlator. What the routes share: images, force, the region that the camera sees.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from idic.edge.experiment_files import write_images, write_loads
from idic.edge.meshes import Patch, mesh_patches, strip_with_hole
from idic.fe.march import march
from idic.fe.mesh import make_mesh
from idic.fe.model import Constraints, Model, Reaction, Section
from idic.images.camera import Camera
from idic.images.pattern import dense_speckle
from idic.images.stack import ArrayStack
from idic.materials.compilation import compile as compile_law
from idic.virtual import Sensor, clean_image, painted, record

LENGTH, WIDTH, RADIUS, THICKNESS = 48.0, 12.0, 2.5, 2.0  # mm
HALF = 6.0  # mm: half the length of the reduced domain, a quarter of the specimen
PIXEL, SHAPE = 0.1, (130, 140)  # mm, px: the camera sees 14 of the 48 mm
NOISE_GV, FORCE_NOISE, GRIP_NOISE = 2.0, 5.0, 0.0002  # of 8 bit; N; mm
CAMERA = Camera.from_table(PIXEL, (67.8, 64.9))
TRUTH = {"E": 70000.0, "nu": 0.3, "yield_stress": 200.0, "hardening_modulus": 1500.0}
START = {"E": 60000.0, "nu": 0.35, "yield_stress": 230.0, "hardening_modulus": 1000.0}
GRIP = np.concatenate([np.linspace(0.0, 0.10, 5)[:-1], np.linspace(0.10, 0.18, 5)[:-1], np.linspace(0.18, 0.46, 6)])
TIMES = np.arange(len(GRIP), dtype=float)

HEAD = """
[experiment]
title = "{case}, {route}"
images = "images/*.tif"
loads = "loads.csv"
mesh = {mesh}
kind = "plane_stress"
thickness_mm = {thickness}
[camera]
pixel_size_mm = {pixel}
origin_px = [{column}, {row}]
axes = ["+col", "-row"]
noise_std_gv = {noise}
[material.SHEET]
law = "j2_linear"
E = {{ value = {E}, unit = "MPa", identify = true }}
nu = {{ value = {nu}, identify = true, bounds = [0.0, 0.49] }}
yield_stress = {{ value = {yield_stress}, unit = "MPa", identify = true }}
hardening_modulus = {{ value = {hardening_modulus}, unit = "MPa", identify = true }}
[[channel]]
column = "force_N"
simulated = {{ reaction = "RIGHT", component = "x" }}
noise_std = {force_noise}
"""
GRIPS = """
[[boundary]]
nodes = "LEFT"
ux = 0.0
uy = 0.0
[[boundary]]
nodes = "RIGHT"
ux = { column = "grip_mm", noise_std = 0.0002 }
uy = 0.0
"""
CUTS = """
[[boundary]]
nodes = "LEFT"
u = DRIVE
[[boundary]]
nodes = "RIGHT"
u = DRIVE
"""
ROUTES = {
    "full": GRIPS,
    "measured": CUTS.replace("DRIVE", '"measured"'),
    "bspline": CUTS.replace("DRIVE", '{ virtual = "bspline", modes = 5, time_modes = 9 }'),
    "dic": CUTS.replace("DRIVE", '{ virtual = "dic", modes = 3, time_modes = 5 }'),
    "outer": CUTS[:CUTS.index("[[boundary]]", 5)].replace(
        "LEFT", "CUT").replace("DRIVE", '{ virtual = "bspline", modes = 16, time_modes = 9 }'),
}


@dataclass(frozen=True)
class Clean:
    """Noise-free images (n_frames, ny, nx) and force (n_frames,) N."""

    images: np.ndarray
    force: np.ndarray


def true_mesh(case: str):
    """The whole specimen, finer than any mesh of the user; sets LEFT, RIGHT."""
    if case == "plate":
        return strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", 6, 9, 14, name="SHEET")
    patch = Patch(lambda s, t: (LENGTH * (s - 0.5), WIDTH * (t - 0.5) * waist(2 * s - 1)), 64, 16)
    nodes, conn = mesh_patches([patch], "quad8")
    x = nodes[:, 0]
    ends = {"LEFT": np.flatnonzero(x < 1e-6 - LENGTH / 2), "RIGHT": np.flatnonzero(x > LENGTH / 2 - 1e-6)}
    return make_mesh(nodes, [("quad8", conn)], node_sets=ends, element_sets={"SHEET": np.arange(len(conn))})


def waist(s):
    """Width of the strip over its width at the grips: it yields in the middle first."""
    return 1.0 - 0.0 * s


@lru_cache(maxsize=4)
def clean_images(case: str) -> Clean:
    """What a perfect camera and load cell would record."""
    mesh = true_mesh(case)
    left, right = mesh.node_sets["LEFT"], mesh.node_sets["RIGHT"]
    dofs = np.concatenate([2 * right, 2 * right + 1, 2 * left, 2 * left + 1])
    basis = np.zeros((len(dofs), 1))
    basis[:len(right)] = 1.0
    law = compile_law("j2_linear", "finite")
    model = Model(mesh=mesh, kind="plane_stress", sections=(Section("SHEET", law, mesh.element_sets["SHEET"]),),
                  thickness=THICKNESS, constraints=Constraints(dofs, basis, GRIP[:, None]),
                  channels=(Reaction(2 * right),))
    values = np.array([TRUTH[name] for name in law.spec.parameter_names])
    texture = painted(dense_speckle(np.random.default_rng(11), 1.6, 20.0, 235.0, extent_px=400.0), CAMERA)
    sensor = Sensor(SHAPE, background=25.0)
    images, force = [], []
    for state in march(model, {"SHEET": values}, TIMES, substeps=2):
        images.append(clean_image(state.u, mesh.nodes, mesh.blocks, CAMERA, texture, sensor))
        force.append(float(state.channels[0]))
    return Clean(np.array(images), np.array(force))


def noisy(clean: Clean, seed: int):
    """Images, force and grip as recorded  # (n_frames, ny, nx) uint8, (n_frames,), (n_frames,)"""
    rng = np.random.default_rng(500 + seed)
    sensor = Sensor(SHAPE, noise_std=NOISE_GV, background=25.0)
    images = np.array([record(image, sensor, rng) for image in clean.images])
    force = clean.force + FORCE_NOISE * rng.standard_normal(len(TIMES))
    return images, force, GRIP + GRIP_NOISE * rng.standard_normal(len(TIMES)) * (TIMES > 0)


def mesh_text(case: str, route: str, element: float) -> str:
    """The mesh of a route: made on the image, of the whole specimen or of the reduced domain."""
    half = LENGTH / 2 if route == "full" else HALF
    holes = f", holes_mm = [[0.0, 0.0, {RADIUS}]]" if case == "plate" else ""
    return (f"{{ roi_mm = [{-half}, {-WIDTH / 2}, {half}, {WIDTH / 2}], element_mm = {element}{holes} }}")


def write_case(folder: Path, case: str, route: str, clean: Clean | None = None, element: float = 1.0, seed: int = 0,
               boundary: str | None = None) -> Path:
    """The experiment folder of a case ("strip" | "plate") and a route of `ROUTES`; returns the experiment.toml.

    boundary : the [[boundary]] tables, where they are not those of the route.
    """
    images, force, grip = noisy(clean or clean_images(case), seed)
    folder = Path(folder)
    (folder / "images").mkdir(parents=True)
    write_images(folder, images)
    write_loads(folder, TIMES, {"force_N": force, "grip_mm": grip})
    sensor = Sensor(SHAPE, noise_std=NOISE_GV)
    head = HEAD.format(case=case, route=route, mesh=mesh_text(case, route, element), thickness=THICKNESS, pixel=PIXEL,
                       column=CAMERA.origin_px[0], row=CAMERA.origin_px[1], noise=round(sensor.total_noise_std, 4),
                       force_noise=FORCE_NOISE, **START)
    text = head + (ROUTES[route] if boundary is None else boundary)
    (folder / "experiment.toml").write_text(text)
    return folder / "experiment.toml"


def redrawn(experiment, clean: Clean, seed: int):
    """An experiment of a case with another draw of all noise."""
    images, force, grip = noisy(clean, seed)
    channels = tuple(replace(channel, values=force) for channel in experiment.channels)
    prescribed = tuple(replace(p, drive=replace(p.drive, values=grip)) if hasattr(p.drive, "noise_std") else p
                       for p in experiment.prescribed)
    return replace(experiment, stack=ArrayStack(images), channels=channels, prescribed=prescribed)
