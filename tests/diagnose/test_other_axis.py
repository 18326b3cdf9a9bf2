"""Two axes of an orthotropic law that one recording does not tell apart."""

from dataclasses import replace

import numpy as np
import pytest

from idic.diagnose import Fit, Misfit
from idic.diagnose.selection.moves.other_axis import MIN_CHI2, is_another_answer, is_better, same_axes

VALUES = {"BODY.E1": 3000.0, "BODY.E2": 1500.0, "BODY.nu12": 0.4, "BODY.G12": 700.0, "BODY.angle": 20.0}


def fitted(values, chi2=100.0, **stds):
    fit = Misfit(np.arange(4), np.full(4, 25.0 + chi2 / 4.0), np.full(4, 25.0), np.zeros((4, 0)), 1.0)
    return Fit("enriched", "", "converged", values, dict.fromkeys(values, 5.0) | stds, np.zeros((4, 1)), None, fit,
               None)


def test_an_axis_across_with_its_moduli_exchanged_is_the_same_law():
    across = {"BODY.E1": 1500.0, "BODY.E2": 3000.0, "BODY.nu12": 0.2, "BODY.G12": 700.0, "BODY.angle": 110.0}
    assert same_axes(across, VALUES) == pytest.approx(VALUES)
    assert not is_another_answer(fitted(across), fitted(VALUES))


@pytest.mark.parametrize(("chi2", "told"), [(100.0, True), (99.0 + MIN_CHI2, True), (101.0 + MIN_CHI2, False)])
def test_other_moduli_that_fit_as_well_are_another_answer(chi2, told):
    other = fitted(VALUES | {"BODY.E1": 1800.0, "BODY.angle": 45.0}, chi2)
    assert is_another_answer(other, fitted(VALUES)) is told
    assert not is_another_answer(replace(other, stds=dict.fromkeys(VALUES, 900.0)), fitted(VALUES))  # known so badly
    assert not is_another_answer(fitted(VALUES | {"BODY.angle": 25.0}), fitted(VALUES))  # the same moduli


def test_the_recording_decides_where_it_can():
    assert is_better(fitted(VALUES, 99.0 - MIN_CHI2), fitted(VALUES)) is True
    assert is_better(fitted(VALUES, 101.0 - MIN_CHI2), fitted(VALUES)) is False
