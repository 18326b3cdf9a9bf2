"""A notched tube before two cameras at an angle: a curved surface, elastoplastic, the truth by CalculiX on a finer
mesh."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from notched_tube import VALUES, tube_test, write_tube

TRUTH = {f"BODY.{name}": value for name, value in VALUES.items()}
pytestmark = [pytest.mark.slow,  # ten minutes of a busy processor
              pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")]


def test_the_parameters_of_a_notched_tube_come_back_within_their_standard_deviations(tmp_path):
    (tmp_path / "ccx").mkdir()
    (tmp_path / "tube").mkdir()
    file = write_tube(tmp_path / "tube", tube_test(tmp_path / "ccx"))
    file.write_text(file.read_text().replace("j2_linear", "j2_cauchy"))
    command = [sys.executable, "-m", "idic", "--laws", str(Path(__file__).with_name("cauchy_yield.py")), "identify",
               str(file), "--out", str(tmp_path / "run"), "--no-report", "--no-prefect", "--workers", "0"]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "run" / "result.json").read_text())
    assert result["status"] == "converged"
    found = result["parameters"]
    scores = {name: (found[name]["value"] - true) / found[name]["std"] for name, true in TRUTH.items()}
    print({name: (found[name]["value"], found[name]["std_noise"], found[name]["std"]) for name in TRUTH}, scores)
    assert max(map(abs, scores.values())) < 3.0
