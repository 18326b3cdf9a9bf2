"""A candidate is one file: written, it stands in the screening and in `idic physics` without another edit."""

import importlib.util
from pathlib import Path

import pytest
from material_twins import TRUTHS
from matrix_of_sides import SIDES
from side_twins import Side, screening, write_folder
from typer.testing import CliRunner

from idic.cli.diagnosis_commands import app
from idic.diagnose import candidate_library
from idic.diagnose.physics import candidate as library
from idic.report.diagnosis.words import sentence

DOCS = Path(__file__).parents[2] / "docs" / "add-a-candidate.md"


def example():
    """The file of the recipe page."""
    text = DOCS.read_text(encoding="utf-8")
    return text.split("```python\n")[1].split("```")[0]


@pytest.fixture
def added(tmp_path, monkeypatch):
    """The candidate of the recipe page, registered from its one file for the time of a test."""
    candidate_library()
    monkeypatch.setattr(library, "_REGISTRY", dict(library._REGISTRY))
    file = tmp_path / "thickness_error.py"
    file.write_text(example(), encoding="utf-8")
    spec = importlib.util.spec_from_file_location("idic.diagnose.candidates.thickness_error", file)
    spec.loader.exec_module(importlib.util.module_from_spec(spec))
    return next(c for c in candidate_library() if c.name == "thickness_error")


def test_a_candidate_of_one_file_is_screened(added, tmp_path):
    found, result = screening(write_folder(tmp_path / "thin", Side(force=lambda F: 0.9 * F)),
                              ("thickness_error", "force_offset", "grip_rotation"))
    ranked = result.of("thickness_error")
    assert ranked.candidate is added and ranked.candidate.side == "bulk"
    assert ranked.visibility < 1e-6 and ranked.standing == "cannot_tell"  # E is free: indistinguishable from it


def test_a_candidate_of_one_file_is_listed(added):
    shown = CliRunner().invoke(app, ["physics", "thickness_error"])
    assert shown.exit_code == 0, shown.output
    text = " ".join(shown.output.split())
    assert "thickness_error" in text and "elastic_form" in text and "caliper" in text
    assert "thickness_error" in CliRunner().invoke(app, ["physics"]).output


def test_a_candidate_of_one_file_is_told_by_its_title(added):
    after = {"BODY.gradient.along_x": {"value": 0.2, "std": 0.01, "unit": ""}}
    content = {"verdict": "single", "named": [added.name], "indistinguishable": [],
               "rounds": [{"winner": added.name, "form": None, "new": list(after)}],
               "candidates": [{"name": added.name, "form": None}], "fit": {"explainable_share_recovered": 0.8},
               "mismatch": {"onset_frame": 0, "visible_frame": 1, "place": None, "side": "bulk"},
               "model": {"parameters_before": {}, "parameters_after": after}, "next_experiment": None}
    assert added.title in sentence(content, {added.name: added.title}).lower()


def test_every_candidate_has_a_twin_in_which_it_is_concealed():
    # test_lens_candidates.py, test_stereo.py; the first and the last are concealed there
    before_a_lens = {"specimen_motion", "focal_length", "placement", "stereo_angle", "camera_time_offset"}
    of_points = {"outline"}  # tests/identify/test_rail_shear.py
    # test_spots.py, test_layered_strip.py, test_crack_candidate.py, test_cyclic_softening.py: with the right parameters
    elsewhere = {"dust", "paint_loss", "layers", "crack", "cyclic_softening"}
    in_volumes = {"scanner_motion", "scanner_magnification"}  # tests/volumes/test_volume_diagnosis.py
    concealed = ({name.split("_of_")[0] for name in TRUTHS} | set(SIDES) | before_a_lens | of_points | elsewhere
                 | in_volumes)
    assert {c.name for c in candidate_library()} <= concealed


def test_every_candidate_is_called_by_its_standard_name_and_paraphrased():
    for candidate in candidate_library():
        assert candidate.title and candidate.paraphrase, candidate.name
    assert "orthotropic elasticity" in {c.title for c in candidate_library()}
