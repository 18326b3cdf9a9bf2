"""A stereo identification of 2 x 2 Mpx images with three parameters: processor seconds and memory over the frames."""

import json
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

pytestmark = [pytest.mark.bench, pytest.mark.slow]

FRAMES, WANTED = (8, 16), 50
GOAL_S, CORES = 300.0, 2
GROWTH = 1.10  # of the memory


def test_a_stereo_identification_of_fifty_frames_takes_five_minutes(tmp_path, measured):
    seconds, memory = [], []
    for frames in FRAMES:
        folder, run = tmp_path / f"test{frames}", tmp_path / f"run{frames}"
        job = Path(__file__).with_name("jobs") / "stereo_job.py"
        subprocess.run([sys.executable, str(job), str(folder), str(frames)], check=True)
        command = [sys.executable, "-m", "idic", "identify", str(folder), "--out", str(run), "--workers", "0",
                   "--no-prefect", "--no-report"]  # fmt: skip
        process, spent, peak = psutil.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL), 0.0, 0
        while process.poll() is None:
            try:
                spent, peak = sum(process.cpu_times()[:2]), max(peak, process.memory_info().rss)
            except psutil.Error:
                break
            time.sleep(0.2)
        assert process.wait() == 0 and json.loads((run / "result.json").read_text())["status"] == "converged"
        seconds.append(spent)
        memory.append(peak / 1e6)
        measured(f"stereo, 2 x {frames} frames of 2 Mpx, 3 parameters", f"{spent:.0f} CPU s", f"{peak / 1e6:.0f} MB")
    per_frame = (seconds[1] - seconds[0]) / (FRAMES[1] - FRAMES[0])
    expected_s = seconds[0] + per_frame * (WANTED - FRAMES[0])
    measured(f"stereo, 2 x {WANTED} frames of 2 Mpx, extrapolated", f"{expected_s:.0f} CPU s",
             f"goal {GOAL_S * CORES:.0f}")
    assert expected_s <= GOAL_S * CORES
    assert memory[1] <= GROWTH * memory[0]
