"""A free rubber energy finds laws that it was not told: stress in modes that the strip does not undergo, the classical
form."""

import numpy as np
import pytest
from free_rubber import FORMS, true_stress, truth_of, write_folder

import idic
from idic.experiment_file import load_experiment
from idic.laws import invariants
from idic.model import build_forward, solve
from idic.report.evidence.rubber import rubber_curves

pytestmark = pytest.mark.slow
CURVES = "I1 = { knots = 8, range = 4.5, C10 = 0.3 }\nI2 = { knots = 5, range = 2.5 }\n"


@pytest.mark.parametrize("form", list(FORMS))
def test_stress_in_unseen_modes_is_the_true_one_within_two_percent_where_the_band_is_no_wider(tmp_path, form):
    truth = truth_of(form)
    path = write_folder(tmp_path / "test", truth, 0, CURVES)
    result = idic.identify(str(path.parent)).content
    assert result["status"] == "converged"
    experiment = load_experiment(path)
    found = experiment.model.parameters.with_values({name: entry["value"] for name,
                                                     entry in result["parameters"].items()
                                               if "_g" in name})
    motions = solve(build_forward(experiment), found).u[-1:]
    curve, = rubber_curves(experiment.model, found, result, motions)
    for mode in curve.modes:
        inside = np.ones(len(mode.stretch), dtype=bool)
        for end, own in zip(truth.reached, invariants(mode.mode, mode.stretch), strict=True):
            inside &= own <= end
        true = true_stress(form, mode.mode, mode.stretch)
        error, std = (mode.stress / true - 1.0)[inside], (mode.std / true)[inside]
        # at the end of the range the band is up to 6 % wide (docs/evidence/free-rubber.md has the errors there)
        assert (np.abs(error) < np.maximum(0.02, std)).all(), mode.mode
    own = next(fit for fit in curve.fits if fit.form == form)
    # Ogden's energy of principal stretches is no sum of functions of I1 and I2: a little is left (19.7 for 7 of
    # freedom)
    assert own.inside or (form == "ogden" and own.chi2 < 4.0 * own.freedom)
    assert next(fit for fit in curve.fits if fit.form == "neo_hooke").chi2 > 100.0

