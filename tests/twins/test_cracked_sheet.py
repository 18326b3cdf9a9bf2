"""The length of a crack that grows, and what loads its tip, from images of a sheet whose truth is CalculiX's."""

from __future__ import annotations

import csv
import json
import shutil
import subprocess
import sys

import numpy as np
import pytest
from twins.cracked_sheet import E, FORCES, LENGTHS, NU, WIDTH, release_rate, write_sheet

N_ACROSS = 20  # elements

pytestmark = [pytest.mark.slow, pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sheet")
    file = write_sheet(folder / "test", folder / "ccx", n_across=N_ACROSS)
    command = [sys.executable, "-m", "idic", "identify", str(file), "--out", str(folder / "run"), "--no-prefect",
               "--workers", "0"]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


def test_the_tip_is_found_in_every_frame_within_a_tenth_of_an_element(run):
    result = json.loads((run / "run" / "result.json").read_text())
    crack = result["cracks"]["edge"]
    assert result["residual"]["image_chi2_dof"] == pytest.approx(1.0, abs=0.02)
    assert crack["length_mm"][1:] == pytest.approx(LENGTHS[1:], abs=0.1 * WIDTH / N_ACROSS)
    assert result["parameters"]["SHEET.E"]["value"] == pytest.approx(E, rel=0.005)
    assert result["parameters"]["SHEET.nu"]["value"] == pytest.approx(NU, abs=0.01)
    assert all(0.03 <= std < 0.045 for std in crack["length_mm_std"])


def test_the_energy_release_rate_is_that_of_calculix(run):
    crack = json.loads((run / "run" / "result.json").read_text())["cracks"]["edge"]
    for frame in (1, len(LENGTHS) - 1):
        truth = release_rate(run / "ccx", LENGTHS[frame]) * FORCES[frame]**2
        K, mode, J = (crack[name][frame] for name in ("K_I", "K_II", "J"))
        assert J == pytest.approx(truth, rel=0.02)
        assert np.hypot(K, mode) == pytest.approx(np.sqrt(E * truth / 1000.0), rel=0.02)
        assert 0.0 < crack["J_std"][frame] < 0.02 * J


def test_the_table_holds_what_the_result_does_and_the_page_shows_it(run):
    crack = json.loads((run / "run" / "result.json").read_text())["cracks"]["edge"]
    rows = list(csv.DictReader((run / "run" / "tables" / "cracks.csv").open()))
    assert [float(row["J_N_per_mm"]) for row in rows[1:]] == pytest.approx(crack["J"][1:])
    assert rows[0]["K_I_MPa_sqrt_m"] == "" and (run / "run" / "figures" / "crack_edge.png").is_file()
    assert "How do cracks grow?" in (run / "run" / "report.html").read_text()
