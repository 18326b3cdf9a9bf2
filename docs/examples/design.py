"""Design before a test: which of two plans determines more?

Both plans pull the same composite plate by the same amount; the second plate has a hole. No image exists yet.
"""

import json
from pathlib import Path
from subprocess import run

import matplotlib.pyplot as plt

PLAN = """
experiment = { kind = "plane_stress", thickness_mm = 2.0, mesh = { roi_px = [10, 10, 150, 90], element_px = 10 HOLE } }
camera = { pixel_size_mm = 0.1 }
boundary = [{ nodes = "LEFT", ux = 0.0, uy = 0.0 }, { nodes = "RIGHT", ux = { column = "grip_mm" }, uy = 0.0 }]
channel = [{ column = "force_N", simulated = { reaction = "RIGHT", component = "x" }, noise_std = 1.0 }]
design = { image_px = [160, 100], n_frames = 10, noise_std_gv = 2.0, program.grip_mm = [[0, 0], [10, 0.1]] }
[material.SPECIMEN]
law = "orthotropic"
angle = 0.0
E1 = { value = 12e3, unit = "MPa", identify = true }
E2 = { value = 6e3, unit = "MPa", identify = true }
nu12 = { value = 0.3, identify = true }
G12 = { value = 2e3, unit = "MPa", identify = true }
"""
for name, hole in (("plain", ""), ("hole", ", holes_px = [[80, 50, 18]]")):
    Path(name).mkdir()
    Path(name, "experiment.toml").write_text(PLAN.replace(" HOLE", hole), encoding="utf-8")
run("idic design plain hole --out plans --workers 0".split(), check=True)

figure, axes = plt.subplots(figsize=(6, 3), layout="constrained")
for k, plan in enumerate(json.loads(Path("plans/design.json").read_text(encoding="utf-8"))["plans"]):
    std = {name: entry["relative_std"] for name, entry in plan["parameters"].items()}
    print(plan["name"], std)
    axes.bar([n + 0.4 * k for n in range(len(std))], [100 * (s or 0) for s in std.values()], 0.4, label=plan["name"])
axes.set(yscale="log", ylabel="expected std, %", xticks=[n + 0.2 for n in range(len(std))], xticklabels=list(std))
axes.legend()
figure.savefig("design.png", dpi=90)
