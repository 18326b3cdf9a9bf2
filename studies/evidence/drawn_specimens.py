"""Whether `idic check` takes what `idic init` writes, for measured fields on drawn specimens: ``python -m
idic_studies.evidence.drawn_specimens 200``."""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
from matplotlib.path import Path as Polygon

from idic.errors import InputError
from idic.experiment_file import initial_experiment, load_experiment
from idic.report import check

KINDS = ("strip", "waisted", "notched", "shear", "slots", "butterfly", "hole", "holes", "askew", "angle", "cross")
N_STAGES = 3


def specimen(kind: str, rng: np.random.Generator) -> tuple[np.ndarray, list[np.ndarray]]:
    """A drawn specimen: corners of its outline (n, 2) mm, and holes (x, y, r)."""
    width, length = rng.uniform(8.0, 25.0), rng.uniform(15.0, 60.0)
    box = np.array([[0, 0], [width, 0], [width, length], [0, length]], dtype=float)
    middle, depth = 0.5 * length, rng.uniform(0.1, 0.35) * width
    if kind == "waisted":
        y = np.linspace(0.2, 0.8, 25) * length
        cut = depth * np.sin(np.pi * (y / length - 0.2) / 0.6) ** 2
        right, left = np.column_stack([width - cut, y]), np.column_stack([cut, y])[::-1]
        return np.vstack([box[:2], right, box[2:], left]), []
    if kind in ("notched", "shear"):
        shift = rng.uniform(0.05, 0.25) * length if kind == "shear" else 0.0
        mouth, slant = rng.uniform(0.03, 0.2) * length, rng.uniform(-1.0, 1.0) * depth if kind == "shear" else 0.0
        right = [[width, middle - shift - mouth], [width - depth, middle - shift + slant],
                 [width, middle - shift + mouth]]
        left = [[0, middle + shift + mouth], [depth, middle + shift - slant], [0, middle + shift - mouth]]
        return np.vstack([box[:2], right, box[2:], left]), []
    if kind == "slots":
        shift, half, slant = (rng.uniform(-0.3, 0.3) * length, rng.uniform(0.005, 0.05) * length,
                              rng.uniform(-1.2, 1.2) * depth)
        right = [[width, middle - shift - half], [width - depth, middle - shift - half + slant],
                 [width - depth, middle - shift + half + slant], [width, middle - shift + half]]
        return np.vstack([box[:2], right, box[2:], [[width - x, length - y] for x, y in right]]), []
    if kind == "butterfly":
        x = np.linspace(0.15, 0.85, 25) * width
        deep = rng.uniform(0.3, 0.42) * length * np.sin(np.pi * (x / width - 0.15) / 0.7) ** rng.uniform(0.5, 3.0)
        return np.vstack([box[:1], np.column_stack([x, deep]), box[1:3], np.column_stack([x, length - deep])[::-1],
                          box[3:]]), []
    if kind in ("hole", "holes"):
        n = 1 if kind == "hole" else 3
        r = rng.uniform(0.1, 0.3) * width / np.sqrt(n)
        return box, [np.array([0.5 * width, middle + (k - 0.5 * (n - 1)) * 3.5 * r, r]) for k in range(n)]
    if kind == "askew":
        return box + rng.uniform(-0.15, 0.15, box.shape) * width, []
    if kind == "angle":
        leg = rng.uniform(0.3, 0.6) * width
        return np.array([[0, 0], [width, 0], [width, leg], [leg, leg], [leg, length], [0, length]]), []
    if kind == "cross":
        a, b, r = 0.3 * width, 0.7 * width, width
        return np.array([[a, 0], [b, 0], [b, a], [r, a], [r, b], [b, b], [b, r], [a, r], [a, b], [0, b], [0, a],
                         [a, a]]), []
    return box, []


def points_on(outline: np.ndarray, holes: list[np.ndarray], rng: np.random.Generator) -> np.ndarray:
    """Points of a turned grid that are half a facet or more inside  # (n, 2) mm"""
    extent = np.ptp(outline, axis=0)
    pitch = float(np.sqrt(np.prod(extent) / rng.uniform(300.0, 2500.0)))
    turn = rng.uniform(-0.8, 0.8) if rng.random() < 0.5 else 0.0
    span = np.arange(-1.5 * extent.max(), 1.5 * extent.max(), pitch)
    grid = np.stack(np.meshgrid(span, span), axis=-1).reshape(-1, 2)
    c, s = np.cos(turn), np.sin(turn)
    at = grid @ np.array([[c, s], [-s, c]]) + outline.mean(axis=0) + rng.uniform(0.0, pitch, 2)
    facet = rng.uniform(0.5, 1.5) * pitch
    ring = facet * np.column_stack([np.cos(a := np.linspace(0, 2 * np.pi, 8, endpoint=False)), np.sin(a)])
    inside = np.all([Polygon(outline).contains_points(at + step) for step in ring], axis=0)
    for hole in holes:
        inside &= np.hypot(*(at - hole[:2]).T) > hole[2] + facet
    at = at[inside]
    lost = rng.random(len(at)) < rng.choice([0.0, 0.0, 0.01])
    return at[~lost]


def write_stages(folder: Path, at: np.ndarray, rng: np.random.Generator) -> None:
    """Stages of a small pull with noise, as tables."""
    for k in range(N_STAGES):
        u = 1e-3 * k * np.column_stack([-0.3 * at[:, 0], at[:, 1]]) + rng.normal(0.0, 1e-4, at.shape)
        rows = [f"{i},{x:.5f},{y:.5f},{a:.6f},{b:.6f}" for i, ((x, y), (a, b)) in enumerate(zip(at, u, strict=True))]
        (folder / f"stage_{k:03d}.csv").write_text("\n".join(["id,x_mm,y_mm,ux_mm,uy_mm", *rows]), encoding="utf-8")


def refusal(kind: str, seed: int) -> str:
    """What `idic check` says of the file that `idic init` writes for a drawn specimen; "" where it takes it."""
    rng = np.random.default_rng(seed)
    at = points_on(*specimen(kind, rng), rng)
    with tempfile.TemporaryDirectory(prefix="idic-drawn-") as name:
        folder = Path(name)
        write_stages(folder, at, rng)
        try:
            file, _ = initial_experiment(folder)
            text = file.read_text(encoding="utf-8")
            if "fields_noise_um" in text:
                file.write_text(text.replace("fields_noise_um = 1.0", "fields_noise_um = 0.1"), encoding="utf-8")
            check(load_experiment(folder), draw=False)
        except InputError as error:
            return f"{error.key}: {error.what} ({error.found})"
    return ""


def main(n: int) -> None:
    """Draw n specimens and list what is refused."""
    refused: Counter = Counter()
    for seed in range(n):
        kind = KINDS[seed % len(KINDS)]
        text = refusal(kind, seed)
        if text:
            refused[kind] += 1
            sys.stdout.write(f"{kind} {seed}: {text}\n")
    sys.stdout.write(f"{n} specimens, {sum(refused.values())} refused: {dict(refused)}\n")


if __name__ == "__main__":
    main(int(sys.argv[1]))
