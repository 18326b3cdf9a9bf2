"""A folder with images of a speckled strip that is stretched, whose names, log and cameras a test chooses."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
import tifffile
from scipy.ndimage import gaussian_filter, map_coordinates
from small_experiment import TOML, write_experiment

from idic.cli import main

N = 12
STEP_PX = 0.6  # of the upper end from state to state
UM_PER_PX = 50.0
NOISE_GV = 2.0
SPECKLE = TOML.replace("pixel_size_mm = 0.1\norigin_px = [10.0, 40.0]",
                       "pixel_size_mm = 0.05\norigin_px = [10.0, 70.0]")
assert SPECKLE != TOML
_PATTERN = gaussian_filter(np.random.default_rng(4).normal(size=(120, 140)), 1.6)
_PATTERN = 120.0 + 45.0 * _PATTERN / _PATTERN.std()


def image_of(state: float, noise: np.random.Generator | None, shift: float = 0.0) -> np.ndarray:
    """The strip, 60 px high above row 70, stretched by so many steps  # (80, 100) uint8"""
    y, x = np.mgrid[0:80, 0:100].astype(float)
    strain = STEP_PX * state / 60.0
    moved = strain / (1.0 + strain) * np.clip(70.0 - y, -18.0, 78.0)
    values = map_coordinates(_PATTERN, [y + 20.0 + moved, x + 20.0 + shift], order=3)
    if noise is not None:
        values = values + noise.normal(0.0, NOISE_GV, values.shape)
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def images_of(states: Sequence[float], seed: int = 1) -> list[np.ndarray]:
    """One exposure of every state."""
    noise = np.random.default_rng(seed)
    return [image_of(state, noise) for state in states]


def write_strip(folder: Path, names: Sequence[str], images: Sequence[np.ndarray] | None = None, *,
                frames: Sequence[int] | None = None, more: str = "", with_log: bool = True,
                rows: Sequence[Sequence[float]] | None = None) -> Path:
    """The experiment.

    names : of the images, in the order of time; images : default: of the states 0, 1, 2 …; frames : column of the log;
    more : lines of [experiment]; rows : (time, grip displacement in px) of the log; default: of the states
    """
    toml = SPECKLE.replace('title = "small"', f'title = "small"\n{more}')
    if not with_log:
        toml = toml[:toml.index("[[channel]]")].replace('loads = "loads.csv"\n', "").replace(
            'uy = { column = "grip_um", noise_std = 0.2 }', "uy = 0.0")
    write_experiment(folder, toml)
    for path in (folder / "images").iterdir():
        path.unlink()
    for name, image in zip(names, images or images_of(range(len(names))), strict=True):
        path = folder / "images" / name
        path.parent.mkdir(exist_ok=True)
        tifffile.imwrite(path, image)
    lines = ["frame," * (frames is not None) + "time_s,force_kN,grip_um"]
    for k, (time, grip_px) in enumerate(rows or [(float(k), STEP_PX * k) for k in range(len(names))]):
        number = "" if frames is None else f"{frames[k]},"
        lines.append(f"{number}{time},{0.05 * grip_px},{UM_PER_PX * grip_px:.4f}")
    (folder / "loads.csv").write_text("\n".join(lines) + "\n")
    return folder


def check(folder: Path) -> tuple[int, str]:
    """Exit code and output of `idic check`, in one line."""
    with StringIO() as output, redirect_stdout(output), redirect_stderr(output), pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["idic", "check", str(folder), "--no-picture"])
        try:
            main()
            code = 0
        except SystemExit as end:
            code = int(end.code or 0)
        return code, " ".join(output.getvalue().split())
