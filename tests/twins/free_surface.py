"""A sheet with Hill's or Hosford's yield surface, pulled and then sheared, as a user who knows no form of it has it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from free_hardening import waisted
from hosford import NAMES, hosford, hosford_law
from strip_twin import strip_toml, write_recording, write_rest

from idic.fe import Constraints, Body, Reaction, Section, march
from idic.images import Camera
from idic.laws import compile, equivalent
from idic.laws.free_forms.surface_forms import hill48
from idic.report.evidence.yield_surface import std_of

THICKNESS, PIXEL, SHAPE = 2.0, 0.16, (150, 200)  # mm, mm, px
ORIGIN = ((SHAPE[1] - 1) / 2 - 2.7, (SHAPE[0] - 1) / 2 - 4.7)
CAMERA = Camera.from_table(pixel_size=PIXEL, origin=ORIGIN)
NOISE, FORCE_NOISE = 2.0, 5.0  # grey values of 255, N
USER, TRUE = (8, 4), (14, 6)  # elements along and across
ANGLE = 30.0  # deg, of the rolling direction
TRUTH = {"E": 70e3, "nu": 0.3, "yield_stress": 200.0, "Q": 80.0, "b": 15.0, "hardening_modulus": 500.0, "r0": 1.6,
         "r45": 1.2, "r90": 2.0, "angle": ANGLE}
PULL = np.concatenate([np.linspace(0.0, 0.08, 3)[:-1], np.linspace(0.08, 0.7, 4), np.full(8, 0.7)])  # mm
SHEAR = np.concatenate([np.zeros(6), [0.1, 0.4, 0.9, 1.4, 1.2, 0.6, -0.2, -1.0]])

FREE = f"""
[material.sheet]
law = "elastoplastic"
E = {{ value = 70e3, unit = "MPa", identify = true }}
nu = 0.3
yield_stress = {{ value = 180, unit = "MPa", identify = true }}
yield_surface = {{ kind = "free_surface", knots = 6, angle = {ANGLE} }}
hardening = [{{ kind = "voce", Q = {{ value = 60, identify = true }}, b = {{ value = 12, identify = true }} }},
             {{ kind = "linear", H = {{ value = 400, identify = true }} }}]
[options]
substeps = 1
"""


# law, names of its parameters in TRUTH, equivalent stress of plane stresses 11, 22, 12 in material axes
SURFACES = {
    "hill48": (lambda: compile("j2_hill"), None, lambda s: hill48(s, *(TRUTH[name] for name in ("r0", "r45", "r90")))),
    "hosford": (hosford_law, NAMES, hosford),
}


@dataclass(frozen=True)
class Truth:
    """What really happens.

    surface : key of `SURFACES`; u : motion of the true mesh (n_frames, n_nodes, 2) mm; force : (n_frames, 2) N
    flowing : stress (m, 3) in material axes where it flows, all frames
    """

    surface: str
    mesh: object
    u: np.ndarray
    force: np.ndarray
    flowing: np.ndarray


def truth_of(surface: str = "hill48") -> Truth:
    """What really happens, with one increment per frame, as the user has it."""
    mesh = waisted(*TRUE)
    left, right = mesh.node_sets["LEFT"], mesh.node_sets["RIGHT"]
    dofs = np.concatenate([2 * right, 2 * right + 1, 2 * left, 2 * left + 1])
    shape = np.zeros((len(dofs), 2))
    shape[:len(right), 0] = 1.0
    shape[len(right):2 * len(right), 1] = 1.0
    make, names, _ = SURFACES[surface]
    law = make()
    model = Body(mesh=mesh, kind="plane_stress", thickness=THICKNESS, channels=(Reaction(2 * right),
                                                                               Reaction(2 * right + 1)),
                  sections=(Section("sheet", law, mesh.element_sets["sheet"]),),
                  constraints=Constraints(dofs, shape, np.column_stack([PULL, SHEAR])))
    values = {"sheet": np.array([TRUTH[name] for name in names or law.spec.parameter_names])}
    u, force, flowing, before = [], [], [], None
    for state in march(model, values, np.arange(len(PULL), dtype=float), substeps=1):
        u.append(state.u.copy())
        force.append(state.channels.copy())
        p = np.concatenate([group.state[:, 6] for group in state.points])
        stress = np.concatenate([group.P for group in state.points])
        if before is not None:
            flowing.append(in_axes(stress[p > before + 1e-5]))
        before = p
    return Truth(surface, mesh, np.array(u), np.array(force), np.concatenate(flowing))


def in_axes(stress: np.ndarray, angle: float = ANGLE) -> np.ndarray:
    """11, 22, 12 of stresses (m, 2, 2) in material axes  # (m, 3)"""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    Q = np.array([[c, s], [-s, c]])
    turned = Q @ (0.5 * (stress + stress.transpose(0, 2, 1))) @ Q.T
    return turned[:, [0, 1, 0], [0, 1, 1]]


def radius_errors(truth: Truth, start_and_weights: np.ndarray, covariance: np.ndarray):
    """(relative error of the radius, its std of noise, its std with what the family misses) where the truth flows."""
    stress = truth.flowing[::max(1, len(truth.flowing) // 1500)]
    start, weights = start_and_weights[0], start_and_weights[1:]
    q, dq = equivalent(weights, stress)
    expected = TRUTH["yield_stress"] / SURFACES[truth.surface][2](stress)
    J = np.column_stack([1.0 / q, -start / (q * q)[:, None] * dq])
    own = J @ covariance @ J.T
    return (start / q) / expected - 1.0, np.sqrt(np.diag(own)) / expected, std_of(start / q, own) / expected


def write_folder(folder, truth: Truth, seed: int):
    """The experiment of the user."""
    rng = np.random.default_rng(70 + seed)
    noise = write_recording(folder, truth.mesh, truth.u, CAMERA, SHAPE, NOISE, rng, texture_px=400.0)
    force = truth.force + FORCE_NOISE * rng.standard_normal(truth.force.shape)
    toml = strip_toml(PIXEL, ORIGIN, THICKNESS, FORCE_NOISE).replace("NOISE", f"{noise:.4f}", 1)
    pulled = 'ux = { column = "grip_mm" }\nuy = '
    toml = toml.replace(pulled + "0.0", pulled + '{ column = "side_mm" }')
    toml += f"""[[channel]]
column = "side_N"
simulated = {{ reaction = "RIGHT", component = "y" }}
noise_std = {FORCE_NOISE}
"""
    return write_rest(folder, waisted(*USER), toml + FREE, np.arange(len(truth.u), dtype=float),
                      {"force_N": force[:, 0], "side_N": force[:, 1], "grip_mm": PULL, "side_mm": SHEAR})
