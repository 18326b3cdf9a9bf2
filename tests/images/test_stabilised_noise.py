"""Noise that depends on the grey value: the same everywhere after the transform, and seen by an experiment's
options."""

import numpy as np
import pytest

from idic.images import ArrayStack, NoiseModel, StabilisedStack, Stabiliser

MODEL = NoiseModel(1.0, 0.05)  # GV^2, GV: 1.2 GV in the dark, 3.5 GV in the bright


def test_the_transformed_noise_has_one_standard_deviation_at_every_grey_value():
    """200 000 draws know a standard deviation to 0.16 %; the second order, (slope / 8 s)^2 and so on, is below 0.1
    %."""
    rng = np.random.default_rng(1)
    stabiliser = Stabiliser(MODEL, 120.0)
    for grey in (10.0, 60.0, 120.0, 240.0):
        noisy = grey + np.sqrt(MODEL.variance(grey)) * rng.standard_normal(200_000)
        assert np.std(stabiliser(noisy)) == pytest.approx(stabiliser.std_gv, rel=0.01)
    assert stabiliser(np.array([120.0]))[0] == pytest.approx(120.0)
    slope = float(stabiliser(np.array(120.5))[()] - stabiliser(np.array(119.5))[()])
    assert slope == pytest.approx(1.0, rel=1e-4)  # float32 grey values: 1e-5


def test_the_transform_rises_on_through_grey_values_of_no_variance():
    """A negative offset (a dark level not taken off) makes the model's variance zero at 20: a tangent goes on."""
    stabiliser = Stabiliser(NoiseModel(-1.0, 0.05), 120.0)
    grey = np.linspace(-50.0, 60.0, 1101)
    values = stabiliser(grey).astype(float)
    steps = np.diff(values) / 0.1
    assert (steps > 0).all() and steps.max() < 10.1  # of 1 % of the variance at L; float32 rounding
    assert np.isfinite(values).all()


def test_no_slope_leaves_grey_values_as_they_are():
    image = np.arange(12, dtype=np.uint8).reshape(3, 4)
    stack = StabilisedStack(ArrayStack(image[None]), Stabiliser(NoiseModel(4.0), 5.0))
    assert np.array_equal(stack.frame(0), image) and stack.frame(0).dtype == np.float32
    assert (stack.n_frames, stack.shape, stack.stabiliser.std_gv) == (1, (3, 4), 2.0)


def test_still_frames_tell_offset_and_slope():
    rng = np.random.default_rng(2)
    scene = rng.uniform(20.0, 230.0, (200, 300))
    images = [scene + np.sqrt(MODEL.variance(scene)) * rng.standard_normal(scene.shape) for _ in range(4)]
    found = NoiseModel.of(images)
    # 180 000 squares: their mean is known to 0.3 %, over a range that shows the slope to a few per cent
    assert found.slope == pytest.approx(MODEL.slope, rel=0.05)
    assert found.variance(np.array([30.0, 220.0])) == pytest.approx(MODEL.variance(np.array([30.0, 220.0])), rel=0.05)
