"""Sizes that no experiment has are refused or said before anything is computed; a pipe is no image."""

from __future__ import annotations

import os

import numpy as np
import pytest
from typer.testing import CliRunner

from idic.cli.app import app
from idic.errors import InputError
from idic.experiment_file import load_experiment
from idic.readers import open_stack, roi_mesh
from idic.report import check, expected_cost
from idic.run import identify_run


def test_calibrate_waits_for_no_pipe(tmp_path):
    for name in ("a_0.tif", "a_1.tif"):
        os.mkfifo(tmp_path / name)
    answer = CliRunner().invoke(app, ["calibrate", str(tmp_path), "--spacing", "1", "--out", str(tmp_path / "c.json")])
    assert answer.exit_code == 2 and "not a file" in answer.output and not (tmp_path / "c.json").exists()
    with pytest.raises(InputError, match="not a file"):
        open_stack([tmp_path])


@pytest.mark.parametrize("thickness", ["1e-12", "0.0", "-1.0", "1e-8"])
def test_a_thickness_below_an_atom_is_refused(gallery, thickness):
    with pytest.raises(InputError, match="thickness_mm"):
        load_experiment(gallery("strip").experiment, {"experiment.thickness_mm": thickness})


@pytest.mark.parametrize(("thickness", "is_said"), [("2.0", False), ("0.001", False), ("1e-5", True), ("2000.0", True)])
def test_a_thickness_of_no_sheet_is_said(gallery, thickness, is_said):
    warnings = check(load_experiment(gallery("strip").experiment, {"experiment.thickness_mm": thickness}),
                     draw=False).warnings
    assert any("a sheet in plane stress" in text for text in warnings) == is_said


@pytest.mark.parametrize(("name", "is_said"), [("CPS8", False), ("CPE8", True), ("CAX8", True)])
def test_elements_of_another_state_are_said(gallery, tmp_path, name, is_said):
    folder = gallery("strip").copied(tmp_path).experiment
    deck = folder / "mesh.inp"
    text = deck.read_text()
    assert "CPS8" in text
    deck.write_text(text.replace("CPS8", name))
    notes = load_experiment(folder).notes
    assert any(f"{name} elements" in note and "plane stress" in note for note in notes) == is_said


def test_more_elements_than_any_machine_holds_are_refused_at_once():
    with pytest.raises(InputError, match="does not suit the ROI"):
        roi_mesh((0.0, 0.0, 5000.0, 5000.0), 1.0, down=True)
    assert roi_mesh((0.0, 0.0, 50.0, 50.0), 1.0, down=True).n_elements == 2500


@pytest.mark.parametrize("size", ["0.5", "1e-9"])
def test_an_element_smaller_than_a_pixel_is_refused(gallery, size):
    roi = {"experiment.mesh": f"{{ roi_px = [5, 5, 100, 50], element_px = {size} }}"}
    with pytest.raises(InputError, match="element_px"):
        load_experiment(gallery("strip").experiment, roi)


def test_a_simulation_that_no_memory_holds_is_refused_before_anything_is_written(gallery, tmp_path, monkeypatch):
    """The machine states a small memory: that of a control group."""
    experiment = gallery("strip").experiment
    needed = expected_cost(load_experiment(experiment)).memory
    for share, is_refused in ((5.0, True), (2.0, False)):
        monkeypatch.setattr("idic.report.evidence.cost.memory_here", lambda share=share: needed / share)
        run = tmp_path / f"run-{share:g}"
        if is_refused:
            with pytest.raises(InputError, match="far more memory"):
                identify_run(experiment, run)
            assert not run.exists()
        else:
            identify_run(experiment, run, overrides={"options.max_iterations": 1})
            assert np.isfinite(needed) and (run / "result.json").exists()


@pytest.mark.parametrize("flaw", [["--workers", "100000"], ["--scheduler", "tcp://192.0.2.1:1"]])
def test_a_demo_that_cannot_run_writes_nothing(tmp_path, flaw):
    answer = CliRunner().invoke(app, ["demo", "--out", str(tmp_path / "demo"), "--no-prefect", *flaw])
    assert answer.exit_code == 2 and not (tmp_path / "demo").exists()
