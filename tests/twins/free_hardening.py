"""Waisted strips whose hardening is none of idic's terms, or hidden: the truth on a mesh and with steps of its own."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from strip_twin import marched, pulled, strip_toml, write_recording, write_rest

from idic.fe import make_mesh
from idic.images import Camera
from idic.laws import LawParameter, LawSpec, all_laws, compile, register, tensors
from idic.laws.plasticity import elastoplastic
from idic.virtual_tests import Patch, mesh_patches

LENGTH, WIDTH, THICKNESS = 26.0, 16.0, 2.0  # mm
WAIST_SHARE, WAIST_LENGTH = 0.25, 7.0  # narrower by that share in the middle; mm
PIXEL, SHAPE = 0.16, (125, 190)
ORIGIN = ((SHAPE[1] - 1) / 2 - 1.7, (SHAPE[0] - 1) / 2 + 0.3)
CAMERA = Camera.from_table(pixel_size=PIXEL, origin=ORIGIN)
NOISE, FORCE_NOISE = 2.0, 5.0  # grey values of 255, N
SWIFT, VOCE, LUDWIK, LUEDERS = range(4)
FORMS = {  # MPa and -
    "swift": (SWIFT, 500.0, 0.01, 0.2, 0.0), "voce": (VOCE, 200.0, 120.0, 15.0, 0.0),
    "ludwik": (LUDWIK, 200.0, 350.0, 0.5, 0.0), "lueders": (LUEDERS, 250.0, 150.0, 8.0, 0.02),
}
GRIP = np.concatenate([np.linspace(0.0, 0.05, 4)[:-1], np.linspace(0.05, 0.12, 5)[:-1], np.linspace(0.12, 1.0, 9)])
USER, TRUE = (13, 6), (20, 8)  # elements along and across

TOML = strip_toml(PIXEL, ORIGIN, THICKNESS, FORCE_NOISE)
FREE = """
[material.sheet]
law = "elastoplastic"
E = { value = 60e3, unit = "MPa", identify = true }
nu = 0.3
yield_stress = { value = 170, unit = "MPa", identify = true }
hardening = [{ kind = "free", knots = KNOTS, range = RANGE }]
"""


def waisted(n: int, m: int):
    """A quad8 mesh of the strip; element set ``sheet``, node sets LEFT and RIGHT."""
    def shape(s, t):
        x = LENGTH * (s - 0.5)
        return x, WIDTH * (t - 0.5) * (1.0 - WAIST_SHARE * np.exp(-(x / WAIST_LENGTH) ** 2))

    nodes, cells = mesh_patches([Patch(shape, n, m)], "quad8")
    sides = {name: np.flatnonzero(np.abs(nodes[:, 0] - x) < 1e-6)
             for name, x in (("LEFT", -0.5 * LENGTH), ("RIGHT", 0.5 * LENGTH))}
    return make_mesh(nodes, [("quad8", cells)], node_sets=sides, element_sets={"sheet": np.arange(len(cells))})


@njit
def true_flow_stress(form, a, b, c, d, p):
    """(flow stress, its slope) at plastic strain p, real or complex."""
    if form == SWIFT:
        s = a * (b + p) ** c
        return s, c * s / (b + p)
    if form == LUDWIK:
        s = b * p ** c if p.real > 0.0 else 0.0 * p
        return a + s, c * s / p if p.real > 0.0 else 0.0 * p
    x = p - d if form == LUEDERS else p
    if x.real < 0.0:
        return a + 0.0 * p, 0.0 * p
    return a + b * (1.0 - np.exp(-c * x)), b * c * np.exp(-c * x)


def update(F, state, params, dt, P, state_new):
    """J2 plasticity with that flow stress: bisection on real parts, then two complex Newton steps."""
    G, kappa = elastoplastic.shear_and_bulk(params[0], params[1])
    J, fi, _, mean, dev, norm, shrink = elastoplastic.trial_state(F, state)
    if not J.real > 0.0:
        return 1
    form, a, b, c, d = int(params[2].real), params[3], params[4], params[5], params[6]
    p, keep, trial = state[6], 1.0 + 0.0 * J, norm * G * math.sqrt(1.5)
    for m in range(7):
        state_new[m] = state[m]
    if trial.real > true_flow_stress(form, a, b, c, d, p)[0].real:
        low, high = 0.0, (trial / (3.0 * G * mean)).real
        for _ in range(60):
            x = 0.5 * (low + high)
            beyond = trial - 3.0 * G * mean * x - true_flow_stress(form, a, b, c, d, p + x)[0]
            low, high = (x, high) if beyond.real > 0.0 else (low, x)
        growth = 0.5 * (low + high) + 0.0 * J
        for _ in range(2):
            flow, slope = true_flow_stress(form, a, b, c, d, p + growth)
            growth = growth + (trial - 3.0 * G * mean * growth - flow) / (3.0 * G * mean + slope).real
        keep = 1.0 - 3.0 * G * mean * growth / trial
        elastoplastic.cp_after(fi, keep, mean, dev, 1.0 / shrink, state_new)
        state_new[6] = p + growth
    tau = tensors.scaled(keep * G, dev, kappa * (J - 1.0) * J)
    tensors.store(tensors.times_transposed(tau, fi), P)
    return 0


def true_law():
    """The law of the truth, registered once."""
    if "true_curve" not in all_laws():
        names = ("E", "nu", "form", "a", "b", "c", "d")
        register(LawSpec("true_curve", tuple(LawParameter(name, "-", name) for name in names), {"finite": update},
                         state_names=elastoplastic.STATE_NAMES, reference="truth of a test"))
    return compile("true_curve")


@dataclass(frozen=True)
class Truth:
    """Motion of the true mesh (n_frames, n_nodes, 2) mm, force (n_frames,) N, plastic strain at its points at the
    end."""

    mesh: object
    u: np.ndarray
    force: np.ndarray
    plastic_strain: np.ndarray


def truth_of(form: str) -> Truth:
    """What really happens, with three increments per frame."""
    mesh, times = waisted(*TRUE), np.arange(len(GRIP), dtype=float)
    u, force, last = marched(pulled(mesh, "sheet", true_law(), GRIP, THICKNESS),
                             {"sheet": np.array([70e3, 0.3, *FORMS[form]])}, times, substeps=3)
    return Truth(mesh, u, force, np.concatenate([group.state[:, 6] for group in last.points]))


def write_folder(folder, truth: Truth, seed: int, material: str, grip: np.ndarray = GRIP, columns: dict | None = None,
                 elements: tuple[int, int] = USER):
    """The experiment of a user who does not know the form of the hardening; columns : more of the log."""
    rng = np.random.default_rng(50 + seed)
    noise = write_recording(folder, truth.mesh, truth.u, CAMERA, SHAPE, NOISE, rng, texture_px=300.0)
    force = truth.force + FORCE_NOISE * rng.standard_normal(len(truth.u))
    return write_rest(folder, waisted(*elements), TOML.replace("NOISE", f"{noise:.4f}", 1) + material,
                      np.arange(len(truth.u), dtype=float), {"force_N": force, "grip_mm": grip} | (columns or {}))
