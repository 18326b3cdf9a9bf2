"""A strip with a hole whose material has more in it than the model: one physics concealed at a time.

The truth is marched on a finer mesh of quadratic elements in smaller time steps, and rendered; the user's file has the
simpler law. Program: up, hold, down, hold, up again, and for plastic nulls into compression.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import laminate_sheet
import numpy as np
from side_twins import GRIP_NOISE, LENGTH, NOISE, ORIGIN, PIXEL, RADIUS, SHAPE, THICKNESS, WIDTH

from idic.fe import Constraints, Body, Reaction, Section, march
from idic.images import Camera, dense_speckle
from idic.laws import compile as compile_law
from idic.virtual_tests import (
    Sensor, clean_image, painted, record, strip_with_hole, write_images, write_inp, write_loads,
)

TIMES = np.concatenate([np.arange(6.0), [8.0, 11.0], np.arange(12.0, 15.0), [17.0, 20.0], [21.0, 22.0, 23.0]])
UP = np.array([0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.0, 1.0, 0.7, 0.4, 0.1, 0.1, 0.1, 0.5, 0.9, 1.2])
REVERSED = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.25, 1.25, 0.9, 0.5, 0.1, 0.1, 0.1, -0.3, -0.7, -1.1])
SUBSTEPS = 3


@dataclass(frozen=True)
class NullModel:
    """What the user believes: [material.BODY] with starts off the truth, grip motion (mm)."""

    table: str
    grip: np.ndarray


@dataclass(frozen=True)
class Truth:
    """What the body is made of; warmth : (n_frames,) free expansion on top."""

    law: str
    values: Mapping[str, float]
    null: str
    kinematics: str | None = None
    warmth: np.ndarray | None = None
    grip: float = 1.0  # factor of the null's motion
    found: frozenset = field(default_factory=frozenset)  # names that may stand first: the truth and exact twins


ELASTIC = NullModel("""law = "elastic"
E = { value = 1800, unit = "MPa", identify = true }
nu = { value = 0.3, identify = true }
""", 0.1 * UP)
HELD = NullModel("""law = "elastic"
E = { value = 1800, unit = "MPa", identify = true }
nu = 0.30
""", 0.1 * UP)
PLASTIC = NullModel("""law = "j2_linear"
E = { value = 1900, unit = "MPa", identify = true }
nu = { value = 0.33, identify = true }
yield_stress = { value = 28, unit = "MPa", identify = true }
hardening_modulus = { value = 250, unit = "MPa", identify = true }
""", 0.16 * REVERSED)
RUBBER = NullModel("""law = "neo_hookean"
C10 = { value = 0.35, unit = "MPa", identify = true }
kappa = { value = 15.0, unit = "MPa", identify = true }
""", 2.0 * UP)
PLY = NullModel("""law = "orthotropic"
E1 = { value = 5600, unit = "MPa", identify = true }
E2 = { value = 2100, unit = "MPa", identify = true }
nu12 = 0.3
G12 = { value = 750, unit = "MPa", identify = true }
angle = 20.0
""", 0.1 * UP)
NULLS = {"ply": PLY, "elastic": ELASTIC, "held": HELD, "plastic": PLASTIC, "rubber": RUBBER}
SHEET = "solved by laminate_sheet"

BODY = {"E": 2000.0, "nu": 0.35}
FLOW = BODY | {"yield_stress": 30.0, "hardening_modulus": 300.0}

LAMINATE = {"E1": 6000.0, "E2": 2000.0, "nu12": 0.3, "G12": 800.0, "angle": 20.0}

TRUTHS = {
    "clean": Truth("elastic", BODY, "elastic"),
    "plasticity": Truth("j2_linear", BODY | {"yield_stress": 33.0, "hardening_modulus": 400.0}, "elastic"),
    "damage": Truth("elastic_damage", BODY | {"threshold": 0.015, "softening": 15.0}, "elastic"),
    "nonlinear_elasticity": Truth("nonlinear_elastic", BODY | {"nonlinearity": 6.0}, "elastic"),
    "viscoelasticity": Truth("maxwell", BODY | {"g_1": 0.04, "tau_1": 5.0}, "elastic"),
    "creep": Truth("creep", BODY | {"rate": 4e-5, "n": 3.0, "stress": 30.0}, "elastic"),
    "rate_dependence": Truth("viscoplastic", BODY | {"yield_stress": 30.0, "hardening_modulus": 200.0, "eta": 4000.0,
                                                     "m": 1.0}, "elastic"),
    "orthotropy": Truth("orthotropic", {"E1": 2060.0, "E2": 1940.0, "nu12": 0.35, "G12": 741.0, "angle": 30.0},
                        "elastic"),
    "geometric_nonlinearity": Truth("elastic", BODY, "elastic", kinematics="finite"),
    "thermal_expansion": Truth("elastic", BODY, "elastic", warmth=2e-4 * TIMES / TIMES[-1]),
    "poisson_ratio": Truth("elastic", BODY, "held"),
    "clean_plastic": Truth("j2_linear", FLOW, "plastic"),
    "hardening_curvature": Truth("j2_voce", BODY | {"yield_stress": 30.0, "Q": 6.0, "b": 300.0,
                                                    "hardening_modulus": 150.0}, "plastic"),
    "kinematic_hardening": Truth("j2_kinematic", FLOW | {"hardening_modulus": 150.0, "C": 150.0, "gamma": 0.0},
                                 "plastic"),
    "pressure_dependence": Truth("j2_pressure", FLOW | {"friction": 0.15}, "plastic"),
    "anisotropic_yielding": Truth("j2_hill", FLOW | {"r0": 1.3, "r45": 0.9, "r90": 1.6}, "plastic"),
    "rate_dependence_of_flow": Truth("viscoplastic", FLOW | {"eta": 800.0, "m": 1.0}, "plastic"),
    "yield_plateau": Truth("elastoplastic(free5)", BODY | {
        "yield_stress": 30.0, "hardening_1_range": 0.024, "hardening_1_s2": 30.0, "hardening_1_s3": 30.0,
        "hardening_1_s4": 37.5, "hardening_1_s5": 48.0}, "plastic"),  # flat up to 0.006, then 1000 MPa
    "clean_ply": Truth(SHEET, LAMINATE, "ply"),
    "fibre_stiffening": Truth(SHEET, LAMINATE | {"stiffening": 8.0}, "ply"),
    "shear_nonlinearity": Truth(SHEET, LAMINATE | {"alpha": 3e-6}, "ply"),
    "shear_damage": Truth(SHEET, LAMINATE | {"g_0": 0.12}, "ply"),
    "clean_rubber": Truth("neo_hookean", {"C10": 0.4, "kappa": 20.0}, "rubber"),
    "second_invariant": Truth("mooney_rivlin", {"C10": 0.38, "C01": 0.02, "kappa": 20.0}, "rubber"),
    "viscoelasticity_of_rubber": Truth("maxwell", {"E": 2.35, "nu": 0.47, "g_1": 0.03, "tau_1": 5.0}, "rubber"),
}
NAMES = {"rate_dependence_of_flow": "rate_dependence", "viscoelasticity_of_rubber": "viscoelasticity"}

TOML = f"""
[experiment]
images = "images/*.tif"
loads = "loads.csv"
mesh = "mesh.inp"
kind = "plane_stress"
thickness_mm = {THICKNESS}

