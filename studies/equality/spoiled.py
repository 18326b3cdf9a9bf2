"""Recordings in which something is that the model lacks: a law of its own, or an effect on the finished images."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tifffile
from scipy import ndimage

from idic_studies.equality.strips import Strip

UP_HOLD_DOWN = ((0.0, 0.0), (6.0, 0.12), (8.0, 0.12), (11.0, 0.012))  # s, mm
LONG_STRIP = Strip("strip, up and down", program=UP_HOLD_DOWN, n_frames=12)
YIELDING = {"law": "j2_linear", "E": 2000.0, "nu": 0.35, "yield_stress": 40.0, "hardening_modulus": 400.0}
UNEVEN_SHARE = 0.03  # of the grey value at the ends of the image, in the last frame
HAZE_PX, HAZE_WAVES, HAZE_LENGTHS_PX = 0.12, 6, (30.0, 70.0)


def illuminate_unevenly(folder: Path) -> None:
    """Light that moves along the image in the course of the test."""
    files = sorted((folder / "images").glob("*.tif"))
    for number, file in enumerate(files):
        image = tifffile.imread(file).astype(float)
        along = np.linspace(-1.0, 1.0, image.shape[1])
        _write(file, image * (1.0 + UNEVEN_SHARE * number / (len(files) - 1) * along))


def see_through_haze(folder: Path, generator: np.random.Generator) -> None:
    """Air of changing density: every frame but the first is seen through another smooth field of displacement."""
    for file in sorted((folder / "images").glob("*.tif"))[1:]:
        image = tifffile.imread(file).astype(float)
        places = np.indices(image.shape).astype(float)  # (2, ny, nx) px
        bent = places.copy()
        for _ in range(HAZE_WAVES):
            angle, phase = generator.uniform(0.0, np.pi, 2)
            number = 2.0 * np.pi / generator.uniform(*HAZE_LENGTHS_PX)
            wave = np.sin(number * (places[0] * np.sin(angle) + places[1] * np.cos(angle)) + phase)
            bent += HAZE_PX * generator.standard_normal((2, 1, 1)) * wave
        _write(file, ndimage.map_coordinates(image, bent, order=3, mode="nearest"))


def _write(file: Path, image: np.ndarray) -> None:
    tifffile.imwrite(file, np.clip(np.rint(image), 0, 255).astype(np.uint8))
