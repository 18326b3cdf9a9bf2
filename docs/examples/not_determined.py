"""A failure: parameters that the test does not determine. No force is recorded, or the thickness is asked for as well.

idic names each of them with the reason, gives it no error bar, and identifies the others.
"""

import matplotlib.pyplot as plt
import numpy as np

import idic

rng = np.random.default_rng(7)
kx, ky = rng.normal(0, 0.6, (2, 200, 1, 1))
phase, (row, column) = rng.uniform(0, 2 * np.pi, (200, 1, 1)), np.mgrid[:70.0, :110.0]
strain = np.linspace(0, 0.01, 5)
grey = [np.cos(kx * column / (1 + e) + ky * row / (1 - 0.36 * e) + phase).sum(0) for e in strain]
grey = 128 + 3.5 * np.array(grey) + rng.normal(0, 2, (5, 70, 110))


def strip(**more):
    return idic.Experiment(
        images=np.clip(np.round(grey), 0, 255).astype(np.uint8), mesh={"roi_px": [10, 10, 100, 60], "element_px": 20},
        kind="plane_stress", thickness_mm=2.0, camera={"pixel_size_mm": 0.1, "noise_std_gv": 2.0},
        boundaries=[{"nodes": "LEFT", "u": "measured"}, {"nodes": "RIGHT", "u": "measured"}],
        materials={"sheet": {"law": "elastic", "E": {"value": 2000, "unit": "MPa", "identify": True},
                             "nu": {"value": 0.3, "identify": True}}}, **more)


force = {"loads": {"force_N": 3000 * strain * 5.0 * 2.0}, "channels": [
    {"column": "force_N", "simulated": {"reaction": "RIGHT", "component": "x"}, "noise_std": 1.0}]}
tests = {"no force": strip(), "force, thickness too": strip(dofs=[{"name": "geometry.thickness"}], **force),
         "force": strip(**force)}
for case, test in tests.items():
    result = idic.identify(test)
    E = result.parameters["sheet.E"]
    print(case, result, *(f"{one['name']}: {one['reason']}" for one in result["not_identifiable"]), sep="\n  ")
    plt.errorbar([case], E.value, 1.96 * (E.std or np.nan), fmt="o" if E.std else "x", color="C0", capsize=6)
plt.ylabel("E, MPa (cross: not determined, start value)")
plt.savefig("not_determined.png", dpi=80)