[camera]
pixel_size_mm = {PIXEL}
origin_px = [{ORIGIN[0]}, {ORIGIN[1]}]
noise_std_gv = {np.hypot(NOISE, 12**-0.5):.4f}

[material.BODY]
%s
[[boundary]]
nodes = "LEFT"
ux = 0.0
uy = 0.0

[[boundary]]
nodes = "RIGHT"
ux = {{ column = "grip_mm", noise_std = {GRIP_NOISE} }}
uy = 0.0

[[channel]]
column = "force_N"
simulated = {{ reaction = "RIGHT", component = "x" }}
noise_std = %s
"""


def expected(name: str) -> str:
    """The candidate that this truth is."""
    return NAMES.get(name, name)


def truth(name: str):
    """Motion and force without noise, on the fine mesh  # mesh, (n_frames, n_nodes, 2) mm, (n_frames,) N"""
    body = TRUTHS[name]
    mesh = strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", 6, 7, 5, name="BODY")
    if body.law == SHEET:
        return mesh, *laminate_sheet.solved(mesh, body.values, body.grip * NULLS[body.null].grip, THICKNESS)
    left, right = mesh.node_sets["LEFT"], mesh.node_sets["RIGHT"]
    dofs = np.concatenate([2 * right, 2 * right + 1, 2 * left, 2 * left + 1])
    basis = np.zeros((len(dofs), 1))
    basis[:len(right)] = 1.0
    law = compile_law(body.law, body.kinematics)
    given = body.values | ({} if body.warmth is None else {"alpha": 1.0})
    values = np.array([given.get(p.name, p.null) for p in law.spec.parameters], dtype=float)
    grip = body.grip * NULLS[body.null].grip
    heat = {}
    if body.warmth is not None:
        heat["temperature"] = np.tile(body.warmth[:, None], (1, mesh.n_nodes))
    model = Body(mesh=mesh, kind="plane_stress",
                  sections=(Section("BODY", law, mesh.element_sets["BODY"], **({"expansion": 1.0} if heat else {})),),
                  thickness=THICKNESS, constraints=Constraints(dofs, basis, grip[:, None]),
                  channels=(Reaction(2 * right),), **heat)
    states = [(s.u.copy(), s.channels[0]) for s in march(model, {"BODY": values}, TIMES, substeps=SUBSTEPS)]
    return mesh, np.array([u for u, _ in states]), np.array([f for _, f in states])


def write_folder(folder, name: str, seed: int = 0):
    """The experiment folder of a twin; returns its experiment.toml."""
    mesh, u, force = truth(name)
    camera = Camera.from_table(PIXEL, ORIGIN)
    texture = painted(dense_speckle(np.random.default_rng(7), 1.6, 30.0, 225.0, extent_px=400.0), camera)
    rng = np.random.default_rng(100 + seed)
    sensor, clean = Sensor(SHAPE, noise_std=NOISE, background=30.0), Sensor(SHAPE, background=30.0)
    folder.mkdir(parents=True)
    (folder / "images").mkdir()
    write_images(folder, (record(clean_image(moved, mesh.nodes, mesh.blocks, camera, texture, clean), sensor, rng)
                          for moved in u))
    noise = max(2e-3 * np.abs(force).max(), 1e-6)
    null = NULLS[TRUTHS[name].null]
    grip = TRUTHS[name].grip * null.grip + GRIP_NOISE * rng.standard_normal(len(TIMES)) * (TIMES > 0)
    write_loads(folder, TIMES, {"force_N": force + noise * rng.standard_normal(len(TIMES)), "grip_mm": grip})
    write_inp(strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", 3, 4, 3, name="BODY"), folder / "mesh.inp", "twin")
    (folder / "experiment.toml").write_text(TOML % (null.table, f"{noise:.6g}"))
    return folder / "experiment.toml"
