"""The displacement out of the plane of stereo exports as evidence: a thin plate that is bent, seen from its front.

The truth is solved on another, finer mesh than the model's, with its own numbers of elements along all edges.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from idic.correlation import build_point_map
from idic.experiment_file import load_experiment
from idic.identification import identify
from idic.model import build_forward, solve

LENGTH, WIDTH, THICKNESS = 20.0, 12.0, 0.4
E_TRUE, NU_TRUE, DEFLECTION = 70e3, 0.33, 0.12
N_STAGES, PLANE_UM, DEPTH_UM, FORCE_N = 6, 0.4, 0.8, 1e-3
TURN = np.radians(4.0)  # of the plate against the plane of the cameras, about y

EXPERIMENT = """
[experiment]
fields = "stages/*.csv"
loads = "loads.csv"
mesh = "plate.inp"
kind = "{kind}"
surface = "FRONT"
{more}
[camera]
axes = ["+x", "+y"]
[sets]
CLAMP = {{ where = "x < 1e-6" }}
MIDDLE = {{ where = "x < 1e-6 and y > 5.999999 and y < 6.000001" }}
REST = {{ where = "x < 1e-6 and z < 1e-6" }}
END = {{ where = "x > 19.999999 and z < 1e-6" }}
[material.PLATE]
law = "elastic"
E = {{ value = {E}, unit = "MPa", identify = true }}
nu = {{ value = {nu}, identify = true }}
[[boundary]]
nodes = "CLAMP"
ux = 0.0
[[boundary]]
nodes = "REST"
uz = 0.0
[[boundary]]
nodes = "MIDDLE"
uy = 0.0
[[boundary]]
nodes = "END"
uz = {{ column = "grip_mm" }}
[[channel]]
column = "force_N"
simulated = {{ reaction = "END", component = "z" }}
noise_std = 1e-3
[options]
element_order = "quadratic"
"""


def write_plate(file: Path, n: tuple[int, int, int]) -> None:
    """A plate of bricks, its front the face set FRONT at +z."""
    nx, ny, nz = n
    number = np.arange((nx + 1) * (ny + 1) * (nz + 1)).reshape(nx + 1, ny + 1, nz + 1) + 1
    sides = [np.linspace(0.0, size, k + 1) for size, k in zip((LENGTH, WIDTH, THICKNESS), n, strict=True)]
    at = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
    lines = ["*Node", *(f"{i}, {x:.9g}, {y:.9g}, {z:.9g}" for i, (x, y, z) in enumerate(at, 1)),
             "*Element, type=C3D8, elset=PLATE"]
    front = []
    for e, (i, j, k) in enumerate(np.ndindex(nx, ny, nz), 1):
        corners = [number[i + a, j + b, k + c] for c in (0, 1) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
        lines.append(", ".join(map(str, [e, *corners])))
        front += [e] if k == nz - 1 else []
    lines += ["*Elset, elset=OUTER", *(f"{e}," for e in front), "*Surface, type=ELEMENT, name=FRONT", "OUTER, S2"]
    file.write_text("\n".join(lines) + "\n")


def points() -> np.ndarray:
    """On the front  # (n, 2) mm"""
    x, y = np.meshgrid(np.arange(3.2, LENGTH - 3.0, 0.7), np.arange(0.5, WIDTH, 0.7))
    return np.column_stack([x.ravel(), y.ravel()])


def write_stages(folder: Path, fields: list[np.ndarray]) -> None:
    """As VIC-3D exports them, in the axes of the cameras: the plate is turned about y."""
    c, s = np.cos(TURN), np.sin(TURN)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    at = np.column_stack([points(), np.zeros(len(points()))]) @ turn.T
    (folder / "stages").mkdir(parents=True)
    for k, u in enumerate(fields):
        rows = [",".join(f"{value:.7f}" for value in row) + ",0.01" for row in np.hstack([at, u @ turn.T])]
        text = "\n".join(['"X","Y","Z","U","V","W","sigma"', *rows, ""])
        (folder / "stages" / f"stage_{k:02d}.csv").write_text(text)


