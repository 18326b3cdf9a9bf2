"""A strip whose hole is not where the mesh has it: the truth on a fine mesh of its own, the folder that a user has."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from strip_twin import marched, pulled, strip_toml, write_recording, write_rest

from idic.images import Camera
from idic.laws import compile as compile_law
from idic.virtual_tests import strip_with_hole

LENGTH, WIDTH, RADIUS, THICKNESS = 24.0, 16.0, 3.0, 2.0  # mm, as in the user's mesh
PIXEL, SHAPE, ORIGIN = 0.1, (190, 270), (134.3, 94.6)
NOISE, FORCE_NOISE = 1.5, 10.0  # GV of 255, N: 1/1000 of the largest force
TRUTH = {"sheet.E": 70000.0, "sheet.nu": 0.3}

TOML = strip_toml(PIXEL, ORIGIN, THICKNESS, FORCE_NOISE, camera=f"centre_px = [{ORIGIN[0]}, {ORIGIN[1]}]\n") + """
[material.sheet]
law = "elastic"
E = { value = 60e3, unit = "MPa", identify = true }
nu = { value = 0.35, identify = true }
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
    mesh = strip_with_hole(LENGTH, WIDTH, twin.radius, "quad8", around=7, radial=10, along=4, grading=1.5)
    distance = np.hypot(*mesh.nodes.T)
    share = np.clip((0.5 * WIDTH - distance) / (0.5 * WIDTH - twin.radius), 0.0, 1.0)
    return replace(mesh, nodes=mesh.nodes + share[:, None] * np.array(twin.centre))


def motion(twin: OpenHole):
    """Mesh, displacements (n_frames, n_nodes, 2) mm and force (n_frames,) N"""
    mesh = true_mesh(twin)
    values = {"sheet": np.array([twin.truth["sheet.E"], twin.truth["sheet.nu"]])}
    model = pulled(mesh, "sheet", compile_law("elastic", None), np.array(twin.grip), THICKNESS)
    u, force, _ = marched(model, values, np.arange(len(twin.grip), dtype=float), substeps=1)
    return mesh, u, force


def write_folder(folder, twin: OpenHole, more: str = "", cell: str = "quad4"):
    """The experiment of a user who knows nothing of `twin`'s hole and camera; `more` ends experiment.toml."""
    mesh, u, force = motion(twin)
    rng = np.random.default_rng(50 + twin.seed)
    noise = write_recording(folder, mesh, u, twin.camera, SHAPE, NOISE, rng, texture_px=420.0)
    force = force + FORCE_NOISE * rng.standard_normal(len(force))
    user = strip_with_hole(LENGTH, WIDTH, RADIUS, cell, around=4, radial=6, along=2)
    return write_rest(folder, user, TOML.replace("NOISE", f"{noise:.4f}", 1) + more, np.arange(len(u), dtype=float),
                      {"force_N": force, "grip_mm": np.array(twin.grip)})


def free(*names: str) -> str:
    """[[dof]] tables: these are free, from what the file says of them."""
    return "".join(f'[[dof]]\nname = "{name}"\n' for name in names)
