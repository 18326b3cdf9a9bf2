"""Experiments of which the camera sees a part: the whole specimen between its grips, or a reduced domain.

    folder = write_case(path, "plate", "virtual", clean=clean_images("plate"))     # an experiment folder
    draw = redrawn(load_experiment(folder), clean, seed=3)                         # the same with new noise

The truth is computed on a finer mesh of the whole specimen (circular hole, quad8) and rendered by
`idic.virtual_tests.rendering`, which shares no code with the correlator. What the routes share: images, force, the
region that the camera sees.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from idic.fe import Constraints, Body, Reaction, Section, make_mesh, march
from idic.images import ArrayStack, Camera, dense_speckle
from idic.laws import compile as compile_law
from idic.virtual_tests import (
    Patch, Sensor, clean_image, mesh_patches, painted, record, strip_with_hole, write_images, write_inp, write_loads,
)

LENGTH, WIDTH, RADIUS, THICKNESS = 96.0, 12.0, 2.5, 2.0  # mm
HALF = 6.0  # mm: half the length of the reduced domain, an eighth of the specimen
PIXEL, SHAPE = 0.1, (130, 140)  # mm, px: the camera sees 14 of the 96 mm
NOISE_GV, FORCE_NOISE, GRIP_NOISE = 2.0, 1.0, 0.0002  # of 8 bit; N; mm
CAMERA = Camera.from_table(PIXEL, (67.8, 64.9))
TRUTH = {"E": 2000.0, "nu": 0.35}  # a polymer
GRIP = np.concatenate([np.linspace(0.0, 1.4, 7), [1.2, 0.8, 0.4]])  # mm: 14 px up, and most of the way back
TIMES = np.arange(len(GRIP), dtype=float)  # s

HEAD = """
[experiment]
title = "{case}, {route}"
images = "images/*.tif"
loads = "loads.csv"
mesh = {mesh}
mesh_unit = "mm"
kind = "plane_stress"
thickness_mm = {thickness}
[camera]
pixel_size_mm = {pixel}
origin_px = [{column}, {row}]
axes = ["+col", "-row"]
noise_std_gv = {noise}
[material.SHEET]
law = "elastic"
E = {{ value = 1500, unit = "MPa", identify = true }}
nu = {{ value = 0.25, identify = true }}
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
OUTER = """
[sets]
AROUND = { boundary = "outer" }
[[boundary]]
nodes = "AROUND"
u = { virtual = "bspline", modes = 16, time_modes = 9 }
"""  # also the free edges: nothing is assumed of what lies outside
ROUTES = {
    "full": GRIPS,
    "measured": CUTS.replace("DRIVE", '"measured"'),
    "bspline": CUTS.replace("DRIVE", '{ virtual = "bspline", modes = 6, time_modes = 9 }'),
    "dic": CUTS.replace("DRIVE", '{ virtual = "dic", modes = 3, time_modes = 3 }'),
    "outer": OUTER,
}


@dataclass(frozen=True)
class Clean:
    """Noise-free images (n_frames, ny, nx) and force (n_frames,) N."""

    images: np.ndarray
    force: np.ndarray


def true_mesh(case: str):
    """The whole specimen, finer than any mesh of the user; sets LEFT, RIGHT."""
    if case == "plate":
        return strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", 5, 7, 28, name="SHEET")
    return strip(96, 10)


def strip(n: int, m: int, length: float = LENGTH):
    """A strip without a hole: n x m quad8."""
    patch = Patch(lambda s, t: (length * (s - 0.5), WIDTH * (t - 0.5)), n, m)
    nodes, conn = mesh_patches([patch], "quad8")
    return with_ends(make_mesh(nodes, [("quad8", conn)], element_sets={"SHEET": np.arange(len(conn))}))


def with_ends(mesh):
    x = mesh.nodes[:, 0]
    ends = {"LEFT": np.flatnonzero(x < x.min() + 1e-6), "RIGHT": np.flatnonzero(x > x.max() - 1e-6)}
    return replace(mesh, node_sets=ends)


