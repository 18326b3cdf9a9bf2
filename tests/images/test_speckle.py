"""The measured size of a speckle against patterns whose autocorrelation is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.special import erf

from idic.images import edge_blur, speckle_size

WIDTH = 2.0 * np.sqrt(2.0 * np.log(2.0))  # full width at half maximum of a Gaussian over its standard deviation


def blurred_noise(sigma, shape=(400, 500), seed=0):
    noise = np.random.default_rng(seed).standard_normal(shape)
    return 100.0 + 30.0 * sigma * gaussian_filter(noise, sigma, mode="wrap")


@pytest.mark.parametrize("sigma", [1.0, 2.0, 4.0])
def test_noise_blurred_by_a_gaussian_has_the_width_of_its_own_correlation(sigma):
    # blur of standard deviation s correlates as a Gaussian of sqrt(2) s; rings of width 1 px average a little
    found = speckle_size(blurred_noise(sigma), np.ones((400, 500), bool))
    assert found == pytest.approx(WIDTH * np.sqrt(2.0) * sigma, rel=0.05)


def test_black_discs_have_four_fifths_of_their_diameter():
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:500, :500]
    image = np.full((500, 500), 200.0)
    for cy, cx in rng.uniform(0, 500, (500, 2)):
        image[np.hypot(y - cy, x - cx) < 5.0] = 20.0
    # the overlap of two discs falls to half at 0.404 diameters; 500 of them scatter by some percent
    assert speckle_size(image, np.ones((500, 500), bool)) == pytest.approx(0.81 * 10.0, rel=0.12)


def test_the_place_and_shape_of_the_region_do_not_matter():
    image, region = blurred_noise(2.0), np.zeros((400, 500), bool)
    y, x = np.mgrid[:400, :500]
    region[(np.hypot(y - 200, x - 260) < 150) & (np.hypot(y - 200, x - 260) > 40)] = True
    image[~region] = 1000.0  # a bright background must not be seen
    assert speckle_size(image, region) == pytest.approx(WIDTH * np.sqrt(2.0) * 2.0, rel=0.08)


def vignette(image):
    y, x = np.mgrid[:400, :500]
    return image / (1.0 + (np.hypot(y - 200, x - 250) / 280.0) ** 2) ** 2  # cos^4: a sixth in the corners


def grips(image):
    image = image.copy()
    image[:, :120], image[:, 400:] = 235.0, 20.0  # bright and dark, without a pattern
    return image


@pytest.mark.parametrize("world", [vignette, grips, lambda image: grips(vignette(image)),
                                   lambda image: image * np.linspace(0.3, 1.0, 500)])
@pytest.mark.parametrize("sigma", [1.0, 2.4])
def test_uneven_light_and_places_without_pattern_do_not_widen_the_speckle(world, sigma):
    image = world(blurred_noise(sigma)) + np.random.default_rng(4).normal(0.0, 1.0, (400, 500))
    # a twentieth, as without them; the other twentieth is that of weights where the light is uneven
    assert speckle_size(image, np.ones((400, 500), bool), 1.0) == pytest.approx(WIDTH * np.sqrt(2.0) * sigma, rel=0.1)


def test_camera_noise_does_not_make_the_speckle_finer():
    clean, region = blurred_noise(2.0), np.ones((400, 500), bool)
    noisy = clean + 20.0 * np.random.default_rng(5).standard_normal(clean.shape)
    assert speckle_size(noisy, region, 20.0) == pytest.approx(speckle_size(clean, region), rel=0.03)
    assert speckle_size(noisy, region) < 0.9 * speckle_size(clean, region)


def test_without_a_pattern_there_is_no_size():
    region = np.ones((200, 200), bool)
    assert speckle_size(np.full((200, 200), 7.0), region) is None
    assert speckle_size(blurred_noise(2.0), np.zeros((400, 500), bool)) is None
    ramp = np.tile(np.linspace(0.0, 1.0, 400), (400, 1))
    assert speckle_size(ramp, np.ones_like(ramp, bool)) is None


@pytest.mark.parametrize("blur_px", [0.7, 2.0, 3.5])
def test_the_blur_of_the_edges_is_that_of_a_blurred_step_under_noise(blur_px):
    generator = np.random.default_rng(1)
    step = 120.0 + 80.0 * erf((np.arange(200.0) - 99.5) / (np.sqrt(2.0) * blur_px))
    image = step + generator.normal(0, 3, (200, 200))
    assert edge_blur(image, np.ones(image.shape, dtype=bool), 3.0) == pytest.approx(blur_px, abs=0.1)
