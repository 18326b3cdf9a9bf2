"""A virtual boundary: the images show only the middle of an eccentrically loaded strip.

The log has no displacement of the cut edges. The displacement is identified together with the material.
"""

import numpy as np

import idic

E, NU, WIDTH, THICKNESS, PIXEL = 3000.0, 0.36, 8.0, 2.0, 0.1  # MPa, mm; the truth
rng = np.random.default_rng(5)
kx, ky = rng.normal(0, 0.9, (2, 200, 1, 1))
phase = rng.uniform(0, 2 * np.pi, (200, 1, 1))
column, row = np.meshgrid(np.arange(160.0), np.arange(100.0))


def image(strain, bend):
    """Strain of the axis, and curvature per px: the upper side is stretched more than the lower one."""
    x, y = column - 80, row - 50
    for _ in range(5):  # where a pixel of the frame was before
        x, y = (column - 80 - strain * x - bend * x * y,
                row - 50 + NU * strain * y + bend * (x**2 + NU * y**2) / 2)
    grey = 128 + 3.5 * np.cos(kx * x + ky * y + phase).sum(0) + rng.normal(0, 2, row.shape)
    return np.clip(np.round(grey), 0, 255).astype(np.uint8)


load = np.linspace(0, 1, 6)
edge = {"virtual": "bspline", "modes": 4, "time_modes": 5}
strip = idic.Experiment(
    images=np.stack([image(0.01 * t, -1e-4 * t) for t in load]), kind="plane_stress", thickness_mm=THICKNESS,
    loads={"force_N": E * 0.01 * load * WIDTH * THICKNESS}, mesh={"roi_px": [10, 10, 150, 90], "element_px": 20},
    camera={"pixel_size_mm": PIXEL, "noise_std_gv": 2.0},
    boundaries=[{"nodes": "LEFT", "u": edge}, {"nodes": "RIGHT", "u": edge}],
    materials={"sheet": {"law": "elastic", "E": {"value": 2000, "unit": "MPa", "identify": True},
                         "nu": {"value": 0.3, "identify": True}}},
    channels=[{"column": "force_N", "simulated": {"reaction": "RIGHT", "component": "x"}, "noise_std": 1.0}])
result = idic.identify(strip)
print(result.parameters["sheet.E"], result.parameters["sheet.nu"])
result.plot.residual(frame=-1).savefig("virtual_boundary.png", dpi=90)
