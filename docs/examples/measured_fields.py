"""Measured fields in the place of images: the points that another DIC system has exported.

The table stands for such an export: 300 points of a strip in nine stages, with noise of 0.5 µm.
"""

from pathlib import Path
from subprocess import run

import numpy as np

import idic

E, NU, WIDTH, LENGTH = 3000.0, 0.36, 8.0, 14.0  # MPa, mm; the truth
FILE = """
experiment = { fields = "fields.csv", loads = "loads.csv", kind = "plane_stress", thickness_mm = 2.0, mesh = "around" }
boundary = [{ nodes = "LEFT", u = "measured" }, { nodes = "RIGHT", u = "measured" }]
channel = [{ column = "force_N", simulated = { reaction = "RIGHT", component = "x" }, noise_std = 1.0 }]
[material.SPECIMEN]
law = "elastic"
E = { value = 2000, unit = "MPa", identify = true }
nu = { value = 0.3, identify = true }
""".replace('"around"', "{ around_points_mm = 0.5, element_mm = 2.0 }")
rng = np.random.default_rng(3)
x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(0.5, LENGTH - 0.5, 20), np.linspace(0.5, WIDTH - 0.5, 15)))
strain = np.linspace(0, 0.01, 9)

folder = Path("my-test")
folder.mkdir()
rows = [(stage, k, x[k], y[k], *(strain[stage] * np.array([x[k], -NU * y[k]]) + rng.normal(0, 5e-4, 2)))
        for stage in range(9) for k in range(x.size)]
np.savetxt(folder / "fields.csv", rows, "%.6g", ",", header="stage,id,x_mm,y_mm,ux_mm,uy_mm", comments="")
np.savetxt(folder / "loads.csv", E * strain * WIDTH * 2.0 + rng.normal(0, 1, 9), header="force_N", comments="")
(folder / "experiment.toml").write_text(FILE, encoding="utf-8")

run("idic check my-test --out measured_fields.png".split(), check=True)
print(idic.identify("my-test"))
