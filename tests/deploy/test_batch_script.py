"""deploy/idic.sbatch returns to the queue where its time is over, and nowhere else."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "deploy" / "idic.sbatch"
IDIC = """#!/bin/bash
trap 'exit 4' TERM
touch "$STARTED"
[ -n "$PAUSES" ] && exit 4
for _ in $(seq 200); do sleep 0.05; done
"""
SCONTROL = """#!/bin/bash
case "$1" in
    show) echo "JobId=7 JobName=idic"; echo "   JobState=$STATE Reason=None" ;;
    requeue) touch "$REQUEUED" ;;
esac
"""


@pytest.mark.skipif(os.name != "posix", reason="a bash script")
@pytest.mark.parametrize(("told", "state", "requeued"), [
    (True, "RUNNING", True),  # two minutes before the walltime
    (True, "COMPLETING", False), (True, "CANCELLED", False),  # scancel
    (False, "RUNNING", False)])  # --pause-after
def test_a_job_goes_back_into_the_queue_at_its_walltime_and_not_after_a_pause_or_scancel(tmp_path, told, state,
                                                                                         requeued):
    for name, text in (("python", IDIC), ("scontrol", SCONTROL)):
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    own = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "PYTHON": "python", "SLURM_JOB_ID": "7", "STATE": state,
           "STARTED": str(tmp_path / "started"), "REQUEUED": str(tmp_path / "requeued"), "PAUSES": "" if told else "1"}
    job = subprocess.Popen(["bash", SCRIPT, "identify", "test"], env=dict(os.environ) | own)
    if told:
        end = time.monotonic() + 30.0
        while not (tmp_path / "started").exists() and time.monotonic() < end:
            time.sleep(0.02)
        job.send_signal(signal.SIGTERM)
    code = job.wait(30.0)
    assert (tmp_path / "requeued").exists() == requeued
    assert code == (0 if requeued else 4)
