"""A small twin with known truth as an experiment folder, and its identification without a cluster.

The truth is computed on a mesh twice as fine as the user's, and rendered by `idic.virtual_tests.rendering`.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np
from twin_bodies import PIXEL, plate

import idic
from idic.experiment_file import load_experiment
from idic.fe import Constraints, Body, Reaction, Section, march
from idic.identification import in_memory, run_loop
from idic.images import Camera, dense_speckle
from idic.laws import compile as compile_law
from idic.run import SerialRunner
from idic.run.prepared.session import Timing
from idic.run.runs import Run
from idic.virtual_tests import Sensor, clean_image, painted, record, write_images, write_inp, write_loads

SHAPE, ORIGIN, THICKNESS = (100, 140), (69.3, 49.6), 1.5
NOISE, FORCE_NOISE = 2.0, 1.0  # GV of 255, N
TRUTH = {"E": 2000.0, "nu": 0.35}

HEAD = """
[experiment]
images = "images/*.tif"
loads = "loads.csv"
mesh = "mesh.inp"
mesh_unit = "mm"
kind = "plane_stress"
thickness_mm = {thickness}
{experiment}
[camera]
pixel_size_mm = {pixel}
origin_px = [{column}, {row}]
{camera}
"""
ELASTIC = """
[material.BODY]
law = "elastic"
E = { value = 1200, unit = "MPa", identify = true }
nu = { value = 0.25, identify = true }
"""
GRIPS = """
[[boundary]]
nodes = "LEFT"
ux = 0.0
uy = 0.0
[[boundary]]
nodes = "RIGHT"
ux = { column = "grip_mm" }
uy = 0.0
"""
FORCE = """
[[channel]]
column = "force_N"
simulated = { reaction = "RIGHT", component = "x" }
noise_std = 1.0
"""


@dataclass(frozen=True)
class Twin:
    """What really happened: law and values, the grip's motion (mm), camera; what was recorded of it."""

    law: str = "elastic"
    truth: dict = field(default_factory=lambda: dict(TRUTH))
    grip: tuple = (0.0, 0.03, 0.06, 0.09, 0.12, 0.10)
    times: tuple = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)
    camera: Camera = Camera.from_table(PIXEL, ORIGIN)
    noise: float = NOISE
    force_noise: float = FORCE_NOISE
    grip_noise: float = 0.0
    log_late: float = 0.0  # s by which the log lags behind the images
    gains: tuple = ()
    seed: int = 0
    increments: int = 1  # of the truth, per frame

    def motion(self):
        """Clean displacements (n_frames, n_nodes, 2) and force (n_frames,) on the fine mesh."""
        return simulate(self, np.array(self.grip))


def simulate(twin: Twin, grip: np.ndarray):
    mesh = plate((12, 8))
    left, right = mesh.node_sets["LEFT"], mesh.node_sets["RIGHT"]
    dofs = np.concatenate([2 * right, 2 * right + 1, 2 * left, 2 * left + 1])
    basis = np.zeros((len(dofs), 1))
    basis[:len(right)] = 1.0
    law = compile_law(twin.law, None)
    frames, fine = np.arange(len(grip)), np.linspace(0, len(grip) - 1, (len(grip) - 1) * twin.increments + 1)
    grip, times = np.interp(fine, frames, grip), np.interp(fine, frames, np.array(twin.times))
    model = Body(mesh=mesh, kind="plane_stress", sections=(Section("BODY", law, mesh.element_sets["BODY"]),),
                  thickness=THICKNESS, constraints=Constraints(dofs, basis, grip[:, None]),
                  channels=(Reaction(2 * right),))
    values = np.array([twin.truth[name] for name in law.spec.parameter_names])
    states = [(s.u.copy(), s.channels[0]) for s in march(model, {"BODY": values}, times)]
    states = states[::twin.increments]
    return mesh, np.array([u for u, _ in states]), np.array([f for _, f in states])


def clean_images(twin: Twin):
    """Noise-free images and force of a twin: to be recorded many times."""
    mesh, u, force = twin.motion()
    texture = painted(dense_speckle(np.random.default_rng(7), 1.6, 20.0, 235.0, extent_px=300.0), twin.camera)
    sensor = Sensor(SHAPE, background=25.0)
    return np.array([clean_image(x, mesh.nodes, mesh.blocks, twin.camera, texture, sensor) for x in u]), force


def write_folder(folder, twin: Twin, toml: str, clean=None, names=None, experiment="", camera=""):
    """The folder of a twin; `toml` is everything after [camera]. Returns the experiment.toml."""
    images, force = clean_images(twin) if clean is None else clean
    rng = np.random.default_rng(100 + twin.seed)
    sensor = Sensor(SHAPE, noise_std=twin.noise, background=25.0)
    gains = twin.gains or ((1.0, 0.0),) * len(images)
    (folder / "images").mkdir(parents=True)
    written = write_images(folder, (record(a * image + b, sensor, rng)
                                    for (a, b), image in zip(gains, images, strict=True)))
    for old, new in zip(written, names or written, strict=True):
        (folder / "images" / old).rename(folder / "images" / new)
    times = np.array(twin.times)
    late = lambda values: np.interp(times - twin.log_late, times, values)  # noqa: E731
    grip = late(np.array(twin.grip)) + twin.grip_noise * rng.standard_normal(len(times)) * (times > 0)
    force = late(force) + twin.force_noise * rng.standard_normal(len(times))
    write_loads(folder, times, {"force_N": force, "grip_mm": grip})
    write_inp(plate((6, 4)), folder / "mesh.inp", "twin")
    if "noise_std_gv" not in camera:
        camera = f"noise_std_gv = {sensor.total_noise_std:.4f}\n" + camera
    head = HEAD.format(thickness=THICKNESS, pixel=PIXEL, column=ORIGIN[0], row=ORIGIN[1], experiment=experiment,
                       camera=camera)
    (folder / "experiment.toml").write_text(head + toml)
    return folder / "experiment.toml"


def solved(path, **overrides):
    """The identification in memory: the numbers of a RUN without its files, in a tenth of the time  # state, result"""
    found = in_memory.identify(load_experiment(path, _dotted(overrides)))
    return found.state, found.result


def judged(path, **overrides):
    """The identification in memory with its frames and residual: what result.json holds, in a tenth of the time."""
    return idic.identify(path, overrides=_dotted(overrides)).content


def _dotted(overrides):
    return {key.replace("__", "."): value for key, value in overrides.items()}


def identify(path, run, sensitivity="direct", **overrides):
    """The whole identification with its RUN, in this process: frames, residual and files, too  # state, result"""
    overrides = _dotted(overrides)
    began, runner, whole = time.perf_counter(), SerialRunner(), Run.planned(path, run, overrides)
    with whole.claim(resume=True):
        whole.ingest(runner)
        whole.prepare(runner)
        points = whole.open_points(runner, sensitivity, Timing())
        state = run_loop(points)
        return state, points.postprocess(state, began)
