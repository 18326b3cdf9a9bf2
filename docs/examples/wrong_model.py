"""A failure: the law lacks a physics. The strip yields; the user believes that it is elastic.

The residual says so: chi2 per pixel and the force. `idic diagnose` says what is missing.
"""

from subprocess import run

import numpy as np

import idic

E, NU, YIELD, H = 3000.0, 0.30, 30.0, 600.0  # MPa; the truth: linear hardening
rng = np.random.default_rng(8)
kx, ky = rng.normal(0, 0.6, (2, 200, 1, 1))
phase, (row, column) = rng.uniform(0, 2 * np.pi, (200, 1, 1)), np.mgrid[:70.0, :110.0]
grip = np.array([0, 3, 6, 9, 11, 13, 10, 7]) * 1e-3
plastic = np.maximum.accumulate(np.maximum(0, (E * grip - YIELD) / (E + H)))
stress = E * (grip - plastic)
across = -NU * stress / E - 0.5 * plastic
grey = [np.cos(kx * column / (1 + a) + ky * row / (1 + b) + phase).sum(0) for a, b in zip(grip, across, strict=True)]
grey = 128 + 3.5 * np.array(grey) + rng.normal(0, 2, (8, 70, 110))
strip = idic.Experiment(
    images=np.clip(np.round(grey), 0, 255).astype(np.uint8), mesh={"roi_px": [10, 10, 100, 60], "element_px": 20},
    loads={"force_N": stress * 5.0 * 2.0}, kind="plane_stress", thickness_mm=2.0,
    camera={"pixel_size_mm": 0.1, "noise_std_gv": 2.0},
    boundaries=[{"nodes": "LEFT", "u": "measured"}, {"nodes": "RIGHT", "u": "measured"}],
    materials={"sheet": {"law": "elastic", "E": {"value": 2000, "unit": "MPa", "identify": True},
                         "nu": {"value": 0.3, "identify": True}}},
    channels=[{"column": "force_N", "simulated": {"reaction": "RIGHT", "component": "x"}, "noise_std": 1.0}])
strip.save("my-test")
run("idic identify my-test --out run --no-report --no-prefect --workers 0".split(), check=True)
result = idic.load_result("run")
result.plot.channels().savefig("wrong_model.png", dpi=90)
run("idic diagnose run --quick --no-prefect --workers 0".split(), check=True)
