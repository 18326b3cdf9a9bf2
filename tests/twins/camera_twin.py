"""A strip of two materials under a known force, photographed by up to two cameras: an experiment folder with its truth.

Truth on a mesh twice as fine, rendered without interpolation. x runs along the strip; SOFT left of x = 0, STIFF right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import tifffile

from idic.fe import Constraints, Loads, Body, Section, face_area, make_mesh, march, traction
from idic.images import Camera, dense_speckle
from idic.laws import compile as compile_law
from idic.virtual_tests import Sensor, clean_image, painted, record, write_inp, write_loads

TRUTH = {"SOFT": 1500.0, "STIFF": 4000.0}  # MPa
NU, THICKNESS, HALF, WIDTH = 0.3, 1.0, 6.0, 4.0  # mm
FORCE = 80.0 * np.array([0.0, 0.5, 1.0, 0.8])  # N
TIMES = np.arange(4.0)

HEAD = """
[experiment]
images = "images/*.tif"
loads = "loads.csv"
mesh = "mesh.inp"
mesh_unit = "mm"
kind = "plane_stress"
thickness_mm = 1.0
{experiment}

[material.SOFT]
law = "elastic"
E = {{ value = 1000, unit = "MPa", identify = true }}
nu = 0.3
[material.STIFF]
law = "elastic"
E = {{ value = 5000, unit = "MPa", identify = true }}
nu = 0.3

[[boundary]]
nodes = "LEFT"
ux = 0.0
[[boundary]]
nodes = "CORNER"
uy = 0.0
[[boundary]]
nodes = "RIGHT"
force = {{ column = "force_N", component = "x" }}
"""


@dataclass(frozen=True)
class Eye:
    """A camera of the twin: its name, where it looks, its image size and noise (grey values)."""

    name: str
    camera: Camera
    shape: tuple[int, int]
    noise: float = 2.0
    pattern_seed: int = 7

    def table(self, first: bool) -> str:
        lines = ["[[camera]]", f'name = "{self.name}"', f"noise_std_gv = {np.hypot(self.noise, 12**-0.5):.5f}",
                 f"matrix_px_per_unit = {self.camera.matrix.tolist()}", f"origin_px = {self.camera.origin_px.tolist()}"]
        return "\n".join(lines + ([] if first else [f'images = "{self.name}/*.tif"']))


LEFT_EYE = Eye("camera", Camera.from_table(0.08, (75.0, 34.6)), (70, 55))  # x from -6 to -1.6 mm
RIGHT_EYE = Eye("behind", Camera.from_table(0.065, (80.0, 40.3), ("-col", "-row"), rotation_deg=2.0), (80, 95), 3.0,
                8)  # mirrored, finer, turned: x from -0.2 to 6 mm
WHOLE_EYE = Eye("camera", Camera.from_table(0.08, (82.0, 34.6)), (70, 165))


def strip(cells: tuple[int, int]):
    """quad8 cells over the strip; sets LEFT, RIGHT, CORNER, materials SOFT and STIFF."""
    n = (2 * cells[0] + 1, 2 * cells[1] + 1)
    x, y = np.meshgrid(np.linspace(-HALF, HALF, n[0]), np.linspace(-0.5 * WIDTH, 0.5 * WIDTH, n[1]), indexing="ij")
    nodes, at = np.stack([x, y], axis=-1).reshape(-1, 2), np.arange(n[0] * n[1]).reshape(n)
    conn = [[at[i, j], at[i + 2, j], at[i + 2, j + 2], at[i, j + 2], at[i + 1, j], at[i + 2, j + 1], at[i + 1, j + 2],
             at[i, j + 1]] for i in range(0, n[0] - 1, 2) for j in range(0, n[1] - 1, 2)]
    used = np.unique(conn)
    number = np.full(len(nodes), -1)
    number[used] = np.arange(len(used))
    nodes, conn = nodes[used], number[np.array(conn)]
    middle = nodes[conn[:, :4], 0].mean(axis=1)
    left = np.flatnonzero(nodes[:, 0] < -HALF + 1e-9)
    sets = {"LEFT": left, "RIGHT": np.flatnonzero(nodes[:, 0] > HALF - 1e-9),
            "CORNER": left[[np.argmin(nodes[left, 1])]]}
    return make_mesh(nodes, [("quad8", conn)], node_sets=sets,
                     element_sets={"SOFT": np.flatnonzero(middle < 0), "STIFF": np.flatnonzero(middle > 0)})


def motion(mesh):
    """True displacements (n_frames, n_nodes, 2) mm."""
    right = mesh.node_sets["RIGHT"]
    faces = np.array([face for face in mesh.boundary_faces() if np.isin(mesh.face_nodes(face), right).all()])
    pull = traction(mesh, faces, (1.0 / face_area(mesh, faces, THICKNESS), 0.0), THICKNESS)
    held = np.unique(np.concatenate([2 * mesh.node_sets["LEFT"], 2 * mesh.node_sets["CORNER"] + 1]))
    law = compile_law("elastic", None)
    model = Body(mesh=mesh, kind="plane_stress", thickness=THICKNESS,
                  sections=tuple(Section(name, law, mesh.element_sets[name]) for name in TRUTH),
                  constraints=Constraints(held, np.zeros((len(held), 0)), np.zeros((len(TIMES), 0))),
                  loads=Loads(dead=pull[:, None], dead_histories=FORCE[:, None]))
    values = {name: np.array([modulus, NU]) for name, modulus in TRUTH.items()}
    return [state.u.copy() for state in march(model, values, TIMES)]


def clean_views(eyes):
    """Noise-free images of every camera  # list of (n_frames, ny, nx)"""
    mesh = strip((24, 8))
    u = motion(mesh)
    views = []
    for eye in eyes:
        speckle = dense_speckle(np.random.default_rng(eye.pattern_seed), 1.6, 20.0, 235.0, extent_px=300.0)
        texture, sensor = painted(speckle, eye.camera), Sensor(eye.shape, background=25.0)
        views.append([clean_image(x, mesh.nodes, mesh.blocks, eye.camera, texture, sensor) for x in u])
    return views


def write_folder(folder, eyes, views, seed=0, further="", experiment=""):
    """The experiment of these cameras; `further` goes to the end. Returns the experiment.toml."""
    rng = np.random.default_rng(100 + seed)
    for first, (eye, images) in enumerate(zip(eyes, views, strict=True)):
        place = folder / (eye.name if first else "images")
        place.mkdir(parents=True)
        sensor = Sensor(eye.shape, noise_std=eye.noise, background=25.0)
        for k, image in enumerate(images):
            tifffile.imwrite(place / f"frame_{k:03d}.tif", record(image, sensor, rng))
    write_loads(folder, TIMES, {"force_N": FORCE})
    write_inp(strip((12, 4)), folder / "mesh.inp", "strip")
    tables = "\n".join(eye.table(first=k == 0) + "\n" for k, eye in enumerate(eyes))
    (folder / "experiment.toml").write_text(HEAD.format(experiment=experiment) + tables + further)
    return folder / "experiment.toml"
