"""The free rubber energy: rubber laws that it contains, its derivatives, and its numbers of knots."""

import numpy as np
import pytest
from pulls import simple_shear

from idic.errors import InputError
from idic.laws import compile, get_law, point

STRAIN = np.linspace(0.0, 1.2, 13)


def test_constant_derivatives_are_mooney_and_rivlins_law(mode):
    law = compile("free_rubber(3+3)")
    values = [660.0, 2.0, 3.0, 3.0, 3.0, 2.0, 0.4, 0.4, 0.4]
    assert len(law.spec.parameters) == len(values)
    ours, theirs = (point.uniaxial(one, own, STRAIN, mode=mode).P if mode != 1 else simple_shear(one, own, STRAIN).P
                    for one, own in ((law, values), (compile("mooney_rivlin"), [3.0, 0.4, 660.0])))
    np.testing.assert_allclose(ours, theirs, atol=1e-9 * np.abs(theirs).max())


def test_the_derivative_by_hand_is_that_of_the_complex_step_on_rising_and_falling_curves():
    values = [660.0, 3.0, 0.5, 0.35, 0.4, 0.9, 3.0, 0.1, 0.0, -0.05]
    curves = [point.uniaxial(compile("free_rubber(4+3)", derivative=how), values, STRAIN, mode=2)
              for how in ("auto", "complex_step")]
    np.testing.assert_allclose(curves[0].dP, curves[1].dP, atol=1e-10 * np.abs(curves[1].dP).max())
    assert np.abs(curves[0].dP[..., 0, 0]).max(axis=0).min() > 0.0  # every parameter is felt


def test_in_tension_the_stress_is_that_of_the_derivatives_by_the_invariants():
    law, values = compile("free_rubber(5)"), np.array([1e6, 4.0, 0.5, 0.4, 0.35, 0.5, 0.9])
    stretch = 1.0 + STRAIN[1:]
    I1 = stretch**2 + 2.0 / stretch - 3.0
    g = np.interp(I1, 4.0 * (np.arange(5) / 4.0) ** 2, values[2:])
    expected = 2.0 * (stretch - stretch**-2) * g
    # of kappa: mu / kappa
    np.testing.assert_allclose(point.uniaxial(law, values, STRAIN).P[1:, 0, 0], expected, rtol=1e-5)


@pytest.mark.parametrize("name", ["free_rubber(2)", "free_rubber(8+4+3)", "free_rubber(x)", "free_rubber(40)"])
def test_other_numbers_of_knots_are_refused(name):
    with pytest.raises(InputError, match="numbers of knots"):
        get_law(name)
