"""Peak memory of whole identifications of the same test with 50 and with 800 frames: it must not grow with them.

All 800 images together are 48 MB, their splines 200 MB: a run that kept either would show it.
"""

import csv
import shutil
import subprocess
import sys
import time

import psutil
import pytest

from idic.virtual_tests import EXAMPLES, write_example
from idic.virtual_tests import DemoSize, strip

pytestmark = [pytest.mark.bench, pytest.mark.slow]

FEW, HOLD = 50, 16  # frames; every state of the long test is held for so many of them
SIZE = DemoSize(0.1, (200, 300), (15, 15, 20), (2, 2, 1), (3, 4, 2), 1)  # 50 frames, a small mesh
GROWTH = 1.10


@pytest.fixture(scope="module")
def experiments(tmp_path_factory):
    """Folders of the short and of the long test."""
    root = tmp_path_factory.mktemp("memory")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(EXAMPLES, "frames", lambda reduced, foreign: strip(SIZE))
        short = write_example("frames", root / "short").parent
    long = root / "long"
    (long / "images").mkdir(parents=True)
    for name in ("experiment.toml", "mesh.inp"):
        shutil.copy(short / name, long / name)
    with open(short / "loads.csv", newline="") as file:
        header, *rows = csv.reader(file)
    assert len(rows) == FEW
    with open(long / "loads.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        for k, row in enumerate(rows):
            for j in range(HOLD):
                number = HOLD * k + j
                writer.writerow([{"frame": number, "time_s": number}.get(name, value)
                                 for name, value in zip(header, row, strict=True)])  # fmt: skip
                shutil.copy(short / "images" / f"frame_{k:03d}.tif", long / "images" / f"frame_{number:03d}.tif")
    return {FEW: short, FEW * HOLD: long}


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
