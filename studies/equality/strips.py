"""A strip with a waist in tension: its mesh file, its plan, the experiment that is made of it.

The recording is that of `idic simulate` on a finer mesh with the true parameters; the experiment that is identified
has a coarser mesh and starts elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from idic_studies.equality.workshop import Workshop

LENGTH_MM, WIDTH_MM, THICKNESS_MM = 6.0, 4.0, 1.5
WAIST = 0.3  # share of the width that its middle lacks
PIXEL_MM, IMAGE_PX, ORIGIN_PX = 0.06, (140, 100), (69.3, 49.6)
FINE, COARSE = (10, 6), (6, 4)  # cells along and across
NOISE_GV, FORCE_NOISE_N, GRIP_NOISE_MM = 2.0, 1.0, 2e-4

RECORDED = """images = "images/*.tif"
loads = "loads.csv"
"""
EXPERIMENT = """[experiment]
title = "{title}"
{recording}mesh = "mesh.inp"
mesh_unit = "mm"
kind = "plane_stress"
thickness_mm = {thickness}
[camera]
pixel_size_mm = {pixel}
origin_px = [{column}, {row}]
noise_std_gv = {noise}
"""
DESIGN = """[design]
image_px = [{columns}, {rows}]
n_frames = {n_frames}
noise_std_gv = {noise}
speckle_px = 3.0
[design.program]
grip_mm = {program}
"""
ELASTIC = {"law": "elastic", "E": 2000.0, "nu": 0.35}
ELASTIC_START = """[material.BODY]
law = "elastic"
E = { value = 1600, unit = "MPa", identify = true }
nu = { value = 0.28, identify = true }
"""
PLASTIC = {"law": "j2_linear", "E": 2000.0, "nu": 0.35, "yield_stress": 40.0, "hardening_modulus": 300.0}
PLASTIC_START = """[material.BODY]
law = "j2_linear"
E = { value = 1700, unit = "MPa", identify = true }
nu = { value = 0.32, identify = true }
yield_stress = { value = 46, unit = "MPa", identify = true }
hardening_modulus = { value = 220, unit = "MPa", identify = true }
"""
GRIPS = f"""[[boundary]]
nodes = "LEFT"
ux = 0.0
uy = 0.0
[[boundary]]
nodes = "RIGHT"
ux = {{ column = "grip_mm", noise_std = {GRIP_NOISE_MM} }}
uy = 0.0
"""
FORCE = f"""[[channel]]
column = "force_N"
simulated = {{ reaction = "RIGHT", component = "x" }}
noise_std = {FORCE_NOISE_N}
"""
TENSION = ((0.0, 0.0), (4.0, 0.12), (5.0, 0.10))  # s, mm


@dataclass(frozen=True)
class Strip:
    """A test of the strip.

    truth : law and parameters of the material; start : its table in the experiment that is identified
    program : motion of the grip (s, mm); tables : further ones of the identified experiment
    """

    title: str = "strip with a waist"
    truth: Mapping[str, str | float] = field(default_factory=lambda: dict(ELASTIC))
    start: str = ELASTIC_START
    program: tuple[tuple[float, float], ...] = TENSION
    n_frames: int = 6
    tables: str = ""
    mesh: tuple[int, int] = COARSE
    noise_gv: float = NOISE_GV

    def plan(self, material: str) -> str:
        """experiment.toml before the test."""
        return self.head("") + material + GRIPS + FORCE + self.design()

    def experiment(self) -> str:
        """experiment.toml of the recorded test."""
        return self.head(RECORDED) + self.start + GRIPS + FORCE + self.tables

    def design(self) -> str:
        """[design] of the test."""
        columns, rows = IMAGE_PX
        return DESIGN.format(columns=columns, rows=rows, n_frames=self.n_frames, noise=self.noise_gv,
                             program=[list(point) for point in self.program])

    def head(self, recording: str) -> str:
        """[experiment] and [camera]; recording : lines that name images and log."""
        return EXPERIMENT.format(title=self.title, recording=recording, thickness=THICKNESS_MM, pixel=PIXEL_MM,
                                 column=ORIGIN_PX[0], row=ORIGIN_PX[1], noise=self.noise_gv)


def write_recorded(workshop: Workshop, name: str, strip: Strip, seed: int = 0) -> None:
    """The experiment folder `name` of a test of the strip, made by `idic simulate`."""
    plan = f"{name}-plan"
    workshop.write(f"{plan}/experiment.toml", strip.plan(material_table(strip.truth)))
    workshop.write(f"{plan}/mesh.inp", strip_mesh(FINE))
    workshop.idic("simulate", plan, "--out", name, "--seed", str(seed))
    workshop.write(f"{name}/experiment.toml", strip.experiment())
    workshop.write(f"{name}/mesh.inp", strip_mesh(strip.mesh))
    workshop.inputs.append(name)


def material_table(values: Mapping[str, str | float]) -> str:
    """[material.BODY] of known values; one is marked as free, as a plan identifies something."""
    lines = [f'{key} = "{value}"' if isinstance(value, str) else f"{key} = {value}" for key, value in values.items()]
    marked = next(key for key, value in values.items() if not isinstance(value, str))
    lines = [f"{marked} = {{ value = {values[marked]}, identify = true }}" if line.startswith(f"{marked} =") else line
             for line in lines]
    return "\n".join(["[material.BODY]", *lines, ""])


def strip_nodes(cells: tuple[int, int], waist: float = WAIST) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and quadratic cells of the strip  # (n_nodes, 2) mm, (n_cells, 8)"""
    shape = (2 * cells[0] + 1, 2 * cells[1] + 1)
    s, t = np.meshgrid(np.linspace(-1.0, 1.0, shape[0]), np.linspace(-1.0, 1.0, shape[1]), indexing="ij")
    width = WIDTH_MM * (1.0 - waist * (1.0 - s**2) ** 2)
    places = np.stack([0.5 * LENGTH_MM * s, 0.5 * width * t], axis=-1).reshape(-1, 2)
    number = np.arange(len(places)).reshape(shape)
    ring = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1))
    conn = np.array([[number[i + di, j + dj] for di, dj in ring]
                     for i in range(0, shape[0] - 1, 2) for j in range(0, shape[1] - 1, 2)])
    used, dense = np.unique(conn, return_inverse=True)
    return places[used], dense.reshape(conn.shape)


def strip_mesh(cells: tuple[int, int], waist: float = WAIST) -> str:
    """Abaqus input file of the strip: element set BODY, node sets LEFT and RIGHT."""
    nodes, conn = strip_nodes(cells, waist)
    x = nodes[:, 0]
    ends = {"LEFT": np.flatnonzero(x < -0.5 * LENGTH_MM + 1e-9), "RIGHT": np.flatnonzero(x > 0.5 * LENGTH_MM - 1e-9)}
    lines = ["*NODE", *(f"{k}, {px:.12f}, {py:.12f}" for k, (px, py) in enumerate(nodes.tolist(), 1)),
             "*ELEMENT, TYPE=CPS8, ELSET=BODY",
             *(f"{k}, " + ", ".join(str(node + 1) for node in cell) for k, cell in enumerate(conn.tolist(), 1))]
    for name, members in ends.items():
        lines += [f"*NSET, NSET={name}", *(f"{node + 1}," for node in members.tolist())]
    return "\n".join([*lines, ""])
