"""Measured fields: 900 stages of 2700 points, an orthotropic law with four parameters; memory with 100 and with 900 stages.

The displacements of all 900 stages together are 19 MB, their text 90 MB. CPU time is that of the whole command, from the
files to the report, with six iterations: tests that determine their parameters take four to six. This one, under uniform
stress, does not determine all four, and would go on along the weak direction.
"""

import os
import subprocess
import sys

import numpy as np
import pytest

pytestmark = [pytest.mark.bench, pytest.mark.slow]

FEW, MANY, COLUMNS, ROWS = 100, 900, 27, 100
ITERATIONS = 6
GROWTH = 1.15

EXPERIMENT = """
[experiment]
fields = "stages/*.csv"
mesh = { around_points_mm = [0.5, 0.5], element_mm = 4.5 }
kind = "plane_stress"
thickness_mm = 2.0
[material.PLY]
law = "orthotropic"
E1 = { value = 50e3, unit = "MPa", identify = true }
E2 = { value = 25e3, unit = "MPa", identify = true }
nu12 = { value = 0.15, identify = true, prior = { mean = 0.15, std = 0.05 } }
G12 = { value = 5e3, unit = "MPa", identify = true }
angle = 60.0
[[boundary]]
nodes = "TOP"
u = "measured"
[[boundary]]
nodes = "BOTTOM"
u = "measured"
[[channel]]
column = "force"
simulated = { reaction = "TOP", component = "y" }
"""


def write(folder, n: int) -> None:
    """An off-axis strip under uniform stress: its motion is affine."""
    rng = np.random.default_rng(1)
    c, s = np.cos(np.radians(60.0)), np.sin(np.radians(60.0))
    turn = np.array([[c * c, s * s, 2 * c * s], [s * s, c * c, -2 * c * s], [-c * s, c * s, c * c - s * s]])
    law = np.array([[1 / 60e3, -0.15 / 60e3, 0], [-0.15 / 60e3, 1 / 20e3, 0], [0, 0, 1 / 4e3]])
    xx, yy, xy = turn.T @ law @ turn @ [0.0, 1.0, 0.0]
    x, y = np.meshgrid(np.arange(COLUMNS) + 0.5, np.arange(ROWS) + 0.5)
    points = np.column_stack([x.ravel(), y.ravel()])
    (folder / "stages").mkdir(parents=True)
    ids = np.arange(len(points))
    for k in range(n):
        stress = 120.0 * k / (n - 1)
        at = points + stress * points @ np.array([[xx, 0.5 * xy], [0.5 * xy, yy]]) + rng.normal(0.0, 5e-4, points.shape)
        force = stress * COLUMNS * 2.0 + rng.normal(0.0, 5.0)
        head = ["# Units: length:mm angle:deg time:s force:N", f"# Stage: {k}", "stage;index;relative_time;date",
                f'"{k}";{k};{k}.0;"now"', "# Name : Analog 0", "force;untransformed;transformed", f"{force:.4f};0;{force:.4f}",
                "# Name : Surface 1", "id;x;y;z"]
        rows = [f"{i};{a:.6f};{b:.6f};0.000000" for i, a, b in zip(ids.tolist(), *at.T.tolist(), strict=True)]
        (folder / "stages" / f"stage_{k:04d}.csv").write_text("\n".join([*head, *rows]))
    (folder / "experiment.toml").write_text(EXPERIMENT)


def run(folder, out) -> tuple[float, float]:
    """CPU time (s) and largest resident memory (MB) of the command."""
    process = subprocess.Popen([sys.executable, "-m", "idic", "identify", str(folder), "--out", str(out), "--workers", "0",
                                "--set", f"options.max_iterations={ITERATIONS}"],
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    assert os.waitstatus_to_exitcode(status) in (0, 3)  # 3: stopped after the iterations
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024.0


def test_nine_hundred_stages_take_no_more_memory_than_a_hundred(tmp_path, measured):
    found = {}
    for n in (FEW, MANY):
        write(tmp_path / str(n), n)
        found[n] = run(tmp_path / str(n), tmp_path / f"run_{n}")
    measured(f"measured fields, {MANY} stages of {COLUMNS * ROWS} points, orthotropic, 4 parameters",
             f"{found[MANY][0]:.0f} CPU s, {found[MANY][1]:.0f} MB", f"{FEW} stages: {found[FEW][0]:.0f} CPU s, {found[FEW][1]:.0f} MB")
    assert found[MANY][1] < GROWTH * found[FEW][1]
