"""Intervals under a smooth error of the force: ``python studies/evidence/channel_errors.py [--draws 100]``.

Strips with a hole, their truth on another mesh (`idic_studies.examples.misfit_worlds`), whose force is off by a smooth
random course: a share of the reading, or of the largest reading. The course is a squared exponential process over the
recording. The noise of the force is stated, or left to idic. Prints, per world, how often intervals of 95 % hold the
truth, and their mean width over the narrowest constant one that would hold it in 95 of 100 draws.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from idic.experiment_file import load_experiment
from idic.identification import identify
from idic_studies.cases.misfit import DISTURBANCE, NOISE_GV
from idic_studies.cases.realisation import realisation
from idic_studies.examples.misfit_worlds import draw, virtual_test
from idic_studies.examples.open_hole_strip import write_clean

MODELS, SIZES, KINDS, NOISES = ("polymer", "metal"), (0.0, 0.003, 0.01, 0.03), ("share", "absolute"), ("stated", "auto")
LENGTHS = (0.25, 1.0)  # of the course, over the recording: drawn between
QUANTILE_95 = 1.959964
NOISE_SHARE = 5e-4  # of the largest force


@dataclass(frozen=True)
class World:
    """model : of the strip; size : std of the error; kind : of what it is a share; noise : whether it is told."""

    model: str
    size: float
    kind: str
    noise: str


def course(rng: np.random.Generator, n: int) -> np.ndarray:
    """A smooth course of unit standard deviation over n frames  # (n,)"""
    length = rng.uniform(*LENGTHS)
    s = np.linspace(0.0, 1.0, n)
    correlation = np.exp(-0.5 * ((s[:, None] - s) / length)**2) + 1e-9 * np.eye(n)
    return np.linalg.cholesky(correlation) @ rng.standard_normal(n)


def identified(world: World, seed: int) -> dict[str, object]:
    """One draw: error, std and std by noise of every parameter in its unit."""
    test = virtual_test(draw(world.model, 0))
    with tempfile.TemporaryDirectory() as folder:
        drawn = draw(world.model, 0)
        experiment = load_experiment(folder, drawn.overrides, stack=write_clean(Path(folder), test))
        experiment = realisation(experiment, NOISE_GV[drawn.elastic], replace(DISTURBANCE, records=False), 7 + seed)
        rng = np.random.default_rng((seed, 640))
        model = experiment.model
        (channel,) = model.channels
        largest = np.abs(channel.values).max()
        unit = channel.values if world.kind == "share" else largest * np.linspace(0.0, 1.0, len(channel.values))**0.1
        values = channel.values + world.size * course(rng, len(channel.values)) * unit
        values = values + NOISE_SHARE * largest * rng.standard_normal(len(values))
        stated = NOISE_SHARE * largest if world.noise == "stated" else 0.0
        channel = replace(channel, values=values, noise_std=stated)
        experiment = replace(experiment, model=replace(model, channels=(channel,)))
        began = time.process_time()
        found = identify(experiment).result
    row: dict[str, object] = {"model": world.model, "size": world.size, "kind": world.kind, "noise": world.noise,
                              "seed": seed, "cpu_s": round(time.process_time() - began, 2)}
    for name, entry in found["parameters"].items():
        row |= {f"{name}": entry["value"] - test.truth[name], f"{name} std": entry["std"],
                f"{name} noise": entry["std_noise"]}
    return row | {"discrepancy": str((found.get("discrepancy") or {}).get("std"))}


def told(rows: list[dict]) -> list[str]:
    """A line per world and parameter."""
    lines = []
    for key, members in itertools.groupby(sorted(rows, key=_world), key=_world):
        draws = list(members)
        for name in (n for n in draws[0] if f"{n} std" in draws[0]):
            error, std, noise = (np.array([float(row[f"{name}{end}"]) for row in draws])
                                 for end in ("", " std", " noise"))
            held = np.abs(error) < QUANTILE_95 * std
            constant = np.quantile(np.abs(error), 0.95) / QUANTILE_95
            lines.append(f"{' '.join(map(str, key)):28} {name:24} n {len(draws):3} held {100 * held.mean():5.1f} +- "
                         f"{100 * np.sqrt(held.mean() * (1 - held.mean()) / len(held)):3.1f} % width/constant "
                         f"{std.mean() / constant:5.2f} noise/constant {noise.mean() / constant:5.2f}")
    return lines


def _world(row: dict) -> tuple:
    return row["model"], row["kind"], row["noise"], float(row["size"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=100)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--models", nargs="*", default=MODELS)
    parser.add_argument("--kinds", nargs="*", default=KINDS)
    parser.add_argument("--noises", nargs="*", default=NOISES)
    parser.add_argument("--sizes", nargs="*", type=float, default=SIZES)
    parser.add_argument("--out", type=Path, default=Path("channel_errors.csv"))
    chosen = parser.parse_args()
    worlds = [World(*entries) for entries in itertools.product(chosen.models, chosen.sizes, chosen.kinds,
                                                               chosen.noises)]
    rows: list[dict] = []
    with ProcessPoolExecutor(chosen.processes) as pool:
        jobs = [pool.submit(identified, world, chosen.first + seed) for seed in range(chosen.draws) for world in worlds]
        for job in as_completed(jobs):
            rows.append(job.result())
            with chosen.out.open("w", newline="") as stream:
                writer = csv.DictWriter(stream, max(map(list, rows), key=len))
                writer.writeheader()
                writer.writerows(rows)
    print("\n".join(told(rows)))


if __name__ == "__main__":
    main()
