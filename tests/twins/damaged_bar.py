"""A bar that flows and loses stiffness, unloaded five times: the truth in closed form, no finite elements.

Uniform tension: the effective stress is uniaxial, its Kirchhoff stress q = yield_stress + H p while it flows, its
elastic stretches (a, l) follow from q = G J^(-2/3) (a^2 - l^2) and kappa (J - 1) J = q / 3, J = a l^2; the plastic ones
are e^p and e^(-p / 2). In tension Y = q^2 / (2 E), so that Lemaitre's damage is

    D(p) = [(yield_stress + H p)^(2 s + 1) - yield_stress^(2 s + 1)] / [(2 E S)^s (2 s + 1) H]

and the nominal stress (1 - D) q over the stretch.
"""

from __future__ import annotations

from pathlib import Path

import free_hardening as strip
import numpy as np
from relaxing_bar import straight
from scipy.optimize import fsolve
from strip_twin import strip_toml, write_recording, write_rest

from idic.laws import compile, point

TRUTH = {"E": 70e3, "nu": 0.3, "yield_stress": 200.0, "hardening_1_H": 3000.0, "damage_S": 0.35, "damage_s": 1.0}
COURSE = [(0.0, 0.0), (0.0, 0.4), (0.0, 0.8), (0.004, 1.0), (0.01, 1.0), (0.01, 0.5), (0.01, 0.05), (0.018, 1.0),
          (0.026, 1.0), (0.026, 0.5), (0.026, 0.05), (0.034, 1.0), (0.042, 1.0), (0.042, 0.5), (0.042, 0.05),
          (0.05, 1.0), (0.058, 1.0), (0.058, 0.5), (0.058, 0.05), (0.066, 1.0), (0.074, 1.0), (0.074, 0.5),
          (0.074, 0.05)]  # plastic strain, share of the flow stress
FORCE_NOISE = 5.0  # N, of 9000
SHORT = 16  # increments per frame whose error in time is small
USER, TRUE = (6, 4), (11, 7)
MATERIAL = """
[material.sheet]
law = "elastoplastic"
E = { value = 60e3, unit = "MPa", identify = true }
nu = { value = 0.33, identify = true }
yield_stress = { value = 170, unit = "MPa", identify = true }
hardening = [{ kind = "linear", H = { value = 2500, unit = "MPa", identify = true } }]
[material.sheet.damage]
kind = "lemaitre"
S = { value = 0.5, unit = "MPa", identify = true }
s = { value = 1.3, identify = true }
threshold = 0.0
length = 0.0
"""


def damage(p: float) -> float:
    """D in closed form."""
    t = TRUTH
    power = 2.0 * t["damage_s"] + 1.0
    grown = (t["yield_stress"] + t["hardening_1_H"] * p) ** power - t["yield_stress"] ** power
    return grown / ((2.0 * t["E"] * t["damage_S"]) ** t["damage_s"] * power * t["hardening_1_H"])


def stretches() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Axial and lateral stretch and nominal axial stress (MPa) of every frame."""
    t, rows = TRUTH, []
    G, kappa = t["E"] / (2.0 * (1.0 + t["nu"])), t["E"] / (3.0 * (1.0 - 2.0 * t["nu"]))
    for p, share in COURSE:
        q = share * (t["yield_stress"] + t["hardening_1_H"] * p)

        def missing(strain, q=q):
            a, side = 1.0 + strain
            J = a * side * side
            return [(G * J ** (-2.0 / 3.0) * (a * a - side * side) - q) / t["E"],
                    (kappa * (J - 1.0) * J - q / 3.0) / t["E"]]

        a, side = 1.0 + (fsolve(missing, np.array([q, -t["nu"] * q]) / t["E"], xtol=1e-10) if q > 0.0 else np.zeros(2))
        axial, lateral = a * np.exp(p), side * np.exp(-0.5 * p)
        rows.append((axial, lateral, (1.0 - damage(p)) * q / axial))
    return tuple(np.array(rows).T)


def fitted_to_the_law() -> dict[str, float]:
    """The parameters with which the law follows the true force best, all but nu.

    Its flow (Simo 1992: of the mean of the elastic tensor) is not exactly e^p: of these increments, however short, the
    stress differs by 0.5 MPa.
    """
    law, (axial, _, nominal) = compile("elastoplastic(linear+lemaitre)"), stretches()
    names, free = law.spec.parameter_names, [name for name in TRUTH if name != "nu"]
    values = np.array([TRUTH.get(name, 0.0) for name in names])
    at = [names.index(name) for name in free]
    frames = np.arange(len(axial))
    ends = np.linspace(0.0, frames[-1], SHORT * frames[-1] + 1)
    for _ in range(4):
        curve = point.uniaxial(law, values, np.interp(ends, frames, axial) - 1.0, mode=2)
        J = curve.dP[::SHORT, :, 0, 0][:, at] * values[at]
        step = np.linalg.lstsq(J, nominal - curve.P[::SHORT, 0, 0], rcond=None)[0]
        values[at] *= 1.0 + step
    return dict(zip(names, values, strict=True))


def write_folder(folder: Path, seed: int = 0) -> Path:
    """The experiment of a user who knows the terms, not their parameters."""
    mesh, (axial, lateral, nominal) = straight(*TRUE), stretches()
    from_corner = mesh.nodes - mesh.nodes[mesh.node_sets["CORNER"][0]]
    u = from_corner * np.column_stack([axial - 1.0, lateral - 1.0])[:, None, :]
    rng = np.random.default_rng(120 + seed)
    noise = write_recording(folder, mesh, u, strip.CAMERA, strip.SHAPE, strip.NOISE, rng, texture_px=300.0)
    force = nominal * strip.WIDTH * strip.THICKNESS + FORCE_NOISE * rng.standard_normal(len(nominal))
    text = strip_toml(strip.PIXEL, strip.ORIGIN, strip.THICKNESS, FORCE_NOISE).replace("NOISE", f"{noise:.4f}", 1)
    free_sides = text.replace("uy = 0.0\n", "") + '[[boundary]]\nnodes = "CORNER"\nuy = 0.0\n'
    return write_rest(folder, straight(*USER), free_sides + MATERIAL, np.arange(len(nominal), dtype=float),
                      {"force_N": force, "grip_mm": strip.LENGTH * (axial - 1.0)})
