"""Strain from the deformation gradient, against closed forms."""

import numpy as np
import pytest

from idic.errors import InputError
from idic.measure.fields.series import component_of
from idic.measure.fields.strain import principal, von_mises
from idic.measure import rotated, strain

ROUNDING = 1e-14


def rotation(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


@pytest.mark.parametrize("measure", ["green_lagrange", "hencky"])
def test_a_rotation_strains_nothing(measure):
    assert np.abs(strain(rotation(0.7), measure)).max() < ROUNDING


def test_small_strain_takes_a_rotation_for_a_strain():
    assert strain(rotation(0.7), "small")[0, 0] == pytest.approx(np.cos(0.7) - 1.0)


@pytest.mark.parametrize("stretch", [0.5, 1.0, 1.3])
def test_uniaxial_stretch_has_the_strains_of_the_textbook(stretch):
    F = np.diag([stretch, 1.0])
    assert strain(F, "green_lagrange")[0, 0] == pytest.approx((stretch**2 - 1.0) / 2.0, abs=ROUNDING)
    assert strain(F, "hencky")[0, 0] == pytest.approx(np.log(stretch), abs=ROUNDING)
    assert strain(F, "small")[0, 0] == pytest.approx(stretch - 1.0, abs=ROUNDING)


def test_simple_shear_has_the_principal_logarithms_of_its_stretches():
    gamma = 0.4
    F = np.array([[1.0, gamma], [0.0, 1.0]])
    E = strain(F, "green_lagrange")
    assert np.allclose(E, [[0.0, gamma / 2], [gamma / 2, gamma**2 / 2]], atol=ROUNDING)
    largest = np.log(gamma / 2 + np.sqrt(1.0 + gamma**2 / 4))  # lambda - 1/lambda = gamma, area is kept
    assert np.allclose(principal(strain(F, "hencky")), [largest, -largest], atol=ROUNDING)


@pytest.mark.parametrize("measure", ["green_lagrange", "hencky"])
def test_a_rotation_after_the_strain_changes_nothing(measure):
    F = np.array([[1.1, 0.2], [-0.05, 0.9]])
    assert np.allclose(strain(rotation(1.2) @ F, measure), strain(F, measure), atol=ROUNDING)


def test_other_axes_keep_the_invariants_and_show_the_principal_directions():
    E = strain(rotation(0.3) @ np.diag([1.2, 0.9]) @ rotation(0.3).T, "hencky")
    turned = rotated(E, np.degrees(0.3))
    assert np.allclose(turned, np.diag([np.log(1.2), np.log(0.9)]), atol=ROUNDING)
    assert component_of(E, "1") == pytest.approx(np.log(1.2)) and component_of(E, "2") == pytest.approx(np.log(0.9))
    assert component_of(E, "max_shear") == pytest.approx(np.log(1.2 / 0.9) / 2)


def test_a_spatial_tensor_is_turned_about_z():
    E = np.diag([3.0, 1.0, 7.0])
    assert np.allclose(rotated(E, 90.0), np.diag([1.0, 3.0, 7.0]), atol=ROUNDING)
    assert np.allclose(principal(E), [7.0, 3.0, 1.0])


def test_nodes_that_are_not_seen_stay_unknown():
    F = np.stack([np.full((2, 2), np.nan), np.diag([1.1, 1.0])])
    H = strain(F, "hencky")
    assert np.isnan(H[0]).all() and H[1, 0, 0] == pytest.approx(np.log(1.1))
    assert np.isnan(principal(H)[0]).all()


def test_the_equivalent_stress_is_that_of_tension_and_of_shear():
    assert von_mises(np.diag([5.0, 0.0])) == pytest.approx(5.0) == von_mises(np.diag([5.0, 0.0, 0.0]))
    assert von_mises(np.array([[0.0, 2.0], [2.0, 0.0]])) == pytest.approx(2.0 * np.sqrt(3.0))


def test_an_unknown_measure_is_refused():
    with pytest.raises(InputError, match="no such strain"):
        strain(np.eye(2), "true")
