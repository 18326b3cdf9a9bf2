"""Numbers of docs/error-bars.md: chi^2 at the true motion of a stretched speckle, by the blur of the reference.

Run with ``python studies/evidence/stretch_numbers.py``; prints the table. Speckle of 1.6 px on pixels with an area, no
noise in the images; chi^2 is 1 plus the mean square of the residual over that of a noise of 1 GV. Stretch along the
columns, and turned by 35 degrees; the contraction across is that of a body of constant volume.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.correlation import PixelMap, ReferenceImage, nodal_equations, residual_map
from idic.fe import Block
from idic.images import Camera, Pattern, dense_speckle, prefilter

SIDE, RIM, SAMPLES = 160, 34, 3  # px, px, per pixel and direction
LOWPASS_PX, NOISE_GV, SPECKLE_PX = 0.6, 1.0, 1.6
STRETCHES = (1.05, 1.10, 1.25, 1.45, 1.70, 2.20)
MIDDLE = np.full(2, (SIDE - 1) / 2)


def main() -> None:
    pattern = dense_speckle(np.random.default_rng(7), SPECKLE_PX, 30.0, 225.0, extent_px=600.0)
    still = picture(pattern, np.eye(2))
    sharp, blurred = build(still, 0.0), build(still, LOWPASS_PX)
    ways = {"low-pass of both images along their axes": replace(blurred, image_gv=None), "no low-pass": sharp,
            "low-pass that follows the stretch": blurred}
    print("| stretch | " + " | ".join(f"{100 * (s - 1):.0f} %" for s in STRETCHES) + " |\n|" +
          " --- |" * (len(STRETCHES) + 1))
    for label, reference in ways.items():
        rows = [[1.0 + misfit(reference, pattern, stretched(s, degrees)) for degrees in (0.0, 35.0)] for s in STRETCHES]
        print(f"| {label} | " + " | ".join(f"{a:.2f}, {b:.2f}" for a, b in rows) + " |")


def stretched(stretch: float, degrees: float) -> np.ndarray:
    """Deformation gradient of a uniaxial stretch along a direction  # (2, 2)"""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[c, -s], [s, c]])
    return turn @ np.diag([stretch, stretch**-0.5]) @ turn.T


def picture(pattern: Pattern, F: np.ndarray) -> np.ndarray:
    """The deformed pattern, the mean over the area of each pixel  # (SIDE, SIDE)"""
    offset = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    fine = (np.arange(SIDE)[:, None] + offset).ravel()
    points = np.stack(np.meshgrid(fine, fine), axis=-1).reshape(-1, 2)
    values = pattern.value((points - MIDDLE) @ np.linalg.inv(F).T + MIDDLE)
    return values.reshape(SIDE, SAMPLES, SIDE, SAMPLES).mean(axis=(1, 3))


def build(image: np.ndarray, lowpass_px: float) -> ReferenceImage:
    """The reference on one square of quads."""
    x, y = np.meshgrid(*2 * [np.linspace(RIM, SIDE - 1 - RIM, 7)])
    k = np.arange(49).reshape(7, 7)
    quads = np.stack([k[:-1, :-1], k[:-1, 1:], k[1:, 1:], k[1:, :-1]], axis=-1).reshape(-1, 4)
    camera = Camera.from_table(1.0, axes=("+col", "+row"))
    nodes = np.column_stack([x.ravel(), y.ravel()])
    pixel_map = PixelMap.of(nodes, [Block("quad4", quads, 0)], camera, image.shape)
    return ReferenceImage.of(pixel_map, image, 5, lowpass_px=lowpass_px)


def misfit(reference: ReferenceImage, pattern: Pattern, F: np.ndarray) -> float:
    """Mean square of the residual at the true motion over that of the noise."""
    spline = prefilter(picture(pattern, F), 5, reference.lowpass_px)
    u = (reference.pixel_map.nodes_px - MIDDLE) @ (F - np.eye(2)).T
    light = nodal_equations(reference, spline, u).brightness_fit().coefficients
    return residual_map(reference, spline, u, "frame", light).chi2_dof(NOISE_GV)


if __name__ == "__main__":
    main()
