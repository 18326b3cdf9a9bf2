"""What every camera keeps to: a class of tests that the tests of each camera inherit."""

from __future__ import annotations

import numpy as np
import pytest

from idic.errors import InputError


class CameraContract:
    """cameras : by name; parameters : degrees of freedom; points : (n, 2|3) mm; steps : of difference quotients, in the
    unit of the parameter, where the usual one is too large"""

    cameras: dict
    parameters: tuple[str, ...]
    points: np.ndarray
    steps: dict[str, float] = {}

    def pytest_generate_tests(self, metafunc):
        if "camera" in metafunc.fixturenames:
            metafunc.parametrize("camera", self.cameras.values(), ids=self.cameras.keys())
        if "name" in metafunc.fixturenames:
            metafunc.parametrize("name", self.parameters)

    def test_the_jacobian_is_the_derivative_of_the_projection(self, camera):
        step, jacobian = 1e-4, camera.jacobian(self.points)  # mm; error step² and rounding 1e-13 / step, both ~1e-9
        for axis in range(self.points.shape[1]):
            e = np.eye(self.points.shape[1])[axis] * step
            quotient = (camera.project(self.points + e) - camera.project(self.points - e)) / (2 * step)
            assert np.abs(quotient - jacobian[:, :, axis]).max() < 1e-7

    def test_every_parameter_derivative_is_a_difference_quotient(self, camera, name):
        value = camera.values()[name]
        step = self.steps.get(name, 1e-5 * max(1.0, abs(value)))
        ahead, behind = (camera.with_parameters({name: value + s * step}).project(self.points) for s in (1, -1))
        slope = camera.parameter_jacobian(self.points, name)
        # step² of the third derivative; rounding 1e-12 px over the step
        assert np.abs((ahead - behind) / (2 * step) - slope).max() < 1e-6 * np.abs(slope).max() + 1e-7
        assert np.abs(slope).max() > 0.0

    def test_a_pixel_shows_the_point_of_the_plane_that_is_projected_onto_it(self, camera):
        plane = np.column_stack([self.points[:, :2], np.zeros(len(self.points))])
        assert np.abs(camera.inverse(camera.project(plane)) - self.points[:, :2]).max() < 1e-10  # mm

    def test_setting_the_present_values_changes_nothing(self, camera):
        again = camera.with_parameters(camera.values())
        assert np.abs(again.project(self.points) - camera.project(self.points)).max() < 1e-11  # rounding

    def test_an_unknown_parameter_is_refused_by_name(self, camera):
        with pytest.raises(InputError, match="zoom"):
            camera.with_parameters({"zoom": 1.0})
