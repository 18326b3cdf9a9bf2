"""The error of the spline, told from one image: nothing for a smooth pattern or for noise, and that of a fine one."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from idic.identification.step.estimator import estimator_notes
from idic.images import ArrayStack, prefilter, spline_error
from idic.images.quality.round_trip import lost_noise_share
from idic.model import Noise, Options, Recording


def waves(length_px, shape=(96, 120)):
    """A pattern of one wavelength in all directions, standard deviation about 30 grey values."""
    rng = np.random.default_rng(5)
    y, x = np.mgrid[:shape[0], :shape[1]]
    angles, phases = rng.uniform(0, np.pi, 12), rng.uniform(0, 2 * np.pi, 12)

    def at(dx, dy):
        return 128.0 + sum(12.0 * np.sin(2 * np.pi / length_px * (np.cos(a) * (x + dx) + np.sin(a) * (y + dy)) + p)
                           for a, p in zip(angles, phases, strict=True))

    return at


def true_error(pattern, degree):
    """Spline less pattern at half a pixel, where the pattern is known; without the borders."""
    image = pattern(0.0, 0.0).astype(np.float32)
    y, x = np.mgrid[:image.shape[0], :image.shape[1]]
    values = prefilter(image, degree).evaluate(np.stack([x.ravel() + 0.5, y.ravel() + 0.5], axis=1).astype(float))
    error = values.reshape(image.shape) - pattern(0.5, 0.5)
    return float(np.nanstd(error[8:-8, 8:-8]))


@pytest.mark.parametrize("degree", [3, 5])
@pytest.mark.parametrize("length", [4.0, 5.0])
def test_the_error_of_a_known_pattern_is_told_to_its_size(degree, length):
    pattern = waves(length)
    told = spline_error(pattern(0.0, 0.0), degree, 0.0)
    assert 0.5 < told / true_error(pattern, degree) < 2.5  # twice on the way, once in the comparison


@pytest.mark.parametrize("degree", [3, 5])
def test_noise_alone_is_no_error_of_the_spline(degree):
    image = 128.0 + 2.0 * np.random.default_rng(1).standard_normal((200, 200))
    assert spline_error(image, degree, 2.0) < 0.3
    assert 0.3 < lost_noise_share(degree) < 0.7


def test_an_error_is_seen_through_noise_that_is_smaller_and_not_through_noise_that_is_larger():
    pattern = waves(4.5)(0.0, 0.0)
    bare = spline_error(pattern, 5, 0.0)
    noise = np.random.default_rng(2).standard_normal(pattern.shape)
    assert spline_error(pattern + 0.5 * bare * noise, 5, 0.5 * bare) == pytest.approx(bare, rel=0.2)
    assert spline_error(pattern + 20 * bare * noise, 5, 20 * bare) < 0.3 * 20 * bare


@pytest.mark.parametrize("estimator, reached, told", [
    ("generalised", "generalised", True), ("generalised", "ordinary", False), ("auto", "generalised", False)])
def test_generalised_least_squares_that_would_take_the_spline_for_noise_are_spoken_of(estimator, reached, told):
    """Where they were asked for; `auto` looks at this itself."""
    pattern = waves(4.5)(0.0, 0.0)
    noise = 0.5 * spline_error(pattern, 5, 0.0)  # a fine pattern under next to no noise
    recording = Recording(ArrayStack(pattern[None]), ("0",), noise=Noise(noise))
    experiment = SimpleNamespace(
        recording=recording, model=SimpleNamespace(reference=0),
        options=Options(estimator=estimator, interpolation="quintic", lowpass_px=0.0))
    notes = estimator_notes(experiment, reached)
    assert bool(notes) is told
    if told:
        share = float(notes[0].partition("interpolating spline, ")[2].split()[0])
        assert share == pytest.approx(2.0, rel=0.2) and "too small" in notes[0]
    quiet = SimpleNamespace(**{**vars(experiment), "recording": replace(recording, noise=Noise(100.0 * noise))})
    assert estimator_notes(quiet, reached) == []
