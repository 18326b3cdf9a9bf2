"""The numbers of docs/polycarbonate.md: what the time step changes at the neck, and starts far from the truth.

Run with ``python docs/polycarbonate_numbers.py steps|starts [elements along] [across]``; prints tables.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from idic.edge.example_polycarbonate_model import TRUTH, Divisions, pull, strip_mesh
from idic.errors import NotConverged

PIXEL = 0.0931  # mm
FRAMES = 200


def time_steps(mesh) -> None:
    """In-plane displacement and force with coarser increments than 2000, and extrapolated from two runs."""
    runs = {n: pull(mesh, FRAMES, n) for n in (1, 2, 5, 10)}
    fine = runs[10]
    rows = {f"{FRAMES * n} increments": (run.u, run.force) for n, run in runs.items() if n < 10}
    rows["extrapolated from 200 and 400"] = tuple(2 * b - a for a, b in zip(
        (runs[1].u, runs[1].force), (runs[2].u, runs[2].force), strict=True))
    rows["extrapolated from 400 and 1000"] = tuple((5 * b - 2 * a) / 3 for a, b in zip(
        (runs[2].u, runs[2].force), (runs[5].u, runs[5].force), strict=True))
    for name, (u, force) in rows.items():
        gap = np.linalg.norm((u - fine.u)[..., :2], axis=-1).max(axis=1) / PIXEL  # (n_frames,) px
        print(f"| {name} | {gap[:46].max():.3f} | {gap.max():.2f} (at {gap.argmax()} s) | {gap[100:].max():.2f} | "
              f"{np.abs(force - fine.force).max():.1f} |")


def starts(mesh, n_sets: int = 20, spread: float = 0.5) -> None:
    """Forward runs with all ten parameters off by up to +-50 %, each on its own."""
    rng = np.random.default_rng(0)
    truth = np.array(list(TRUTH.values()))
    for k in range(n_sets):
        values = truth * (1.0 + rng.uniform(-spread, spread, len(truth)))
        began = time.process_time()
        try:
            run = pull(mesh, FRAMES, 1, values)
            outcome = f"{run.steps} increments, peak force {run.force.max():.0f} N"
        except NotConverged as problem:
            outcome = f"failed: {problem}"
        print(f"{k:2d}  {outcome}, {time.process_time() - began:.1f} s", flush=True)


if __name__ == "__main__":
    along, across = (int(n) for n in (sys.argv[2:4] or ("40", "4")))
    {"steps": time_steps, "starts": starts}[sys.argv[1]](strip_mesh(Divisions(along, across)))
