"""A yield stress that the start puts out of reach: it is lowered until something yields, and no further."""

import numpy as np
import pytest
from twin_runs import FORCE, GRIPS, TRUTH, Twin, solved, write_folder

from idic.identification.step.activation import MAX_REJECTED_ACTIVATIONS, active_parameters, activation_step
from idic.identification.step.parameter_covariance import Scaled
from idic.parameters import Parameter, ParameterSet
from idic_studies.cases.case import CaseJob, render, run_case
from idic_studies.cases.store import StudyStore

PLASTIC = """
[material.BODY]
law = "j2_linear"
E = { value = 1200, unit = "MPa", identify = true }
nu = { value = 0.25, identify = true }
yield_stress = { value = 4000, unit = "MPa", identify = true }
hardening_modulus = { value = 100, unit = "MPa", identify = false }
"""


def body(value=1000.0, **more):
    return ParameterSet([Parameter("a.E", 70e3, free=True, transform="log"),
                         Parameter("a.yield_stress", value, free=True, transform="log", activation_factor=0.6, **more)])


def system(own):
    """Of two unknowns that know nothing of each other, the second by so much."""
    M = np.diag([1e6, own**2])
    return Scaled(("a.E", "a.yield_stress"), M, np.zeros(2), M, np.ones(2))


def test_something_depends_on_a_parameter_where_it_is_known_to_a_factor_e():
    assert active_parameters(system(0.0), body()) == () and active_parameters(system(0.9), body()) == ()
    assert active_parameters(system(1.1), body()) == ("a.yield_stress",)  # and never E, which begins with the test


def test_an_inactive_parameter_takes_an_activation_step_within_its_bounds():
    np.testing.assert_allclose(activation_step(system(0.0), body(), (), 1.0), [0.0, np.log(0.6)])
    np.testing.assert_allclose(activation_step(system(0.0), body(), (), 0.5), [0.0, 0.5 * np.log(0.6)])
    np.testing.assert_allclose(activation_step(system(0.0), body(bounds=(900.0, np.inf)), (), 1.0), [0.0, np.log(0.9)])
    assert not activation_step(system(0.0), body(), ("a.yield_stress",), 1.0).any()
    assert not activation_step(system(0.0), body(np.inf), (), 1.0).any()  # it never yields, and is meant to


@pytest.mark.parametrize(("test", "number", "times"), [
    ("metal", 0, 6.0), pytest.param("bulge", 0, 6.0, marks=pytest.mark.slow), ("bulge", 1, 1.9)])
def test_too_high_a_yield_stress_is_found_nevertheless(test, number, times, tmp_path):
    """The starts at which every schedule failed: the other parameters are up to six times off, and nothing yields.

    In the last one something does, as long as the elastomer is six times too stiff: had a say is not has a say.
    """
    for name, work in ((test, render), (f"{test}-all/600-0{number}", run_case)):
        work(CaseJob(str(tmp_path), "convergence", "reduced", name))
    record = StudyStore(tmp_path).read_case(f"{test}-all/600-0{number}")
    start = dict(zip(record.names, record.arrays["start"] / record.arrays["truth"], strict=True))
    assert record.converged and np.abs(record.normalised_error).max() < 3.5
    assert next(value for name, value in start.items()
                if name.endswith("yield_stress")) == pytest.approx(times, abs=0.05)


def test_a_test_that_never_yields_says_so_after_a_few_attempts(tmp_path):
    """The truth yields far beyond: the yield stress goes down until it does harm; E and nu are found, it is not."""
    truth = TRUTH | {"yield_stress": 1e5, "hardening_modulus": 100.0}
    path = write_folder(tmp_path / "test", Twin(law="j2_linear", truth=truth), PLASTIC + GRIPS + FORCE)
    state, result = solved(path)
    assert result["status"] == "converged" and state.activation.active == ()
    lowest = min(entry["values"]["BODY.yield_stress"] for entry in state.history)
    assert lowest < 100.0 and 0 < state.activation.rejections <= MAX_REJECTED_ACTIVATIONS  # stresses: 40 MPa
    assert state.evaluations < 25
    assert [entry["name"] for entry in result["not_identifiable"]] == ["BODY.yield_stress"]
    for name in ("E", "nu"):
        entry = result["parameters"][f"BODY.{name}"]
        assert abs(entry["value"] - TRUTH[name]) < 4.0 * entry["std"]
