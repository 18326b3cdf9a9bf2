"""Every lens model identifies its coefficients from a virtual recording rendered with it."""

from __future__ import annotations

import numpy as np
import pytest
from moving_sheet import TRUTH, write_moving_sheet

from idic.experiment_file import load_experiment
from idic.identification import evaluate_at, identify
from idic.images import LENS_MODELS


@pytest.mark.parametrize("name", LENS_MODELS)
def test_the_coefficients_of_a_lens_are_identified_from_an_undistorted_start(name, tmp_path):
    example = LENS_MODELS[name].example
    path = write_moving_sheet(tmp_path / "lens", name, dict.fromkeys(example, 0.0), free=example)
    found = identify(load_experiment(path)).result
    assert found["status"] == "converged"
    for key, value in ({f"camera.{key}": value for key, value in example.items()} | TRUTH).items():
        entry = found["parameters"][key]
        assert abs(entry["value"] - value) < 3.0 * entry["std"], key  # noise alone
        assert key in TRUTH or entry["std"] < 0.2 * abs(value), key  # it is determined: zero is 5 deviations away


def test_a_trial_whose_distortion_folds_over_the_specimen_is_rejected_and_ends_nothing(tmp_path):
    """A coefficient that gives the corners no image is an impossible trial, no fault of the input."""
    name = "division"
    experiment = load_experiment(write_moving_sheet(tmp_path / "lens", name, {}, free=LENS_MODELS[name].example))
    values = experiment.model.parameters.as_values() | {"camera.l1": 1e3}
    evaluated, _ = evaluate_at(experiment, values, np.zeros((experiment.model.n_frames, 0)))
    assert evaluated.system is None and "no image of a part of the mesh" in evaluated.message
