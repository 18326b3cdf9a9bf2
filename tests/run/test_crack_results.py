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


@pytest.mark.slow
def test_of_experiments_identified_together_each_crack_is_judged_with_the_covariance_of_all(tmp_path):
    for name in ("first", "second"):
        write_experiment(tmp_path / name, TOML + CRACK)
    command = [sys.executable, "-m", "idic", "identify", str(tmp_path / "first"), str(tmp_path / "second"), "--out",
               str(tmp_path / "run"), "--set", "options.max_iterations=1", "--no-prefect", "--no-report",
               "--workers", "0"]  # fmt: skip
    subprocess.run(command, capture_output=True, check=False)  # ends with its limit of iterations
    result = json.loads((tmp_path / "run" / "result.json").read_text())
    assert set(result["cracks"]) == {"first.edge", "second.edge"}
    part = json.loads((tmp_path / "run" / "experiments" / "first" / "result.json").read_text())
    assert part["cracks"]["edge"] == result["cracks"]["first.edge"]
    length = result["parameters"]["first.crack.edge.length"]
    element = 0.06 * 1.0  # elements of the small experiment are about 1 mm
    std = result["cracks"]["first.edge"]["length_mm_std"][1]
    assert length["std"] < std < length["std"] + element
