"""Volumes before the test: `idic design` predicts the error bars that an identification from `idic simulate` states."""

import json
import shutil

import numpy as np
import pytest

from idic.errors import InputError
from idic.identification import Plan
from idic.run import identify_run, write_design
from idic.virtual_tests import simulate

PLAN = """
[design]
image_px = [40, 48, 44]
n_frames = 4
noise_std_gv = 2.0
contrast_gv = 30
[design.program]
stroke_mm = [[0, 0], [180, 0.0072]]
"""
# columns along mesh z, rows against mesh x, slices along mesh y; voxels of three sides
SCANNER = """[scanner]
voxel_mm = [0.022, 0.019, 0.02]
origin_px = [4.0, 39.0, 8.0]
axes = ["-row", "+slice", "+col"]
"""


def plan_of(bar, folder, plan=PLAN, scanner=SCANNER):
    """The bar with its scans still to come."""
    text = (bar / "experiment.toml").read_text()
    for key in ("still_frames = [0, 1]\n", "reference = [0, 1]\n", 'loads = "loads.csv"\n'):
        assert key in text
        text = text.replace(key, "")
    head, _, rest = text.partition("[scanner]")
    folder.mkdir()
    shutil.copy(bar / "mesh.inp", folder)
    (folder / "experiment.toml").write_text(head + scanner + rest[rest.index("[material"):] + plan)
    return folder


@pytest.fixture(scope="module")
def design(bar, tmp_path_factory):
    folder = plan_of(bar, tmp_path_factory.mktemp("plans") / "plan")
    return folder, write_design([folder], folder.parent / "design", workers=0)["plans"][0]


def test_an_identification_of_simulated_scans_states_the_predicted_error_bars(design, tmp_path):
    folder, plan = design
    written = simulate(folder, tmp_path / "simulated")
    assert json.loads((written.parent / "truth.json").read_text())["parameters"] == {"BODY.E": 60000.0, "BODY.nu": 0.3}
    start = {"material.BODY.E.value": 66000.0, "material.BODY.nu.value": 0.27}
    result = identify_run(written.parent, tmp_path / "run", overrides=start)
    assert result["status"] == "converged"
    for name, expected in plan["parameters"].items():
        entry = result["parameters"][name]
        assert abs(entry["value"] - expected["value"]) < 3.0 * entry["std"], name
        assert entry["std"] == pytest.approx(expected["std"], rel=0.15), name  # another texture of this contrast
    assert 0.9 < result["residual"]["image_chi2_dof"] < 1.1


def test_the_page_shows_sections_of_the_sensitivities(design):
    folder, plan = design
    assert plan["image_px"] == [40, 48, 44] and plan["pattern"] == "virtual speckle"
    assert plan["parameters"]["BODY.nu"]["std"] > 0.0
    assert list((folder.parent / "design" / "figures").glob("sensitivities*.png"))
    assert "40 × 48 × 44 voxels" in (folder.parent / "design" / "design.html").read_text(encoding="utf-8")


def test_one_scan_is_the_texture_of_all(bar, tmp_path):
    scanner = (bar / "experiment.toml").read_text()
    scanner = scanner[scanner.index("[scanner]"):scanner.index("[material")]
    folder = plan_of(bar, tmp_path / "plan", PLAN.replace("image_px = [40, 48, 44]\n", ""), scanner)
    (folder / "scans").mkdir()
    shutil.copy(bar / "scans" / "scan_01.npy", folder / "scans")
    plan = Plan.of(folder, noise_std_gv=150.0)
    volumes, everything = plan.experiment.recording.volumes, (slice(None),) * 3
    assert plan.pattern == "scan" and volumes.n_frames == 4
    assert plan.experiment.recording.noise.std_gv == 150.0
    np.testing.assert_array_equal(volumes.block(3, *everything), np.load(bar / "scans" / "scan_01.npy"))


@pytest.mark.parametrize("old, new, words", [
    ("image_px = [40, 48, 44]", "image_px = [40, 48]", "3 numbers for scans"),
    ("image_px = [40, 48, 44]\n", "", "there are no images yet"),
    ("n_frames = 4\n", "", "n_frames = 8"),
    ("noise_std_gv = 2.0\n", "", "the noise of the scans is not known"),
    ("stroke_mm = [[0, 0], [180, 0.0072]]", "", "a column without a course"),
])
def test_a_plan_that_is_not_complete(bar, tmp_path, old, new, words):
    assert old in PLAN
    with pytest.raises(InputError) as problem:
        Plan.of(plan_of(bar, tmp_path / "plan", PLAN.replace(old, new)))
    assert words in str(problem.value)
