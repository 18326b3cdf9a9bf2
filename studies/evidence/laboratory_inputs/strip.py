"""A pulled strip before a camera, drawn as dots at their deformed places: no spline of the correlator makes it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import tifffile

WIDTH, HEIGHT, DOT_PX, N_DOTS, NOISE_GV = 240, 110, 1.7, 1500, 1.5
PIXEL_MM, E_MPA, THICKNESS_MM = 0.1, 70e3, 2.0
LENGTH_MM = 20.0  # of the strip, from column 20 to 220
RAMP = np.linspace(0.0, 0.02, 12)
TOML = """[experiment]
images = {images}
{more}
mesh = {{ roi_px = [20, 15, 220, 95], element_px = 20 }}
kind = "plane_stress"
thickness_mm = 2.0
[camera]
pixel_size_mm = 0.1
noise_std_gv = 1.5
[material.SPECIMEN]
law = "elastic"
E = {{ value = 68e3, unit = "MPa", identify = true }}
nu = 0.3
[[boundary]]
nodes = "LEFT"
ux = 0.0
uy = 0.0
[[boundary]]
nodes = "RIGHT"
ux = {{ column = "grip_mm" }}
uy = 0.0
[[channel]]
column = "force_N"
simulated = {{ reaction = "RIGHT", component = "x" }}
noise_std = 5.0
"""


def image(strain: float, seed: int, gap_px: float = 0.0, shift_px: float = 0.0) -> np.ndarray:
    """What the camera sees; gap_px : by which the right half has moved off  # (ny, nx) uint8"""
    places = np.random.default_rng(7).uniform((-20, -20), (WIDTH + 20, HEIGHT + 20), (N_DOTS, 2))
    column = 20.0 + (places[:, 0] - 20.0) * (1.0 + strain) + gap_px * (places[:, 0] > 120.0) + shift_px
    row = 55.0 + (places[:, 1] - 55.0) * (1.0 - 0.3 * strain)
    grey = np.full((HEIGHT, WIDTH), 40.0)
    reach = np.arange(-6, 7)
    for x, y in zip(column, row, strict=True):
        i, j = int(round(y)) + reach, int(round(x)) + reach
        i, j = i[(i >= 0) & (i < HEIGHT)], j[(j >= 0) & (j < WIDTH)]
        grey[np.ix_(i, j)] += 130.0 * np.outer(np.exp(-0.5 * ((i - y) / DOT_PX) ** 2),
                                               np.exp(-0.5 * ((j - x) / DOT_PX) ** 2))
    noise = np.random.default_rng(seed).normal(0.0, NOISE_GV, grey.shape)
    return np.clip(np.rint(grey + noise), 0, 255).astype(np.uint8)


def force_of(strain: np.ndarray) -> np.ndarray:
    """N, by the area of the strip and the modulus."""
    return E_MPA * 8.0 * THICKNESS_MM * np.asarray(strain)


def log_text(strain: Sequence[float], force: Sequence[float] | None = None, first: str = "") -> str:
    """A row per image: a column of its own first, then force and grip."""
    force = force_of(np.asarray(strain)) if force is None else force
    noise = np.random.default_rng(5).normal(0.0, 5.0, len(strain))
    rows = [f"{k},{f + n:.2f},{LENGTH_MM * e:.5f}" for k, (f, n, e) in enumerate(zip(force, noise, strain,
                                                                                 strict=True))]
    return "frame,force_N,grip_mm\n" + "\n".join(rows) + "\n" if not first else first + "\n".join(rows) + "\n"


def write(folder: Path, names: Sequence[str], images: Sequence[np.ndarray], log: str, more: str = "") -> Path:
    """The folder of a recording."""
    (folder / "images").mkdir(parents=True)
    for name, picture in zip(names, images, strict=True):
        tifffile.imwrite(folder / "images" / name, picture)
    (folder / "loads.csv").write_text(log, encoding="utf-8")
    (folder / "experiment.toml").write_text(TOML.format(images='"images/*.tif"', more=f'loads = "loads.csv"\n{more}'))
    return folder
