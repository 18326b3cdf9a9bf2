"""A plate with a hole that loses stiffness as it flows, by CalculiX, which has no damage.

CalculiX takes modulus and flow stress from tables over the temperature. With (1 - D) of both at the temperature D its
stress is (1 - D) times that of the undamaged body, whose elastic and plastic strains it keeps: strain equivalence. D
at its integration points is integrated here, from the stresses and plastic strains that it prints, over its whole
course; the course of D goes back as a temperature, until both agree (a Picard iteration of the course, which a
simulation by idic starts: where it ends it does not decide).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import plate_by_calculix as calculix
from scipy.sparse import csc_array, eye_array
from scipy.sparse.linalg import splu
from strip_twin import pulled

from idic.fe.march import march
from idic.fe.mesh.element import quadrature
from idic.materials import compile

TRUTH = {"E": 70e3, "nu": 0.3, "yield_stress": 200.0, "hardening_1_H": 3000.0, "damage_S": 0.35, "damage_s": 1.0}
GRIP = np.array([0.0, 0.04, 0.08, 0.12, 0.09, 0.06, 0.13, 0.18, 0.23, 0.19, 0.15, 0.24, 0.30, 0.36, 0.29, 0.22, 0.15])
TIMES = np.arange(len(GRIP), dtype=float)
INCREMENTS, ROUNDS, MOST = 2, 8, 0.9
AGREED, BETWEEN = 1e-3, 3e-3  # of D: between two rounds; of its points, from what nodes can tell
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
"""


def card() -> str:
    """The material of CalculiX; its temperature is D."""
    t, rows = TRUTH, (0.0, MOST)
    return ("*ELASTIC\n" + "".join(f"{(1 - d) * t['E']:.9g}, {t['nu']}, {d}\n" for d in rows) + "*PLASTIC\n"
            + "".join(calculix.table((1 - d) * t["yield_stress"], (1 - d) * t["hardening_1_H"], f", {d}")
                      for d in rows))


