"""Diagnoses of recordings whose model is right and whose noise is not told: how many give an alarm.

    python studies/evidence/clean_diagnoses.py --world blurred --draws 40 --processes 2

A strip with a hole (elastic, or metal that yields) is solved on a finer mesh and rendered by code that shares nothing
with what identifies (`tests/diagnose/material_twins.py`). Its images get the noise of a world of `idic study coverage`:
smoothed, through JPEG or a colour filter, by grey level, stated 20 % low, or a force whose noise drifts. Then
`idic identify` and `idic diagnose`, both with what they do by default. An alarm is any verdict but ``none``. One line
per draw, the sum at the end.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "diagnose"))
import material_twins as twins
from side_twins import GRIP_NOISE, NOISE, ORIGIN, PIXEL, SHAPE

from idic.images import ArrayStack, Camera, dense_speckle
from idic.run import diagnose_run, identify_run
from idic_studies.cases.coverage import WORLDS
from idic_studies.cases.realisation import autoregression
from idic.virtual_tests import Sensor, clean_image, painted, recorded_by, write_images, write_loads

NAMES = {"elastic": "clean", "plastic": "clean_plastic"}


def write_draw(folder: Path, model: str, world: str, seed: int) -> None:
    """The user's folder of one draw, with noise of its own in images, force and grip."""
    rng = np.random.default_rng((seed, 77))
    mesh, u, force = twins.truth(NAMES[model])
    camera = Camera.from_table(PIXEL, ORIGIN)
    texture = painted(dense_speckle(np.random.default_rng((seed, 7)), 1.6, 30.0, 225.0, extent_px=400.0), camera)
    clean = Sensor(SHAPE, background=30.0)
    images = np.array([clean_image(moved, mesh.nodes, mesh.blocks, camera, texture, clean) for moved in u])
    more = WORLDS.get(world, {})
    stack = recorded_by(more.get("sensor", "white"), ArrayStack(images.astype(np.float32)), NOISE, seed)
    (folder / "images").mkdir(parents=True)
    write_images(folder, (np.clip(np.rint(stack.frame(k)), 0, 255).astype(np.uint8) for k in range(len(images))))
    std, null = 2e-3 * np.abs(force).max(), twins.NULLS[twins.TRUTHS[NAMES[model]].null]
    drift = autoregression(rng.standard_normal(len(force)), more.get("channel_correlation", 0.0))
    grip = null.grip + GRIP_NOISE * rng.standard_normal(len(force)) * (twins.TIMES > 0)
    write_loads(folder, twins.TIMES, {"force_N": force + std * drift, "grip_mm": grip})
    twins.write_inp(twins.strip_with_hole(twins.LENGTH, twins.WIDTH, twins.RADIUS, "quad8", 3, 4, 3, name="BODY"),
                    folder / "mesh.inp", "draw")
    toml = twins.TOML % (null.table, f"{std:.6g}")
    noise_line = f"noise_std_gv = {np.hypot(NOISE, 12**-0.5):.4f}"
    assert noise_line in toml
    written_line = f"noise_std_gv = {0.8 * np.hypot(NOISE, 12**-0.5):.4f}" if world == "understated" else (
        noise_line if world == "white" else "")
    (folder / "experiment.toml").write_text(toml.replace(noise_line, written_line))


def draw(seed: int, model: str, world: str) -> tuple[str, ...]:
    """Verdict, named set, largest error over std and seconds of one draw."""
    start = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        test = Path(folder) / "test"
        write_draw(test, model, world, seed)
        result = identify_run(test, Path(folder) / "run")
        content = diagnose_run(Path(folder) / "run")
    truth = twins.TRUTHS[NAMES[model]].values
    off = max(abs(entry["value"] - truth[name.rpartition(".")[2]]) / entry["std"]
              for name, entry in result["parameters"].items() if entry["std"])
    return (content["verdict"], "+".join(content["named"]) or "-", f"{off:.2f}", f"{time.process_time() - start:.0f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--world", choices=["white", *(w for w in WORLDS if w != "fields")], default="white")
    parser.add_argument("--model", choices=sorted(NAMES), default="elastic")
    parser.add_argument("--draws", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--processes", type=int, default=1)
    options = parser.parse_args()
    alarms = n_finished = 0
    with ProcessPoolExecutor(options.processes) as pool:
        jobs = {pool.submit(partial(draw, model=options.model, world=options.world), seed): seed
                for seed in range(options.first, options.first + options.draws)}
        for job in as_completed(jobs):
            verdict, named, off, seconds = job.result()
            n_finished, alarms = n_finished + 1, alarms + (verdict != "none")
            print(f"{options.world} {options.model} {jobs[job]}: {verdict} {named}, off by {off} std, {seconds} CPU s; "
                  f"alarms {alarms} of {n_finished}", flush=True)


if __name__ == "__main__":
    main()
