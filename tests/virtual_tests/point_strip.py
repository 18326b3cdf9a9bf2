"""A strip in tension as another DIC exports it: 300 points in four stages, with forces."""

from __future__ import annotations

from pathlib import Path

import numpy as np

E, NU, WIDTH, HEIGHT, THICKNESS = 70e3, 0.3, 12.0, 36.0, 2.0  # MPa, mm
N_POINTS, N_STAGES = 300, 4

TOML = """[experiment]
fields = "stages/*.csv"
mesh = { around_points_mm = 0.6, element_mm = 4 }
kind = "plane_stress"
thickness_mm = 2.0
[material.sheet]
law = "elastic"
E = { value = 50, unit = "GPa", identify = true }
nu = 0.3
[[boundary]]
nodes = "BOTTOM"
BOTTOM_MOTION
[[boundary]]
nodes = "TOP"
TOP_MOTION
[[channel]]
column = "force"
simulated = { reaction = "TOP", component = "y" }
noise_std = 3.0
"""


def write_point_strip(folder: Path, bottom: str = 'u = "measured"', top: str = 'u = "measured"') -> Path:
    """The experiment folder; bottom, top : motions of the ends as experiment.toml writes them."""
    (folder / "stages").mkdir(parents=True)
    rng = np.random.default_rng(7)
    x, y = np.meshgrid(np.arange(0.6, WIDTH, 1.2), np.arange(0.6, HEIGHT, 1.2))
    points = np.column_stack([x.ravel(), y.ravel()])  # (N_POINTS, 2)
    for k in range(N_STAGES):
        strain = 4e-4 * k
        force = E * strain * WIDTH * THICKNESS + rng.normal(0.0, 3.0)
        at = points + strain * points * [-NU, 1.0] + rng.normal(0.0, 5e-4, points.shape)
        lines = ["# Units: length:mm angle:deg time:s force:N", f"# Stage: {k}", "stage;index;relative_time;date",
                 f'"{k}";{k};{k}.0;"now"', "# Name : Analog 0", "force;untransformed;transformed",
                 f"{force:.4f};0;{force:.4f}", "# Name : Surface 1", "id;x;y;z",
                 *(f"{i};{a:.5f};{b:.5f};0.0" for i, (a, b) in enumerate(at))]
        (folder / "stages" / f"stage_{k:03d}.csv").write_text("\n".join(lines), encoding="utf-8")
    (folder / "experiment.toml").write_text(TOML.replace("BOTTOM_MOTION", bottom).replace("TOP_MOTION", top),
                                            encoding="utf-8")
    return folder
