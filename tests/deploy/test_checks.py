"""The checks of deploy/checks on real machinery: two hosts, a Slurm of one node, a Prefect server with a worker."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

CHECKS = sorted((Path(__file__).parents[2] / "deploy" / "checks").glob("*_*.sh"))
CANNOT_RUN = 77
SECONDS = 3600.0


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="bash scripts")
@pytest.mark.parametrize("script", CHECKS, ids=lambda script: script.stem)
def test_a_check_of_the_deployments_holds_or_says_why_it_cannot_run(script):
    answer = subprocess.run(["bash", script], env=dict(os.environ) | {"PYTHON": sys.executable, "PATIENCE": "600"},
                            capture_output=True, text=True, timeout=SECONDS)
    if answer.returncode == CANNOT_RUN:
        pytest.skip(answer.stdout.strip().splitlines()[-1])
    assert answer.returncode == 0, answer.stdout + answer.stderr
    assert answer.stdout.count("ok: ") >= 4
