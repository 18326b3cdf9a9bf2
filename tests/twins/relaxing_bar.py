"""A bar that relaxes by a kernel that is no sum of exponentials: the truth by convolution, no finite elements.

Quasi-linear viscoelasticity (Fung): with B = dev (J^(-2/3) b) of uniform tension and the bulk elastic,

    dev tau(t) = int G(t - s) dB(s),   mean tau = kappa (J - 1) J,   lateral stress zero.

The lateral stretch of every instant follows from the last row; the history is a sum over thousands of instants. At
small strain this is the body of ``maxwell`` with any G(t).
"""

from __future__ import annotations

from pathlib import Path

import free_hardening as strip
import numpy as np
from scipy.optimize import brentq
from strip_twin import strip_toml, write_recording, write_rest

from idic.fe import make_mesh
from idic.virtual_tests import Patch, mesh_patches

E, NU = 1000.0, 0.4  # MPa, of no time
KERNELS = {  # G(t) / G(0)
    "stretched": lambda t: 0.35 + 0.65 * np.exp(-((t / 15.0) ** 0.45)),
    "power": lambda t: (1.0 + t / 0.5) ** -0.16,
}
TIMES = np.array([0, 0.25, 0.5, 0.75, 1, 1.5, 2.5, 4, 7, 12, 20, 35, 60, 100, 100.5, 101, 102, 104, 108, 115, 130, 160,
                  220, 300])  # s
PULLED, BACK, FORCE_NOISE = 0.002, 0.001, 0.1  # strain from 0.5 s on, from 100.5 s on; N, of 60
FINE = 4000  # instants of the convolution
USER, TRUE = (13, 6), (20, 8)
MATERIAL = """
[material.sheet]
law = "free_relaxation"
E = { value = 800, unit = "MPa", identify = true }
nu = { value = 0.35, identify = true }
spectrum = { times = 12, shortest = 0.05, longest = 300 }
"""


def stretches(kernel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Axial and lateral stretch and nominal axial stress (MPa) at `TIMES`."""
    # instants crowd behind every corner of the course, where G(t - s) is steep
    parts = [a + (b - a) * np.linspace(0.0, 1.0, FINE // 4 + 1) ** 3 for a, b in ((0, 0.5), (0.5, 100), (100, 100.5),
                                                                             (100.5, 300))]
    t = np.unique(np.concatenate([*parts, TIMES]))
    axial = 1.0 + np.interp(t, [0.0, 0.5, 100.0, 100.5, 300.0], [0.0, PULLED, PULLED, BACK, BACK])
    G, kappa = E / (2.0 * (1.0 + NU)), E / (3.0 * (1.0 - 2.0 * NU))
    lateral, B, nominal = np.ones(len(t)), np.zeros(len(t)), np.zeros(len(t))  # B: axial, the lateral ones are -B / 2

    def strain(a, side):
        return 2.0 / 3.0 * (a * side * side) ** (-2.0 / 3.0) * (a * a - side * side)

    for n in range(1, len(t)):
        memory = G * kernel(t[n] - 0.5 * (t[:n] + t[1:n + 1]))  # of the increments of B, each in the middle of its time
        past = memory[:-1] @ np.diff(B[:n])

        def side_stress(side, a=axial[n], last=B[n - 1], now=memory[-1], past=past):
            J = a * side * side
            return kappa * (J - 1.0) * J - 0.5 * (past + now * (strain(a, side) - last))

        lateral[n] = brentq(side_stress, 0.99, 1.01, xtol=1e-14)
        B[n] = strain(axial[n], lateral[n])
        J = axial[n] * lateral[n] ** 2
        nominal[n] = (past + memory[-1] * (B[n] - B[n - 1]) + kappa * (J - 1.0) * J) / axial[n]
    at = np.searchsorted(t, TIMES)
    return axial[at], lateral[at], nominal[at]


def straight(n: int, m: int):
    """A quad8 mesh of the bar; node sets LEFT, RIGHT and CORNER, which is at their lower left."""
    nodes, cells = mesh_patches([Patch(lambda s, t: (strip.LENGTH * (s - 0.5), strip.WIDTH * (t - 0.5)), n, m)],
                                "quad8")
    sets = {name: np.flatnonzero(np.abs(nodes[:, 0] - x) < 1e-6)
            for name, x in (("LEFT", -0.5 * strip.LENGTH), ("RIGHT", 0.5 * strip.LENGTH))}
    sets["CORNER"] = sets["LEFT"][[np.argmin(nodes[sets["LEFT"], 1])]]
    return make_mesh(nodes, [("quad8", cells)], node_sets=sets, element_sets={"sheet": np.arange(len(cells))})


def write_folder(folder: Path, kernel: str, seed: int = 0, material: str = MATERIAL) -> Path:
    """The experiment of a user who was told nothing of the kernel."""
    mesh, (axial, lateral, nominal) = straight(*TRUE), stretches(KERNELS[kernel])
    from_corner = mesh.nodes - mesh.nodes[mesh.node_sets["CORNER"][0]]
    u = from_corner * np.column_stack([axial - 1.0, lateral - 1.0])[:, None, :]
    rng = np.random.default_rng(90 + seed)
    noise = write_recording(folder, mesh, u, strip.CAMERA, strip.SHAPE, strip.NOISE, rng, texture_px=300.0)
    force = nominal * strip.WIDTH * strip.THICKNESS + FORCE_NOISE * rng.standard_normal(len(nominal))
    text = strip_toml(strip.PIXEL, strip.ORIGIN, strip.THICKNESS, FORCE_NOISE).replace("NOISE", f"{noise:.4f}", 1)
    free_sides = text.replace("uy = 0.0\n", "") + '[[boundary]]\nnodes = "CORNER"\nuy = 0.0\n'
    return write_rest(folder, straight(*USER), free_sides + material, TIMES,
                      {"force_N": force, "grip_mm": strip.LENGTH * (axial - 1.0)})
