"""The column of a blur: what a Gaussian takes off an image, and what noise makes of it."""

import numpy as np
import pytest

from idic.correlation.grey import blur_of_noise
from idic.images.quality.lowpass import blur_column, lowpass


def test_a_gaussian_of_small_variance_takes_off_its_variance_times_the_column():
    y, x = np.mgrid[:64, :80]
    k, m = 2.0 * np.pi * 6 / 80, 2.0 * np.pi * 5 / 64
    image = np.cos(k * x) * np.cos(m * y)
    variance = 0.02
    blurred = np.exp(-0.5 * variance * (k**2 + m**2)) * image
    inner = (slice(4, -4), slice(4, -4))  # the mirror at the edge is no wave
    # fourth order at 13 px per wave: (k^4 / 90) of the whole; the exponential's curvature: variance k^2 / 4
    assert image[inner] - blurred[inner] == pytest.approx(variance * blur_column(image)[inner], abs=0.01 * variance)


@pytest.mark.parametrize("lowpass_px", [0.0, 0.6, 1.0])
def test_the_product_of_noise_with_its_own_column_has_the_expected_mean(lowpass_px):
    noise = np.random.default_rng(0).standard_normal((600, 600))
    seen = lowpass(noise, lowpass_px).astype(float)
    product = (seen * blur_column(seen))[5:-5, 5:-5]
    spread = 5.0 * product.std() / np.sqrt(product.size)  # neighbours are correlated: wider than 3 of the mean
    assert product.mean() == pytest.approx(blur_of_noise(lowpass_px), abs=spread)


@pytest.mark.parametrize("lowpass_px", [0.0, 0.6])
def test_so_has_noise_that_neighbours_share(lowpass_px):
    noise = lowpass(np.random.default_rng(1).standard_normal((600, 600)), 0.5).astype(float)
    noise /= noise.std()
    correlation = np.array([[np.mean(noise * np.roll(noise, (i, j), (0, 1))) for j in range(-4, 5)]
                            for i in range(-4, 5)])
    seen = lowpass(noise, lowpass_px).astype(float)
    product = (seen * blur_column(seen))[5:-5, 5:-5]
    spread = 5.0 * product.std() / np.sqrt(product.size)
    assert product.mean() == pytest.approx(blur_of_noise(lowpass_px, correlation), abs=spread)
    assert abs(product.mean() - blur_of_noise(lowpass_px)) > 3.0 * spread  # independent noise has another one
