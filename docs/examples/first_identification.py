"""A first identification: images, mesh and log are Python objects.

The images stand for a camera: a pattern of waves on a strip that is stretched by 1 % and becomes narrower.
"""

import numpy as np

import idic

E, NU, WIDTH, THICKNESS, PIXEL = 3000.0, 0.36, 8.0, 2.0, 0.1  # MPa, mm; the truth
rng = np.random.default_rng(1)
kx, ky = rng.normal(0, 0.9, (2, 200, 1, 1))
phase = rng.uniform(0, 2 * np.pi, (200, 1, 1))
column, row = np.meshgrid(np.arange(160.0), np.arange(100.0))


def image(strain):
    x, y = column / (1 + strain), row / (1 - NU * strain)  # where a pixel of the frame was before
    grey = 128 + 3.5 * np.cos(kx * x + ky * y + phase).sum(0) + rng.normal(0, 2, row.shape)
    return np.clip(np.round(grey), 0, 255).astype(np.uint8)


strain = np.linspace(0, 0.01, 6)
force = E * strain * WIDTH * THICKNESS + rng.normal(0, 1, 6)
strip = idic.Experiment(
    images=np.stack([image(e) for e in strain]), loads={"force_N": force},
    mesh={"roi_px": [10, 10, 150, 90], "element_px": 20}, kind="plane_stress", thickness_mm=THICKNESS,
    camera={"pixel_size_mm": PIXEL, "noise_std_gv": 2.0},
    materials={"sheet": {"law": "elastic", "E": {"value": 2000, "unit": "MPa", "identify": True},
                         "nu": {"value": 0.3, "identify": True}}},
    boundaries=[{"nodes": "LEFT", "u": "measured"}, {"nodes": "RIGHT", "u": "measured"}],
    channels=[{"column": "force_N", "simulated": {"reaction": "RIGHT", "component": "x"}, "noise_std": 1.0}])

result = idic.identify(strip)
print(result)
result.plot.channels().savefig("first_identification.png", dpi=90)
