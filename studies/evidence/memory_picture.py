"""Draws docs/evidence/memory.png: peak memory of identifications over the length of the test and the parameters.

    python studies/evidence/memory_picture.py SCRATCH [frames ...]    # an hour for 100 200 500 1000 2000, one core

Each run is `idic identify --workers 1 --memory-limit 500MB`, one evaluated point of a strip in 42 pieces of which 2 or
42 moduli are free, images 300 x 200 px; its worker and all processes together are watched while it runs.
"""

from __future__ import annotations

import csv
import json
import os
import shutil
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import psutil

LIMIT = "500MB"
SLICES = 21
PIECES = 2 * SLICES  # lower and upper halves
STATES = 50  # the test is written with so many frames; longer ones hold each state for some frames


def write_strip(folder: Path) -> Path:
    """50 frames of a strip, elastic in 42 pieces along its length."""
    from idic.virtual_tests import DemoSize, EXAMPLES, strip, write_example

    EXAMPLES["strip"] = lambda reduced, foreign: strip(
        DemoSize(0.1, (200, 300), (15, 15, 20), (6, 7, 9), (3, 4, 2), 1)
    )
    write_example("strip", folder)
    file = folder / "experiment.toml"
    text = file.read_text()
    material, boundary = text.index("[material.sheet]"), text.index("[[boundary]]")
    edges = [-100.0, *(-14.0 + 28.0 * k / SLICES for k in range(1, SLICES)), 100.0]  # mm
    bounds = [
        f"x >= {low:.4f} and x < {high:.4f} and y {side} 0"
        for low, high in pairwise(edges)
        for side in ("<", ">=")
    ]
    pieces = [
        f'[material.P{k:02d}]\nlaw = "elastic"\nE = {{ value = 60e3, unit = "MPa", identify = FREE{k} }}\nnu = 0.3\n'
        for k in range(PIECES)
    ]
    sets = ["[sets]"] + [f'P{k:02d} = {{ where = "{condition}" }}' for k, condition in enumerate(bounds)]
    file.write_text(text[:material] + "\n".join(pieces + sets) + "\n\n" + text[boundary:])
    return folder


def stretched(short: Path, long: Path, n_frames: int, n_free: int) -> Path:
    """The same test with every state held, and so many moduli free."""
    (long / "images").mkdir(parents=True)
    shutil.copy(short / "mesh.inp", long / "mesh.inp")
    text = (short / "experiment.toml").read_text()
    for k in range(PIECES):
        text = text.replace(f"FREE{k} ", f"{str(k * n_free % PIECES < n_free).lower()} ")
    (long / "experiment.toml").write_text(text)
    with open(short / "loads.csv", newline="") as file:
        header, *rows = csv.reader(file)
    with open(long / "loads.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        for number in range(n_frames):
            state = number * len(rows) // n_frames
            writer.writerow(
                [
                    {"frame": number, "time_s": number}.get(name, value)
                    for name, value in zip(header, rows[state], strict=True)
                ]
            )
            shutil.copy(short / "images" / f"frame_{state:03d}.tif", long / "images" / f"frame_{number:05d}.tif")
    return long


def watched(folder: Path, run: Path) -> dict:
    """Peak memory in MB of the largest process and of all together, CPU seconds, and what the run stores in MB."""
    command = [
        sys.executable,
        "-m",
        "idic",
        "identify",
        str(folder),
        "--out",
        str(run),
        "--workers",
        "1",
        "--memory-limit",
        LIMIT,
        "--sensitivity",
        "direct",
        "--set",
        "options.max_iterations=1",
    ]
    process = psutil.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    worker, together, cpu, stored = 0, 0, {}, 0
    while process.poll() is None:
        total = 0
        for member in (process, *_children(process)):
            try:
                size = member.memory_info().rss
                total += size
                cpu[member.pid] = sum(member.cpu_times()[:2])
                if "spawn_main" in " ".join(member.cmdline()):
                    worker = max(worker, size)
            except psutil.Error:
                continue
        together = max(together, total)
        stored = max(stored, _stored(run))
        time.sleep(0.2)
    if process.returncode not in (0, 3):
        raise SystemExit(process.stderr.read().decode())
    return {
        "worker_mb": worker / 1e6,
        "together_mb": together / 1e6,
        "cpu_s": sum(cpu.values()),
        "stored_mb": stored / 1e6,
    }


def _children(process):
    try:
        return process.children(recursive=True)
    except psutil.Error:
        return []


def _stored(run: Path) -> int:
    """Bytes of all chunks of a run that is being written."""
    total = 0
    for base, _, names in os.walk(run / "run.zarr"):
        for name in names:
            try:
                total += os.stat(os.path.join(base, name)).st_size
            except OSError:
                continue
    return total


def draw(entries: dict, to: Path) -> None:
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6.4, 3.8), layout="constrained")
    for n_free, mark in ((2, "o"), (PIECES, "s")):
        rows = sorted((row for row in entries.values() if row["parameters"] == n_free), key=lambda row: row["frames"])
        frames = [row["frames"] for row in rows]
        axis.plot(frames, [row["worker_mb"] for row in rows], f"{mark}-", label=f"worker process, {n_free} parameters")
        axis.plot(
            frames,
            [row["stored_mb"] for row in rows],
            f"{mark}:",
            color="0.6",
            label=f"images and sensitivities, {n_free} parameters",
        )
    axis.axhline(500, color="crimson", lw=1)
    axis.annotate("--memory-limit 500MB", (frames[0], 520), color="crimson", fontsize=8)
    axis.set(xlabel="frames", ylabel="MB", xscale="log", yscale="log")
    axis.legend(fontsize=8)
    figure.savefig(to, dpi=110)


def main(scratch: Path, lengths: list[int]) -> None:
    scratch.mkdir(parents=True, exist_ok=True)
    store = scratch / "found.json"
    entries = json.loads(store.read_text()) if store.exists() else {}
    short = scratch / "strip"
    if not short.exists():
        write_strip(short)
    for n_frames in lengths:
        for n_free in (2, PIECES):
            name = f"{n_frames}-{n_free}"
            if name in entries:
                continue
            folder = stretched(short, scratch / name, n_frames, n_free)
            entries[name] = {"frames": n_frames, "parameters": n_free} | watched(folder, scratch / f"run-{name}")
            sys.stdout.write(f"{entries[name]}\n")
            sys.stdout.flush()
            store.write_text(json.dumps(entries, indent=1))
            shutil.rmtree(folder)
            shutil.rmtree(scratch / f"run-{name}")
    draw(entries, Path(__file__).parents[2] / "docs" / "evidence" / "memory.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]), [int(word) for word in sys.argv[2:]] or [100, 200, 500, 1000, 2000])
