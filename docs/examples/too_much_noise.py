"""A failure: too much noise on a weak pattern at a small strain.

idic does not refuse such a test. It says how little is known: error bars as large as the value, then none at all.
"""

import matplotlib.pyplot as plt
import numpy as np

import idic

rng = np.random.default_rng(1)
kx, ky = rng.normal(0, 0.6, (2, 200, 1, 1))
phase, (row, column) = rng.uniform(0, 2 * np.pi, (200, 1, 1)), np.mgrid[:70.0, :110.0]
strain = np.linspace(0, 0.002, 5)
grey = np.array([np.cos(kx * column / (1 + e) + ky * row / (1 - 0.36 * e) + phase).sum(0) for e in strain])


def strip(noise):
    images = 128 + grey + rng.normal(0, noise, grey.shape)
    return idic.Experiment(
        images=np.clip(np.round(images), 0, 255).astype(np.uint8), mesh={"roi_px": [10, 10, 100, 60], "element_px": 20},
        loads={"force_N": 3000 * strain * 5.0 * 2.0}, kind="plane_stress", thickness_mm=2.0,
        camera={"pixel_size_mm": 0.1, "noise_std_gv": noise},
        boundaries=[{"nodes": "LEFT", "u": "measured"}, {"nodes": "RIGHT", "u": "measured"}],
        materials={"sheet": {"law": "elastic", "E": {"value": 2000, "unit": "MPa", "identify": True},
                             "nu": {"value": 0.3, "identify": True}}},
        channels=[{"column": "force_N", "simulated": {"reaction": "RIGHT", "component": "x"}, "noise_std": 0.1}])


for noise in (0.5, 1.0, 2.0, 4.0, 8.0):
    result = idic.identify(strip(noise))
    print(f"noise {noise:g} grey values: {result}")
    print(*result["notes"][3:], *(f"{one['name']}: {one['reason']}" for one in result["not_identifiable"]), sep="\n")
    E = result.parameters["sheet.E"]
    plt.errorbar([f"{noise:g}"], E.value, 1.96 * (E.std or np.nan), fmt="o" if E.std else "x", color="C0", capsize=6)
plt.axhline(3000, color="grey", linestyle="--", label="truth")
plt.gca().set(xlabel="noise, grey values (pattern: 10)", ylabel="E, MPa, 95 % (cross: not determined)")
plt.savefig("too_much_noise.png", dpi=80)
