"""Noise estimates against noise that is known; stacks of images."""

import numpy as np
import pytest
from scipy import ndimage

from idic.errors import InputError
from idic.images import ArrayStack, NoiseModel, gap_mark, image_noise, lowpass, still_gain, still_noise


def speckle(std_px=2.0, shape=(200, 300), seed=0):
    f = ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=shape), std_px)
    return 128 + 40 * f / f.std()


@pytest.mark.parametrize("std", [0.5, 2.55, 8.0])
def test_still_frames_give_the_noise_in_spite_of_drifting_light_and_vibration(std):
    rng, f = np.random.default_rng(1), speckle()
    images = [ndimage.shift(f, (0.02 * k, 0.01 * k), order=5, mode="mirror") * (1 - 0.01 * k) + k
              + rng.normal(scale=std, size=f.shape) for k in range(3)]
    # 120 000 differences: 0.3 % of one standard deviation; what the linear shift leaves of the texture: < 0.5 %
    assert abs(still_noise(images).std_gv / std - 1) < 0.015


def test_eight_bit_rounding_adds_its_twelfth():
    rng, f = np.random.default_rng(2), speckle()
    images = [np.rint(f + rng.normal(scale=1.5, size=f.shape)).clip(0, 255).astype(np.uint8) for _ in range(3)]
    assert abs(still_noise(images).std_gv / np.sqrt(1.5**2 + 1 / 12) - 1) < 0.015  # as above


def test_noise_that_grows_with_the_grey_value_is_found():
    rng, f = np.random.default_rng(3), speckle(shape=(400, 400)).clip(5, 250)
    model = NoiseModel.of([f + rng.normal(size=f.shape) * np.sqrt(2 + 0.03 * f) for _ in range(4)])
    # variances of 16 bins of 30 000 pixels: 0.8 % each
    assert abs(model.slope / 0.03 - 1) < 0.1 and abs(model.variance(128.0) / (2 + 0.03 * 128) - 1) < 0.03


@pytest.mark.parametrize("std", [2.55, 8.0])
def test_one_image_of_coarse_speckle_gives_the_noise_within_ten_percent(std):
    image = speckle(2.5) + np.random.default_rng(4).normal(scale=std, size=(200, 300))
    assert abs(image_noise(image).std_gv / std - 1) < 0.1  # quantile of 216 blocks, ~3 %, and what texture is left


def test_noise_only_counts_inside_the_mask():
    rng, f = np.random.default_rng(5), speckle()
    images = [f + rng.normal(scale=2.0, size=f.shape) for _ in range(2)]
    images[1][:, :100] += 50 * rng.normal(size=(200, 100))
    mask = np.ones(f.shape, dtype=bool)
    mask[:, :100] = False
    assert abs(still_noise(images, mask).std_gv / 2.0 - 1) < 0.02  # 40 000 pixels: 0.35 %


@pytest.mark.parametrize("images", [[np.zeros((50, 50))], [np.zeros((50, 50)), np.zeros((50, 51))]])
def test_too_few_or_unequal_still_frames_are_an_input_error(images):
    with pytest.raises(InputError):
        still_noise(images)


@pytest.mark.parametrize("std_px", [0.6, 1.0])
def test_a_low_pass_leaves_its_gain_of_independent_noise(std_px):
    noise = np.random.default_rng(5).standard_normal((400, 400))
    # 160 000 values, of which the low-pass leaves a tenth independent: sqrt(2 / 16 000) = 1.1 %, thrice that
    assert lowpass(noise, std_px).var() == pytest.approx(still_gain(std_px), rel=0.035)
    assert still_gain(0.0) == 1.0


@pytest.mark.parametrize("images", [[], [np.zeros((5, 5)), np.zeros((5, 6))], np.zeros((2, 5, 5, 3))])
def test_a_stack_of_unequal_or_coloured_images_is_an_input_error(images):
    with pytest.raises(InputError):
        ArrayStack(images)


def test_heights_in_whole_steps_are_no_mark_of_gaps():
    """A flat surface of few levels, one of which no pixel has; a mark is far from all of them."""
    rng = np.random.default_rng(9)
    flat, inside = rng.choice([0.0, 2.0, 3.0], size=(40, 40)), np.ones((40, 40), dtype=bool)
    assert gap_mark(flat, inside) is None
    flat[:2, :3] = -9999.0
    assert gap_mark(flat, inside) == (-9999.0, 6)
    assert gap_mark(np.where(flat < 0.0, np.nan, flat), inside) is None
