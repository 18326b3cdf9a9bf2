"""Several tests of one material: two strips of a ply, cut along and across its fibres, identified together.

Each strip shows one stiffness. They share the material `ply`; each keeps its own direction.
"""

from subprocess import run

import matplotlib.pyplot as plt
import numpy as np

import idic

TRUTH = {"ply.E1": 12e3, "ply.E2": 6e3, "ply.nu12": 0.3}  # MPa
rng = np.random.default_rng(4)
kx, ky = rng.normal(0, 0.6, (2, 200, 1, 1))
phase, (row, column) = rng.uniform(0, 2 * np.pi, (200, 1, 1)), np.mgrid[:70.0, :110.0]


def strip(E, nu, angle):
    strain, start = np.linspace(0, 0.01, 5), {"value": 9e3, "unit": "MPa", "identify": True}
    grey = [np.cos(kx * column / (1 + e) + ky * row / (1 - nu * e) + phase).sum(0) for e in strain]
    grey = 128 + 3.5 * np.array(grey) + rng.normal(0, 2, (5, 70, 110))
    return idic.Experiment(
        images=np.clip(np.round(grey), 0, 255).astype(np.uint8), mesh={"roi_px": [10, 10, 100, 60], "element_px": 20},
        loads={"force_N": E * strain * 5.0 * 2.0}, kind="plane_stress", thickness_mm=2.0,
        camera={"pixel_size_mm": 0.1, "noise_std_gv": 2.0},
        boundaries=[{"nodes": side, "u": "measured"} for side in ("LEFT", "RIGHT")],
        materials={"ply": {"law": "orthotropic", "E1": start, "E2": start, "G12": 3000, "angle": angle,
                           "nu12": {"value": 0.2, "identify": True}}},
        channels=[{"column": "force_N", "simulated": {"reaction": "RIGHT", "component": "x"}, "noise_std": 2.0}])


strip(12e3, 0.3, 0).save("along")
strip(6e3, 0.15, 90).save("across")
run("idic identify along across --out both --no-report --no-prefect --workers 0".split(), check=True)
found = idic.load_result("both").parameters
ratios = [(found[name].value / truth, found[name].std / truth) for name, truth in TRUTH.items()]
plt.errorbar(list(TRUTH), [value for value, _ in ratios], [1.96 * std for _, std in ratios], fmt="o", capsize=6)
plt.ylabel("identified / true, with the 95 % interval")
plt.savefig("several_tests.png", dpi=90)
