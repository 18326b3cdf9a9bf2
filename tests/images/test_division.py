"""The division model against its closed form, there and back up to its fold, and what has no image."""

import numpy as np
import pytest

from idic.errors import InputError
from idic.images import LENS_MODELS

DivisionCamera = LENS_MODELS["division"]
ALLOWED = np.zeros(1)  # px; an explicit inverse misses nothing


def lens(l1, l2=0.0):
    return DivisionCamera(1000.0, 1000.0, 0.0, 0.0, l1=l1, l2=l2)


@pytest.mark.parametrize("l1", [-4.0, -0.3, 0.3, 0.9])
def test_with_one_coefficient_the_distorted_radius_solves_a_quadratic_equation(l1):
    radius = np.linspace(0.01, 0.5, 40)  # 0.9: the fold is at 0.527
    position, _ = lens(l1).distort(np.column_stack([0.6 * radius, 0.8 * radius]))
    expected = (1.0 - np.sqrt(1.0 - 4.0 * l1 * radius**2)) / (2.0 * l1 * radius)
    np.testing.assert_allclose(position, expected[:, None] * [0.6, 0.8], rtol=1e-11)  # the difference cancels at 0.01


def test_every_image_in_front_of_fold_and_pole_is_found_again():
    """Up to 0.98 of the distorted radius there: next to a fold the root keeps half of the digits."""
    rng, q = np.random.default_rng(8), np.geomspace(1e-3, 1e2, 20_001)
    for l1, l2 in rng.uniform(-5.0, 5.0, (300, 2)):
        camera, w, rise = lens(l1, l2), 1.0 + l1 * q + l2 * q**2, 1.0 - l1 * q - 3.0 * l2 * q**2
        over = np.flatnonzero((w <= 0.0) | (rise <= 0.0))  # d (ideal radius) / d (distorted radius) = rise / w²
        angle = rng.uniform(0.0, 6.3, 20)
        target = (rng.uniform(0.0, 0.98, 20) * np.sqrt(q[over[0] - 1])) * [np.cos(angle), np.sin(angle)]
        ideal = camera.undistort(target.T, ALLOWED)
        np.testing.assert_allclose(camera.distort(ideal)[0], target.T, rtol=1e-11, atol=1e-13)


def test_a_barrel_has_an_image_of_every_direction_and_its_radius_stays_below_the_pole():
    position, slope = lens(-1.0).distort(np.array([[1.0, 0.0], [1e3, 0.0], [0.0, 1e6]]))
    np.testing.assert_allclose(position[0], [0.5 * (np.sqrt(5.0) - 1.0), 0.0], rtol=1e-14)  # a' / (1 - a'²) = 1
    assert 0.999 < position[1, 0] < position[2, 1] < 1.0 and np.isfinite(slope).all()


@pytest.mark.parametrize(("l1", "l2", "seen", "hidden"), [
    (1.0, 0.0, 0.499, 0.501),  # r / (1 + r²) is 1/2 at most
    (0.0, 1.0, 0.569, 0.571),  # r / (1 + r⁴): 3**0.75 / 4 = 0.5699
])
def test_beyond_the_fold_there_is_no_image_and_the_refusal_names_the_coefficients(l1, l2, seen, hidden):
    camera = lens(l1, l2)
    assert np.isfinite(camera.project(np.array([[seen, 0.0, 1.0]]))).all()
    for of_points in (camera.project, camera.jacobian, camera.parameter_jacobian):
        with pytest.raises(InputError, match="no image of a part of the mesh") as refusal:
            of_points(np.array([[0.0, 0.0, 1.0], [hidden, 0.0, 1.0]]))
        assert refusal.value.key == "l1, l2" and refusal.value.found == "1 of 2 points beyond it"
    with pytest.raises(InputError, match="behind the camera"):
        camera.project(np.array([[hidden, 0.0, 1.0], [0.0, 0.0, -1.0]]))
    fold_px = 1000.0 * (1.0 if l1 else 3.0**-0.25)
    ideal = camera.normalised(np.array([[0.999 * fold_px, 0.0], [1.001 * fold_px, 0.0]]))
    assert np.isfinite(ideal[0]).all() and np.isnan(ideal[1]).all()
