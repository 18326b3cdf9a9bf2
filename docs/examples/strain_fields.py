"""Strain fields of a run: measured from the images alone, simulated with the identified law, and the difference.

`idic simulate` stands for the laboratory: it paints the images of a planned test, a strip with a hole.
"""

from pathlib import Path
from subprocess import run

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.tri import Triangulation

import idic

PLAN = """
experiment = { kind = "plane_stress", thickness_mm = 2.0, mesh = { roi_px = [10, 10, 150, 90], element_px = 10 HOLE } }
camera = { pixel_size_mm = 0.1 }
boundary = [{ nodes = "LEFT", ux = 0.0, uy = 0.0 }, { nodes = "RIGHT", ux = { column = "grip_mm" }, uy = 0.0 }]
channel = [{ column = "force_N", simulated = { reaction = "RIGHT", component = "x" }, noise_std = 1.0 }]
design = { image_px = [160, 100], n_frames = 4, noise_std_gv = 1.0, program.grip_mm = [[0, 0], [4, 0.2]] }
[material.SPECIMEN]
law = "elastic"
E = { value = 3e3, unit = "MPa", identify = true }
nu = { value = 0.36, identify = true }
""".replace(" HOLE", ", holes_px = [[80, 50, 18]]")
Path("plan.toml").write_text(PLAN, encoding="utf-8")
run("idic simulate plan.toml --out my-test".split(), check=True)
result = idic.identify("my-test")
print(result)

data = result.to_xarray([-1], residual=False, measured=True).isel(frame=0).sel(strain_component="xx")
tiles = Triangulation(data.x, data.y)
tiles.set_mask(np.hypot(data.x.values[tiles.triangles].mean(1) - 8, data.y.values[tiles.triangles].mean(1) - 5) < 1.8)
fields = {"measured": data.strain_measured, "simulated": data.strain, "difference": data.strain_measured - data.strain}
figure, axes = plt.subplots(1, 3, figsize=(11, 2.6), layout="constrained")
for axis, (title, field) in zip(axes, fields.items(), strict=True):
    figure.colorbar(axis.tricontourf(tiles, 100 * field, 20), ax=axis)
    axis.set(title=f"strain xx, %, {title}", aspect="equal", xlabel="x, mm")
figure.savefig("strain_fields.png", dpi=90)
