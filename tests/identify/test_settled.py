"""Searches of a model that is wrong: they end where the misfit makes further steps idle."""

from dataclasses import replace

import numpy as np
import pytest

from idic.correlation import CorrelationSystem, FrameRecord
from idic.identification.step.settled import MAX_NOISE_OF_PIXEL, SETTLED_SHARE, beyond_noise, negligible
from idic.images import still_gain

PIXELS, LOWPASS_PX = 100_000, 1.0


def system(chi2_of_images: float, chi2_of_readings: float) -> CorrelationSystem:
    """Ten frames and two channels; chi-square per pixel and per reading over what noise leaves."""
    nothing = np.zeros(0)
    records = tuple(FrameRecord(k, PIXELS, 0, 1.0, np.ones(2), nothing, np.zeros((0, 1)), nothing, np.zeros((1, 4)),
                                np.zeros((2, 1))) for k in range(10))
    image = chi2_of_images * still_gain(LOWPASS_PX) * PIXELS * len(records)
    return CorrelationSystem(("E",), np.eye(1), np.ones(1), image + chi2_of_readings * 20.0, image, np.eye(1),
                             np.zeros((0, 1)), records)


@pytest.mark.parametrize("of_images", [0.8, 1.0, 1.2])
def test_noise_is_no_misfit_though_it_is_larger_than_stated(of_images):
    assert negligible(system(of_images, 1.0), LOWPASS_PX) == negligible(system(of_images, 4.0), LOWPASS_PX) == 0.0


def test_a_misfit_of_images_or_readings_makes_small_steps_idle():
    images, readings = system(6.0, 1.0), system(1.0, 54_000.0)
    beyond = (6.0 - MAX_NOISE_OF_PIXEL) * still_gain(LOWPASS_PX) * PIXELS * 10
    assert negligible(images, LOWPASS_PX) == pytest.approx(SETTLED_SHARE * beyond)
    assert beyond_noise(readings, LOWPASS_PX) == pytest.approx(54_000.0 * 20.0, rel=1e-3)
    assert negligible(replace(images, generalised=True), LOWPASS_PX) == 0.0
