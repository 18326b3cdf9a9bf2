"""Peak memory of whole identifications of the same test with few and with many frames: it must not grow with them.

All 800 small images together are 48 MB, their splines 200 MB, 200 images of 2 Mpx 400 MB: a run that kept any would
show it.
"""

import csv
import shutil
import subprocess
import sys
import time

import psutil
import pytest

from idic.virtual_tests import EXAMPLES, DemoSize, strip, write_example

pytestmark = [pytest.mark.bench, pytest.mark.slow]

FEW, HOLD = 50, 16  # frames; every state of the long test is held for so many of them
SIZE = DemoSize(0.1, (200, 300), (15, 15, 20), (2, 2, 1), (3, 4, 2), 1)  # 50 frames, a small mesh
LARGE = DemoSize(0.015, (1000, 2000), (3, 3, 4), (4, 6, 3), (5, 7, 4), 1)  # 10 states in images of 2 Mpx
GROWTH = 1.10
GOAL_MIB = 700  # of the process that identifies 200 frames of 2 Mpx


def written(root, size: DemoSize, n_states: int, holds) -> dict:
    """Folders of the same test with every state held for so many frames, by their number of frames."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(EXAMPLES, "frames", lambda reduced, foreign: strip(size))
        states = write_example("frames", root / "states").parent
    with open(states / "loads.csv", newline="") as file:
        header, *rows = csv.reader(file)
    assert len(rows) == n_states
    folders = {}
    for hold in holds:
        folder = folders[n_states * hold] = root / str(hold)
        (folder / "images").mkdir(parents=True)
        for name in ("experiment.toml", "mesh.inp"):
            shutil.copy(states / name, folder / name)
        with open(folder / "loads.csv", "w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(header)
            for number in range(n_states * hold):
                k = number // hold
                writer.writerow([{"frame": number, "time_s": number}.get(name, value)
                                 for name, value in zip(header, rows[k], strict=True)])  # fmt: skip
                (folder / "images" / f"frame_{number:03d}.tif").hardlink_to(states / "images" / f"frame_{k:03d}.tif")
    return folders


@pytest.fixture(scope="module")
def experiments(tmp_path_factory):
    """Folders of the short and of the long test."""
    return written(tmp_path_factory.mktemp("memory"), SIZE, FEW, (1, HOLD))


def peak(command) -> tuple[float, float]:
    """Largest resident memory (MB) of the process, and of it with all that it started, while it runs."""
    process = psutil.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    largest, together = 0, 0
    while process.poll() is None:
        family = []
        for member in (process, *_children(process)):
            try:
                family.append(member.memory_info().rss)
            except psutil.Error:
                continue
        largest, together = max(largest, family[0] if family else 0), max(together, sum(family))
        time.sleep(0.1)
    assert process.returncode in (0, 3), process.stderr.read().decode()  # 3: stopped after two iterations
    return largest / 1e6, together / 1e6


def _children(process):
    try:
        return process.children(recursive=True)
    except psutil.Error:
        return []


@pytest.mark.parametrize("workers", [0, 2])
def test_memory_does_not_grow_with_the_number_of_frames(experiments, workers, tmp_path, measured):
    peaks = {}
    for n, folder in experiments.items():
        command = [sys.executable, "-m", "idic", "identify", str(folder), "--out", str(tmp_path / str(n)), "--workers",
                   str(workers), "--set", "options.max_iterations=2"]  # fmt: skip
        of_command, together = peak(command)
        peaks[n] = together if workers else of_command
    short, long = peaks[FEW], peaks[FEW * HOLD]
    processes = f"all processes, {workers} workers" if workers else "its one process"
    measured(f"peak memory of idic identify, 800 frames of 300 x 200 px ({processes})", f"{long:.0f} MB",
             f"50 frames {short:.0f} MB: {100 * (long / short - 1):+.0f} %")  # fmt: skip
    assert long / short < GROWTH


def test_200_frames_of_2_mpx_take_no_more_than_20(tmp_path, measured):
    peaks = {}
    for n, folder in written(tmp_path, LARGE, 10, (2, 20)).items():
        command = [sys.executable, "-m", "idic", "identify", str(folder), "--out", str(tmp_path / f"run-{n}"),
                   "--no-prefect", "--workers", "0", "--set", "options.max_iterations=2"]  # fmt: skip
        peaks[n], _ = peak(command)
    short, long = peaks.values()
    measured("peak memory of idic identify, 200 frames of 2000 x 1000 px", f"{long / 1.048576:.0f} MiB",
             f"20 frames {short / 1.048576:.0f} MiB: {100 * (long / short - 1):+.0f} %; goal {GOAL_MIB} MiB")
    assert long / short < GROWTH