def write_experiment(folder: Path, mesh: tuple[int, int, int], loads: list[tuple[float, float]], E: float, nu: float,
                     more: str = "", kind: str = "solid") -> None:
    write_plate(folder / "plate.inp", mesh)
    rows = [f"{k},{grip},{force}" for k, (grip, force) in enumerate(loads)]
    (folder / "loads.csv").write_text("\n".join(["frame,grip_mm,force_N", *rows, ""]))
    (folder / "experiment.toml").write_text(EXPERIMENT.format(kind=kind, more=more, E=E, nu=nu))


@pytest.fixture(scope="module")
def motion(tmp_path_factory) -> tuple[np.ndarray, float]:
    """Displacement of the points under the largest load (n, 3) mm, and the force (N)."""
    truth, at = tmp_path_factory.mktemp("truth"), points()
    write_stages(truth, [np.zeros((len(at), 3))] * 2)
    write_experiment(truth, (16, 10, 2), [(0.0, 0.0), (DEFLECTION, 0.0)], E_TRUE, NU_TRUE, "fields_noise_um = 1.0")
    there = load_experiment(truth)
    found = solve(build_forward(there), there.model.parameters)
    pm = build_point_map(there.model.mesh.nodes, there.model.mesh.surface_cells("FRONT"), there.model.camera,
                         there.recording.points.positions_px,
                         there.recording.points.shape)
    u = np.full((len(at), 3), np.nan)
    u[pm.point] = pm.interpolate(found.u[-1])
    assert np.isfinite(u).all()
    return u, float(found.channels[-1, 0])


def write_test(folder: Path, motion: tuple[np.ndarray, float], sway: np.ndarray) -> None:
    """Stages under growing load; sway : (n, 3) mm, of the whole plate, as often as the load goes up and down."""
    u, force = motion
    rng, shares = np.random.default_rng(5), np.linspace(0.0, 1.0, N_STAGES)
    noise = rng.normal(0.0, 1e-3, (N_STAGES, len(u), 3)) * [PLANE_UM, PLANE_UM, DEPTH_UM]
    moved = shares[:, None, None] * u + np.sin(9.0 * shares)[:, None, None] * sway
    write_stages(folder, list(moved + noise))
    forces = shares * force + rng.normal(0.0, FORCE_N, N_STAGES)
    write_experiment(folder, (10, 6, 1), list(zip(shares * DEFLECTION, forces, strict=True)), 60e3, 0.25)


@pytest.fixture(scope="module")
def bent(tmp_path_factory, motion) -> Path:
    folder = tmp_path_factory.mktemp("bent")
    write_test(folder, motion, np.zeros_like(motion[0]))
    return folder


def assert_true(entries: dict, most: float) -> None:
    """most : std over the value"""
    for name, truth in (("PLATE.E", E_TRUE), ("PLATE.nu", NU_TRUE)):
        entry = entries[name]
        assert abs(entry["value"] - truth) < 4.0 * entry["std"], name
        assert entry["std"] < most * truth, name


def test_bending_shows_the_parameters_out_of_the_plane(bent):
    experiment = load_experiment(bent)
    assert experiment.recording.points.depth.std_um == pytest.approx(DEPTH_UM,
                                                                     rel=0.1)  # 300 points, 4 stages: 3 % or so
    found = identify(experiment).result
    assert found["status"] == "converged" and "out of the plane is compared" in " ".join(experiment.notes)
    assert_true(found["parameters"], 0.08)
    alone = identify(replace(experiment, recording=replace(experiment.recording,
                                                           points=replace(experiment.recording.points,
                                                                          depth=None)))).result
    assert alone["parameters"]["PLATE.nu"]["std"] > 4.0 * found["parameters"]["PLATE.nu"]["std"]


def test_a_swaying_specimen_has_tilts_of_its_own_in_every_stage(bent, motion, tmp_path):
    at = points()
    sway = np.column_stack([np.full(len(at), 0.02), np.full(len(at), -0.01), 0.1 + 2e-3 * at[:, 0] - 1e-3 * at[:, 1]])
    write_test(tmp_path, motion, sway)
    file = tmp_path / "experiment.toml"
    file.write_text(file.read_text().replace("[camera]\n", '[camera]\nmotion = "free"\n'))
    assert_true(identify(load_experiment(tmp_path)).result["parameters"], 0.3)
