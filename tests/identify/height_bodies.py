"""Solids seen by a profilometer, in memory: a block in uniform tension (closed form) and a plate that is bent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import brentq

from idic.correlation import camera_at, view_of
from idic.fe import make_mesh
from idic.images import ArrayStack, Camera
from idic.model import (
    Column, Constant, Experiment, Load, Material, Model, Noise, Options, Prescribed, Recording, build_forward, solve,
)
from idic.parameters import Parameter, ParameterSet
from idic.virtual_tests import render, Sensor

PIXEL, UM = 0.02, 1e-3  # mm; mm per unit of height
TRUTH = {"C10": 3.3, "kappa": 66.0}  # MPa
RMS = 3.0  # um


class Roughness:
    """Heights (um) as a sum of waves of 12 to 40 px over the undeformed body: exact at any point."""

    def __init__(self, seed=0, n=120):
        rng = np.random.default_rng(seed)
        direction, length = rng.uniform(0, 2 * np.pi, n), rng.uniform(12.0, 40.0, n) * PIXEL
        self.waves = 2 * np.pi / length * np.stack([np.cos(direction), np.sin(direction)])  # (2, n) 1/mm
        self.phase, self.scale = rng.uniform(0, 2 * np.pi, n), RMS * np.sqrt(2.0 / n)

    def __call__(self, points):
        return self.scale * np.cos(points[:, :2] @ self.waves + self.phase).sum(axis=1)


def block(size, cells, up=1.0):
    """hex8 cells over 0..size; node sets X0, Y0, Z0, X1; face sets TOP (the camera's side), BELOW, END.

    up : -1 puts the camera's face at the lower z: it then looks against the outward normal -z.
    """
    axes = [np.linspace(0.0, s, n + 1) for s, n in zip(size, cells, strict=True)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    at = np.arange(len(nodes)).reshape([n + 1 for n in cells])
    corner = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    conn = [[at[i + a, j + b, k + c] for a, b, c in corner]
            for i in range(cells[0]) for j in range(cells[1]) for k in range(cells[2])]
    sets = {f"{'XYZ'[d]}{side}": np.flatnonzero(np.isclose(nodes[:, d], side * size[d]))
            for d in range(3) for side in (0, 1)}
    mesh = make_mesh(nodes, [("hex8", np.array(conn))], node_sets=sets, element_sets={"BODY": np.arange(len(conn))})
    faces = {name: np.array([face for face in mesh.boundary_faces() if np.isin(mesh.face_nodes(face), sets[on]).all()])
             for name, on in (("TOP", "Z1" if up > 0 else "Z0"), ("BELOW", "Z0" if up > 0 else "Z1"), ("END", "X1"))}
    return replace(mesh, edge_sets=faces)


def experiment(mesh, prescribed, loads, times, start=None, shape=(120, 190), **options):
    values = TRUTH if start is None else start
    parameters = [Parameter(f"BODY.{name}", value, "MPa", True, transform="log") for name, value in values.items()]
    model = Model("solid", mesh, None, (Material("BODY", "neo_hookean", "finite"),), ParameterSet(parameters),
                  prescribed,
                  loads, (), Camera.from_table(PIXEL, (10.3, 105.6)), times, surface="TOP")
    recording = Recording(None, tuple(map(str, range(len(times)))), quantity="height", height_unit=UM,
                          noise=Noise(0.01 * RMS))
    return Experiment("height", "", recording, model,
                      options=Options(**({"brightness": "none", "lowpass_px": 0.0} | options)))


def column(name, values, times):
    return Column(name, np.asarray(values, float), rates=np.gradient(np.asarray(values, float), times))


# a block in uniform tension -------------------------------------------------------------------------------
TIMES = np.arange(6.0)
TENSION = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0])  # MPa, nominal
SIZE = (3.0, 1.9, 0.5)  # mm


def pulled_block(start=None, **options):
    """Symmetry planes at x = y = z = 0, nominal traction along x; seen from above."""
    planes = tuple(Prescribed(f"{axis.upper()}0", axis, Constant(0.0)) for axis in "xyz")
    load = Load("END", "traction", column("tension", TENSION, TIMES), "x")
    return experiment(block(SIZE, (3, 2, 1)), planes, (load,), TIMES, start, **options)


def stretches(tension, C10, kappa):
    """(l1, l2) of compressible neo-Hookean tension, l3 = l2: from both first Piola stresses in closed form."""
    def lateral(l1):
        def stress(l2):
            J, I1 = l1 * l2**2, l1**2 + 2 * l2**2
            return 2 * C10 * J ** (-2 / 3) * (l2 - I1 / (3 * l2)) + kappa * (J - 1) * J / l2
        return brentq(stress, 0.3, 1.5, xtol=1e-15)

    def axial(l1):
        l2 = lateral(l1)
        J, I1 = l1 * l2**2, l1**2 + 2 * l2**2
        return 2 * C10 * J ** (-2 / 3) * (l1 - I1 / (3 * l1)) + kappa * (J - 1) * J / l1 - tension
    l1 = brentq(axial, 0.8, 2.5, xtol=1e-15)
    return l1, lateral(l1)


def exact_images(body, roughness, truth=TRUTH):
    """g(x') = f(X) + u_z / um with X from the closed form: neither a mesh nor an interpolator  # (n, ny, nx) um"""
    rows, columns = np.mgrid[:120, :190]
    seen = body.model.camera.inverse(np.column_stack([columns.ravel(), rows.ravel()]))  # (n_px, 2) mm
    images = []
    for tension in TENSION:
        l1, l2 = stretches(tension, **truth)
        images.append(roughness(seen / [l1, l2]) + SIZE[2] * (l2 - 1.0) / UM)
    return np.array(images).reshape(len(images), 120, 190)


# a plate that is bent -------------------------------------------------------------------------------------
def bent_plate(up=1.0, pressure=0.004, **options):
    """Clamped at x = 0, a follower pressure below lifts the free end towards the camera (`up` < 0: away from it)."""
    times = np.arange(4.0)
    clamp = tuple(Prescribed("X0", axis, Constant(0.0)) for axis in "xyz")
    load = Load("BELOW", "pressure", column("pressure", pressure * times / 3.0, times), None, True)
    return experiment(block((3.0, 1.5, 0.4), (12, 2, 2), up), clamp, (load,), times, **options)


def photographed(body, seed=0):
    """The same with noise-free height images of its own motion, made by the virtual profilometer."""
    u = solve(build_forward(body), body.model.parameters).u
    camera = camera_at(body, body.model.parameters)
    images = render(u, body.model.mesh.nodes, body.model.mesh.surface_cells("TOP"), camera, Roughness(seed),
                    Sensor((120, 190), bits=0, supersampling=1), np.random.default_rng(0),
                    view_of(body, camera).rise)
    return replace(body, recording=replace(body.recording, stack=ArrayStack(list(images))))