def grown(stress: np.ndarray, p: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Course of D from the course of stress (m, k, 6) MPa and plastic strain (m, k) of points damaged by `d` (m, k)."""
    t = TRUTH
    effective = stress / (1.0 - d)[..., None]
    mean = effective[..., :3].mean(-1)
    q = mises(effective)
    ratio = mean / np.maximum(q, 1e-9)
    Y = q**2 / (2.0 * t["E"]) * (2.0 / 3.0 * (1.0 + t["nu"]) + 3.0 * (1.0 - 2.0 * t["nu"]) * ratio**2)
    open_share = np.clip(1.0 + 3.0 * ratio, 0.0, 1.0)
    rate = (Y / t["damage_S"]) ** t["damage_s"] * open_share**2 * (3.0 - 2.0 * open_share)
    steps = np.maximum(np.diff(p, axis=0), 0.0) * 0.5 * (rate[1:] + np.where(p[:-1] > 0.0, rate[:-1], rate[1:]))
    return np.vstack([np.zeros_like(p[:1]), np.cumsum(steps, axis=0)])


def mises(stress: np.ndarray) -> np.ndarray:
    """Of (..., 6) xx, yy, zz, xy, xz, yz."""
    deviator = stress[..., :3] - stress[..., :3].mean(-1, keepdims=True)
    return np.sqrt(1.5 * (deviator**2).sum(-1) + 3.0 * (stress[..., 3:] ** 2).sum(-1))


def interpolation(mesh, places=None) -> csc_array:
    """Values at the four points of every eight-node element, or at `places` (m, 2) of it, from those at the nodes.

    Returns (m n, n_nodes).
    """
    g = 3.0**-0.5
    places = np.array([[-g, -g], [g, -g], [-g, g], [g, g]]) if places is None else places
    xi, eta = places.T[:, :, None]
    a, b = np.array([-1, 1, 1, -1]), np.array([-1, -1, 1, 1])
    corners = 0.25 * (1 + a * xi) * (1 + b * eta) * (a * xi + b * eta - 1)
    sides = 0.5 * np.hstack([(1 - xi**2) * (1 - eta), (1 - eta**2) * (1 + xi), (1 - xi**2) * (1 + eta),
                             (1 - eta**2) * (1 - xi)])
    (block,) = mesh.blocks
    cells, N = block.connectivity, np.hstack([corners, sides])
    rows = np.arange(len(N) * len(cells)).reshape(-1, len(N), 1) + np.zeros((1, 1, 8), dtype=int)
    columns = np.broadcast_to(cells[:, None, :], rows.shape)
    values = np.broadcast_to(N, rows.shape)
    return csc_array((values.ravel(), (rows.ravel(), columns.ravel())), shape=(len(N) * len(cells), mesh.n_nodes))


def to_nodes(N: csc_array, values: np.ndarray) -> np.ndarray:
    """The nodal values (m, n_nodes) whose interpolation by N (k, n_nodes) is nearest to `values` (m, k)."""
    normal = splu((N.T @ N + 1e-6 * eye_array(N.shape[1])).tocsc())
    return normal.solve(np.ascontiguousarray((values @ N).T)).T


def predicted(mesh, ends) -> np.ndarray:
    """D at the nodes by a simulation with the law of idic  # (n_ends, n_nodes)"""
    law = compile("elastoplastic(linear+lemaitre)")
    model = pulled(mesh, "sheet", law, np.interp(ends, TIMES, GRIP), calculix.plate.THICKNESS)
    values, d = np.array([*TRUTH.values(), 0.0, 0.0]), []  # no threshold, no length
    place = law.spec.state_names.index("damage")
    for state in march(model, {"sheet": values}, ends):
        d.append(state.points[0].state[:, place])
    return np.maximum(to_nodes(interpolation(mesh, quadrature("quad8")[0]), np.array(d)), 0.0)


def printed(file: Path, n_elements: int):
    """Stress (m, 4 n, 6) MPa and plastic strain (m, 4 n) at the points of one layer, at the end of every increment."""
    found = {"stresses": [np.zeros((n_elements, 8, 6))], "equivalent": [np.zeros((n_elements, 8, 1))]}
    block = ""
    for row in (line.split() for line in file.read_text().splitlines()):
        if row and row[0][0].isalpha():
            block = row[0]
            if block in found:
                found[block].append(np.zeros_like(found[block][0]))
        elif row and block in found:
            found[block][-1][int(row[0]) - 1, int(row[1]) - 1] = [float(x) for x in row[2:]]
    stress, p = (np.array(found[name])[:, :, :4] for name in ("stresses", "equivalent"))
    return stress.reshape(len(stress), -1, 6), p.reshape(len(p), -1)


def truth_by_calculix(folder: Path, told=lambda text, nodal: print(text), start: np.ndarray | None = None):
    """Mesh, motion (n_frames, n_nodes, 2) mm, force (n_frames,) N and D at its points in every frame (n_frames, k).

    start : D at the nodes to begin with, of every end of an increment; `told` is given it after every round
    """
    mesh, ends = calculix.mesh_of(folder), calculix.ends_of(TIMES, INCREMENTS, GRIP)
    N = interpolation(mesh)
    nodal = predicted(mesh, ends) if start is None else start
    last = nodal @ N.T
    for _ in range(ROUNDS):
        d = nodal @ N.T
        before = "".join(f"*AMPLITUDE, NAME=D{k + 1}, TIME=TOTAL TIME\n{calculix.course(ends, nodal[:, k])}\n"
                         for k in range(mesh.n_nodes)) + "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nALL, 0\n"
        loads = "".join(f"*TEMPERATURE, AMPLITUDE=D{k + 1}\n{k + 1}, 1\n" for k in range(mesh.n_nodes))
        _, u, force = calculix.truth_by_calculix(
            folder, card(), TIMES, GRIP, INCREMENTS, before=before, loads=loads,
            prints="*EL PRINT, ELSET=sheet, TIME POINTS=ENDS\nS, PEEQ\n")
        stress, p = printed(folder / "plate.dat", len(mesh.blocks[0].connectivity))
        new = grown(stress, p, d)
        error, between, last = np.abs(new - last).max(), np.abs(new - d).max(), new
        nodal = to_nodes(N, new)
        told(f"D to {new.max():.3f}, {error:.1e} from the last, {between:.1e} from that of its nodes; flow stress kept "
             f"within {flow_error(stress, p, d):.1e}", nodal)
        if error < AGREED:
            assert between < BETWEEN
            return mesh, u, force, d[np.searchsorted(ends, TIMES)]
    raise AssertionError("stress and damage do not agree")


def flow_error(stress, p, d) -> float:
    """Largest difference of the Mises stress from (1 - D) (yield stress + H p) where p grows, over the latter."""
    expected = (1.0 - d) * (TRUTH["yield_stress"] + TRUTH["hardening_1_H"] * p)
    flowing = np.diff(p, axis=0, prepend=0.0) > 1e-4
    return float(np.abs(mises(stress) / expected - 1.0)[flowing].max())


def write_folder(folder: Path, truth, seed: int = 0) -> Path:
    """The experiment of a user with a mesh of his own."""
    return calculix.write_folder(folder, truth[:3], MATERIAL, TIMES, GRIP, seed)
