"""What a prior states counts in a diagnosis as it does in the identification."""

from pathlib import Path

import numpy as np
import pytest
from side_twins import Side, write_folder

from idic.diagnose.discretisation.following import following
from idic.diagnose.locate.mismatch import parameters_over_windows
from idic.diagnose.locate.onset import MotionRecord
from idic.diagnose import null_model, residual_evidence
from idic.experiment_file import load_experiment
from idic.identification import identify
from idic.parameters import JointPrior, Parameter, ParameterSet, SmoothnessPrior

NU = "BODY.nu"


@pytest.fixture(scope="module")
def stated(tmp_path_factory):
    """A strip of nu = 0.35 whose user is sure of 0.30: identification and residual."""
    folder = write_folder(Path(tmp_path_factory.mktemp("stated")) / "run", Side())
    prior = {"value": 0.30, "identify": True, "prior": {"mean": 0.30, "std": 1e-4}}
    found = identify(load_experiment(folder, {"material.BODY.nu": prior}))
    return found, residual_evidence(found, light=False)


def test_at_its_minimum_a_model_with_a_prior_has_nothing_left_to_move(stated):
    """Without the prior nu would go 470 of its standard deviations, to what the recording shows."""
    found, residual = stated
    steps, gain = following(residual)
    assert found.parameters[NU].value == pytest.approx(0.30, abs=3e-4)
    assert abs(steps[NU]) < 1e-4 and gain < 1.0


def test_the_error_bar_of_a_stated_parameter_is_the_stated_one(stated):
    null = null_model(stated[1].evidence, stated[1].null)
    at = null.names.index(NU)
    assert np.sqrt(null.covariance[at, at]) == pytest.approx(1e-4, rel=0.02)
    np.testing.assert_allclose(null.gram @ null.covariance, np.eye(len(null.b)), atol=1e-6)


def test_from_the_first_frame_on_a_stated_parameter_is_known(stated):
    names, steps, stds = parameters_over_windows(stated[1])
    at = names.index(NU)
    assert np.nanmax(stds[:, at]) < 1.1e-4 and np.nanmax(np.abs(steps[:, at])) < 5e-4


def test_priors_of_all_kinds_add_to_the_equations_of_those_unknowns_that_they_name():
    covariance = np.array([[4.0, 1.0], [1.0, 9.0]])
    parameters = ParameterSet(
        [Parameter("a", 1.0, prior_mean=3.0, prior_std=0.5), Parameter("b", 2.0), Parameter("c", 5.0),
         Parameter("d", 1.0), Parameter("e", 4.0)],
        [JointPrior(("b", "c"), np.array([1.0, 1.0]), covariance), SmoothnessPrior(("d", "e"), ((1.0, -1.0),))])
    names = ["e", "slip", "a", "c", "b", "d"]
    M, b = parameters.prior_equations(names)
    expected, pull, inverse = np.zeros((6, 6)), np.zeros(6), np.linalg.inv(covariance)
    expected[2, 2], pull[2] = 4.0, 8.0
    expected[np.ix_([4, 3], [4, 3])], pull[[4, 3]] = inverse, inverse @ [-1.0, -4.0]
    expected[np.ix_([5, 0], [5, 0])], pull[[5, 0]] = [[1.0, -1.0], [-1.0, 1.0]], [3.0, -3.0]
    np.testing.assert_allclose(M, expected, atol=1e-12)
    np.testing.assert_allclose(b, pull, atol=1e-12)


def test_a_record_that_says_nothing_of_a_parameter_leaves_it_at_what_is_stated():
    """Two parameters, of which the frames see one; the other one is stated as 2 ± 0.5 from here."""
    rng = np.random.default_rng(0)
    J = np.zeros((8, 3, 2))
    J[:, :, 0] = 1.0
    e = rng.standard_normal((8, 3))
    kinds = {"shared": np.zeros(3, dtype=bool), "kappa": np.ones(8), "power": np.ones(8)}
    stated = MotionRecord(e, J, **kinds, precision=np.diag([0.0, 4.0]), pull=np.array([0.0, 8.0]))
    frames = np.arange(8)
    x, chi2, rank = stated.fit(frames)
    alone = stated.data_alone().fit(frames)
    np.testing.assert_allclose(x, [alone[0][0], 2.0])
    assert (rank, alone[2], stated.n_stated) == (2, 1, 1) and chi2 == pytest.approx(alone[1])
