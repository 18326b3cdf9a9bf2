"""A small folder with images and a log, and a plan for it, as the page would send it."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import tifffile

SHAPE = (160, 240)


def make_folder(folder: Path, n: int = 3) -> Path:
    """A dotted strip that is stretched a little, with the force and a pressure of every frame."""
    (folder / "images").mkdir(parents=True)
    for k, image in enumerate(_images(n)):
        tifffile.imwrite(folder / "images" / f"f_{k}.tif", image)
    rows = [f"{k},{k}.0,{100 * k},{0.04 * k},{2 * k}" for k in range(n)]
    (folder / "loads.csv").write_text("\n".join(["frame,time_s,force_N,grip_displacement_mm,p_bar", *rows]) + "\n")
    return folder


@cache
def _images(n: int) -> list[np.ndarray]:
    rng = np.random.default_rng(3)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    waves = rng.uniform(-1.1, 1.1, (60, 2)), rng.uniform(0, 6.3, 60)
    inside, images = (np.abs(x - 120) < 100) & (np.abs(y - 80) < 50), []
    for k in range(n):
        at = 120 + (x - 120) / (1 + 0.002 * k)
        grey = 120 + 7 * sum(np.cos(kx * at + ky * y + phase) for (kx, ky), phase in zip(*waves, strict=True))
        image = np.where(inside, grey, 15) + rng.normal(0, 1, SHAPE)
        images.append(np.clip(image, 0, 255).astype(np.uint8))
    return images


def plan(**changes) -> dict:
    """What the page sends for that folder."""
    sketch = {"outline": [[22.0, 32.0], [218.0, 32.0], [212.0, 80.0, 218.0, 128.0], [22.0, 128.0]],
              "holes": [[120.0, 80.0, 15.0]],
              "element_px": 16.0, "elements": "quads", "mesher": "idic", "edge_names": {"LEFT": [4], "RIGHT": [2]}}
    content = {
        "title": 'strip "A"', "images": "images/*.tif", "loads": "loads.csv", "sketch": sketch, "kind": "plane_stress",
        "thickness_mm": 2.0, "pixel_size_mm": 0.1, "origin_px": [22.0, 128.0], "rotation_deg": 0.0,
        "motions": {"LEFT": {"kind": "fixed"},
                    "RIGHT": {"kind": "column", "column": "grip_displacement_mm", "component": "x"}},
        "force": {"column": "force_N", "edge": "RIGHT", "component": "x"}, "law": "elastic",
        "parameters": {"E": {"value": 70000.0, "identify": True}, "nu": {"value": 0.3, "identify": True}}}
    return content | changes
