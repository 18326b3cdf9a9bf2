"""A RUN folder and its result.json: what a script reads from a finished identification.

`idic simulate` stands for the laboratory: it paints the images of a planned test and writes its log.
"""

import json
from pathlib import Path
from subprocess import run

import matplotlib.pyplot as plt

PLAN = """
experiment = { kind = "plane_stress", thickness_mm = 2.0, mesh = { roi_px = [10, 10, 110, 60], element_px = 20 } }
camera = { pixel_size_mm = 0.1 }
boundary = [{ nodes = "LEFT", ux = 0.0, uy = 0.0 }, { nodes = "RIGHT", ux = { column = "grip_mm" }, uy = 0.0 }]
channel = [{ column = "force_N", simulated = { reaction = "RIGHT", component = "x" }, noise_std = 1.0 }]
design = { image_px = [120, 70], n_frames = 6, noise_std_gv = 2.0, program.grip_mm = [[0, 0], [6, 0.1]] }
[material.SPECIMEN]
law = "elastic"
E = { value = 3e3, unit = "MPa", identify = true }
nu = { value = 0.36, identify = true }
"""
Path("plan.toml").write_text(PLAN, encoding="utf-8")
run("idic simulate plan.toml --out my-test".split(), check=True)
run("idic identify my-test --out run --set SPECIMEN.E=2e3 --no-report --no-prefect --workers 0".split(), check=True)

result = json.loads(Path("run/result.json").read_text(encoding="utf-8"))
print(result["status"], "after", result["iterations"], "iterations;", len(result["notes"]), "notes")
for name, entry in result["parameters"].items():
    print(f"{name}: from {entry['start']:g} to {entry['value']:.5g} ± {entry['std']:.2g} {entry['unit']}")
frames = [(frame["frame"], frame["chi2_dof"]) for frame in result["frames"] if frame["chi2_dof"] is not None]
plt.figure(figsize=(6, 3), layout="constrained")
plt.plot(*zip(*frames, strict=True), "o-")
plt.axhline(1.0, color="grey", linestyle="--")
plt.gca().set(xlabel="frame", ylabel="chi2 per pixel", ylim=(0.8, 1.2), title="1: only noise is left")
plt.savefig("run_folder.png", dpi=90)