def user_mesh(case: str, whole: bool):
    """What the user has: 384 (strip: 256) elements of the whole specimen, of which 96 (32) make the reduced domain."""
    if case == "strip":
        return strip(64, 4) if whole else strip(8, 4, 2 * HALF)
    mesh = strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", 3, 4, 24, name="SHEET")
    if whole:
        return mesh
    conn = mesh.blocks[0].connectivity
    conn = conn[np.abs(mesh.nodes[conn, 0]).max(axis=1) < HALF + 1e-6]
    used = np.unique(conn)
    return with_ends(make_mesh(mesh.nodes[used], [("quad8", np.searchsorted(used, conn))],
                               element_sets={"SHEET": np.arange(len(conn))}))


@lru_cache(maxsize=4)
def clean_images(case: str) -> Clean:
    """What a perfect camera and load cell would record."""
    mesh = true_mesh(case)
    left, right = mesh.node_sets["LEFT"], mesh.node_sets["RIGHT"]
    dofs = np.concatenate([2 * right, 2 * right + 1, 2 * left, 2 * left + 1])
    basis = np.zeros((len(dofs), 1))
    basis[:len(right)] = 1.0
    law = compile_law("elastic", "small")
    model = Body(mesh=mesh, kind="plane_stress", sections=(Section("SHEET", law, mesh.element_sets["SHEET"]),),
                  thickness=THICKNESS, constraints=Constraints(dofs, basis, GRIP[:, None]),
                  channels=(Reaction(2 * right),))
    values = np.array([TRUTH[name] for name in law.spec.parameter_names])
    texture = painted(dense_speckle(np.random.default_rng(11), 1.6, 20.0, 235.0, extent_px=400.0), CAMERA)
    sensor = Sensor(SHAPE, background=25.0)
    images, force = [], []
    for state in march(model, {"SHEET": values}, TIMES):
        images.append(clean_image(state.u, mesh.nodes, mesh.blocks, CAMERA, texture, sensor))
        force.append(float(state.channels[0]))
    return Clean(np.array(images), np.array(force))


def noisy(clean: Clean, seed: int, log_scale: float = 1.0):
    """Images, force and grip as recorded  # (n_frames, ny, nx) uint8, (n_frames,), (n_frames,)"""
    rng = np.random.default_rng(500 + seed)
    sensor = Sensor(SHAPE, noise_std=NOISE_GV, background=25.0)
    images = np.array([record(image, sensor, rng) for image in clean.images])
    force = clean.force + FORCE_NOISE * rng.standard_normal(len(TIMES))
    return images, force, log_scale * GRIP + GRIP_NOISE * rng.standard_normal(len(TIMES)) * (TIMES > 0)


def write_case(folder: Path, case: str, route: str, clean: Clean | None = None, seed: int = 0,
               boundary: str | None = None) -> Path:
    """The experiment folder of a case ("strip" | "plate") and a route of `ROUTES`; returns the experiment.toml.

    boundary : the [[boundary]] tables, where they are not those of the route.
    """
    images, force, grip = noisy(clean or clean_images(case), seed)
    folder = Path(folder)
    (folder / "images").mkdir(parents=True)
    write_images(folder, images)
    write_loads(folder, TIMES, {"force_N": force, "grip_mm": grip})
    write_inp(user_mesh(case, route == "full"), folder / "mesh.inp", f"{case}, {route}")
    sensor = Sensor(SHAPE, noise_std=NOISE_GV)
    head = HEAD.format(case=case, route=route, mesh='"mesh.inp"', thickness=THICKNESS, pixel=PIXEL,
                       column=CAMERA.origin_px[0], row=CAMERA.origin_px[1], noise=round(sensor.total_noise_std, 4),
                       force_noise=FORCE_NOISE)
    text = head + (ROUTES[route] if boundary is None else boundary)
    (folder / "experiment.toml").write_text(text)
    return folder / "experiment.toml"


def redrawn(experiment, clean: Clean, seed: int, log_scale: float = 1.0):
    """An experiment of a case with another draw of all noise; log_scale : what the log shows of the grip's motion."""
    images, force, grip = noisy(clean, seed, log_scale)
    channels = tuple(replace(channel, values=force) for channel in experiment.model.channels)
    prescribed = tuple(replace(p, drive=replace(p.drive, values=grip)) if hasattr(p.drive, "noise_std") else p
                       for p in experiment.model.prescribed)
    return replace(experiment, recording=replace(experiment.recording, stack=ArrayStack(images)),
                   model=replace(experiment.model, channels=channels, prescribed=prescribed))
