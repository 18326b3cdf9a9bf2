"""Saturated pixels are known by the largest value of the sensor, whatever depth the file has."""

import numpy as np
import pytest

from idic.images import largest_value, saturated_share, sensor_levels

REGION = np.ones((40, 50), dtype=bool)


def speckle(bits, shift, exposure):
    """Grey values of a sensor of so many bits, in the upper ones of 16 by `shift`; exposure : of which 1 fills it"""
    value = exposure * np.linspace(0.0, 1.0, REGION.size).reshape(REGION.shape) * (2**bits - 1)
    image = np.clip(np.rint(value), 0, 2**bits - 1).astype(np.uint16 if bits > 8 else np.uint8)
    return image << shift


@pytest.mark.parametrize("bits, shift", [(8, 0), (10, 0), (12, 0), (12, 4), (14, 2), (16, 0)])
def test_pixels_at_the_limit_of_the_sensor_are_saturated(bits, shift):
    """4095 of a 12-bit camera is stored in 16 bits, where only 65535 was taken for saturated."""
    image = speckle(bits, shift, 1.25)
    assert largest_value(image) == (2**bits - 1) << shift
    assert saturated_share(image, REGION) == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_a_well_exposed_image_is_not_saturated(bits):
    assert saturated_share(speckle(bits, 0, 0.8), REGION) == 0.0


def test_of_floats_and_an_empty_region_nothing_is_known():
    assert saturated_share(speckle(12, 0, 1.25).astype(np.float32), REGION) is None
    assert saturated_share(speckle(12, 0, 1.25), ~REGION) is None


@pytest.mark.parametrize("dtype, top, bits", [(np.uint8, 90, 8), (np.uint16, 3000, 12), (np.uint16, 20000, 16),
                                              (np.uint16, 4095 << 4, 16), (float, 200.0, 8)])
def test_the_levels_of_a_sensor_are_those_of_the_fewest_bits_that_hold_its_image(dtype, top, bits):
    """Also of a dim image: 20000 of 65536 is no sensor of 15 bits."""
    assert sensor_levels(np.array([[0, top]], dtype=dtype)) == 2**bits
