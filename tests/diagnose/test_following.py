"""Parameters that follow to first order: where a fit begins that a new error has moved."""

from dataclasses import replace

import numpy as np
import pytest
from side_twins import Side, write_folder

from idic.diagnose.discretisation.following import following, moved, share_of_step, shortened
from idic.diagnose.discretisation.weight import weighed
from idic.diagnose import identification_at, residual_evidence
from idic.diagnose.refits.refit import Start, refit
from idic.experiment_file import load_experiment
from idic.identification import identify
from idic.model import MotionError
from idic.parameters import ParameterSet


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    return identify(load_experiment(write_folder(tmp_path_factory.mktemp("clean") / "run", Side())))


def beside(found, values, bounds=None, error=None):
    """The residual at other values: with bounds of some parameters, and a known error."""
    experiment = replace(found.experiment, model=replace(found.experiment.model, motion_error=error))
    kept = [replace(one, bounds=(bounds or {}).get(name, one.bounds)) for name,
            one in experiment.model.parameters.items()]
    experiment = replace(experiment, model=replace(experiment.model, parameters=ParameterSet(kept)))
    return residual_evidence(identification_at(experiment, values, found.local, found.steps), light=False)


def test_parameters_that_are_off_come_back_in_one_step_unless_a_bound_holds_them(found):
    values = found.parameters.as_values()
    name = found.parameters.free[0]
    off = values | {name: 1.01 * values[name]}
    moves, gain = following(beside(found, off))
    assert off[name] + moves[name] == pytest.approx(values[name], rel=2e-3) and gain > 25.0
    held, less = following(beside(found, off, {name: (off[name], 2.0 * off[name])}))
    assert name not in held and less < gain


def test_parameters_follow_an_error_before_it_is_simulated(found):
    """The motion of a stiffer body, less that of the body itself, is an error that the stiffness takes up."""
    values, name = found.parameters.as_values(), found.parameters.free[0]
    here = beside(found, values)
    ways = [list(identification_at(found.experiment, values | {name: part * values[name]}, found.local,
                                   found.steps).march()) for part in (1.0, 1.002)]
    error = MotionError(*(np.array([getattr(b, what) - getattr(a, what) for a, b in zip(*ways, strict=True)])
                          for what in ("u", "channels")))
    assert weighed(here, error).moves[name] == pytest.approx(-0.002 * values[name], rel=0.02)
    assert weighed(here, error.less(error)).moves[name] == pytest.approx(0.0, abs=1e-9 * values[name])


def test_a_step_that_would_carry_a_modulus_to_zero_is_shortened_as_a_whole(found):
    """The bulk modulus of a bent rubber sheet went from 57 MPa to its bound beside bricks, and ended the diagnosis."""
    name, values = found.parameters.free[0], found.parameters.as_values()
    assert found.parameters[name].transform == "log"
    there = moved(found, {name: -2.0 * values[name]}).parameters
    assert there[name].value == pytest.approx(0.5 * values[name])
    assert share_of_step(found.parameters, {name: 0.1 * values[name]}) == 1.0
    assert share_of_step(found.parameters, {name: 0.0}) == share_of_step(found.parameters, {}) == 1.0


def test_a_refit_begins_within_the_range_of_its_parameters(found):
    """The rate of a creep law that imitates yielding began beyond zero, at the logarithm of zero, and stayed there."""
    name, values = found.parameters.free[0], found.parameters.as_values()
    assert shortened(found.parameters, {name: -2.0 * values[name]}) == pytest.approx({name: -0.5 * values[name]})
    there = refit("null", [Start("gone", found.experiment, values | {name: 0.0})], {}, found.local, None)
    assert not there.usable and f"{name} would begin at zero" in there.problem
