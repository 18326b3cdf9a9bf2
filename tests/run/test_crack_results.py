"""Cracks of result.json, whichever way the derivatives of the motion were computed."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
from experiment_file.small_experiment import TOML, write_experiment

CRACK = """
[[crack]]
name = "edge"
path_mm = [[-0.5, 1.5], [3.0, 1.6]]
length_mm = { value = 1.2, identify = true }
"""


@pytest.mark.slow
def test_one_simulation_per_parameter_gives_K_and_J(tmp_path):
    write_experiment(tmp_path / "test", TOML + CRACK)
    command = [sys.executable, "-m", "idic", "identify", str(tmp_path / "test"), "--out", str(tmp_path / "run"),
               "--sensitivity", "perturbed", "--set", "options.max_iterations=1", "--no-prefect", "--no-report",
               "--workers", "0"]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    result = json.loads((tmp_path / "run" / "result.json").read_text())
    assert result["sensitivity"] == "perturbed", done.stderr
    crack = result["cracks"]["edge"]
    assert all(crack[f"{name}_std"][frame] > 0.0 for name in ("K_I", "J") for frame in (1, 2, 3))
