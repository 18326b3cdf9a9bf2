"""Windows of an image against `scipy.ndimage`, whose answers they give without its import."""

import subprocess
import sys

import numpy as np
import pytest
import scipy

from idic.windows import away_from_edges, smoothed, weighted_along, window_all, window_any, window_mean

BELL = np.exp(-0.5 * np.arange(-4.0, 5.0) ** 2)


@pytest.fixture
def image():
    return np.random.default_rng(0).normal(100.0, 50.0, (57, 83))


@pytest.fixture
def mask():
    return np.random.default_rng(1).random((57, 83)) > 0.97


@pytest.mark.parametrize("precision", [float, np.float32])
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("taps", [BELL, np.array([1.0, -2.0, 1.0]), np.convolve(BELL, [-0.5, 0.0, 0.5])])
def test_weighted_sums_have_the_bits_of_scipy(image, taps, axis, precision):
    image = image.astype(precision)
    assert np.array_equal(weighted_along(image, taps, axis), scipy.ndimage.correlate1d(image, taps, axis=axis))


@pytest.mark.parametrize("std_px", [0.7, 1.0, 2.3])
def test_a_gaussian_blur_has_the_bits_of_scipy(image, std_px):
    for part in (image.astype(np.float32), image, image[:3, :3]):
        assert np.array_equal(smoothed(part, std_px), scipy.ndimage.gaussian_filter(part, std_px))


@pytest.mark.parametrize("size", [3, 4, 31, 57])
def test_means_and_extremes_are_those_of_scipy(image, mask, size):
    np.testing.assert_allclose(window_mean(image, size), scipy.ndimage.uniform_filter(image, size), rtol=1e-12)
    assert np.array_equal(window_any(mask, size), scipy.ndimage.maximum_filter(mask, size))
    assert np.array_equal(window_all(~mask, size), scipy.ndimage.minimum_filter(~mask, size))


@pytest.mark.parametrize("steps", [1, 4])
def test_pixels_away_from_edges_are_an_erosion(mask, steps):
    assert np.array_equal(away_from_edges(~mask, steps), scipy.ndimage.binary_erosion(~mask, iterations=steps))


def test_they_need_no_scipy():
    code = "import sys, idic.windows; print(sorted(name for name in sys.modules if name.startswith('scipy')))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "[]\n"
