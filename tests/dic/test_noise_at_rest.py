"""Which images the covariance of the noise comes from: those at rest, else consecutive ones of the test, else what a
free FE-DIC leaves of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dic_cases import experiment, grid, pictures
from scipy.ndimage import gaussian_filter

from idic.identification import measured_noise
from idic.identification.noise.input_noise import noise_content, noise_notes
from idic.images import ArrayStack
from idic.measure import dic_stack
from idic.model import Channel, Noise

SHAPE, FRAME, STD, SMOOTHING_PX = (180, 160), (20, 20, 140, 160, 20), 2.0, 0.6
LOADS = np.array([0.0, 0.0, 0.4, 0.7, 1.0])  # frame 1 before the load


@pytest.fixture(scope="module")
def clean():
    return np.array(pictures(FRAME, [lambda at, load=load: load * 0.004 * at for load in LOADS], SHAPE))


def smooth(rng, shape=SHAPE):
    """Noise of STD that neighbours share  # shape"""
    noise = gaussian_filter(rng.standard_normal(shape), SMOOTHING_PX, mode="wrap")
    return STD * noise / noise.std()


def recording(clean, logged=True, **more):
    """Independent noise in the frames at rest, smooth noise in the others."""
    rng = np.random.default_rng(3)
    noise = [smooth(rng) if load else STD * rng.standard_normal(SHAPE) for load in LOADS]
    channels = (Channel("force_N", 1e3 * LOADS, 1.0, "TOP", "y"),) if logged else ()
    return experiment(grid(*FRAME), (clean + noise).astype(np.float32), noise=Noise(STD), channels=channels, **more)


def test_frames_that_the_log_finds_at_rest_come_before_those_under_load(clean):
    found = measured_noise(recording(clean, logged=False)).correlated
    assert found.source == "consecutive_images" and found.sum_std_gv > 1.3 * STD and found.correlation[4][5] > 0.2
    assert measured_noise(recording(clean)).correlated is None


def test_images_that_are_declared_still_come_before_the_log(clean):
    e, rng = recording(clean), np.random.default_rng(5)
    among = measured_noise(replace(e, recording=replace(e.recording, still_frames=(2, 3, 4))))
    assert among.correlated.source == "still_frames"
    images = np.array([clean[0] + smooth(rng) for _ in LOADS]).astype(np.float32)
    separate = replace(e, recording=replace(e.recording, still_stack=ArrayStack(images)))
    separate = replace(separate, recording=replace(separate.recording, noise=measured_noise(separate)))
    assert separate.recording.noise.in_sums_gv > 1.3 * STD
    assert "still frames show" in noise_notes(separate)[0]
    assert noise_content(separate.recording)["covariance_source"] == "still_frames"


def test_a_copy_of_the_reference_tells_nothing(clean):
    images = recording(clean).recording.stack
    copied = experiment(grid(*FRAME), np.array([images.frame(k) for k in (0, 0, 2, 3, 4)]), noise=Noise(STD),
                        channels=recording(clean).model.channels)
    assert measured_noise(copied).correlated.source == "consecutive_images"


@pytest.mark.parametrize("smoothed", [False, True])
def test_steps_that_no_tile_search_follows_are_followed_by_a_free_measurement(smoothed):
    """10 % of stretch from frame to frame; by still images of this noise the sums carry 1.7 times its pixels."""
    rng, shape, frame = np.random.default_rng(3), (240, 300), (20, 30, 190, 190, 20)
    moved = np.array(pictures(frame, [lambda at, k=k: 0.1 * k * at for k in range(3)], shape))
    noise = np.array([smooth(rng, shape) if smoothed else STD * rng.standard_normal(shape) for _ in moved])
    found = measured_noise(experiment(grid(*frame), (moved + noise).astype(np.float32), noise=Noise(STD))).correlated
    if not smoothed:
        assert found is None
        return
    assert found.source == "free_residual"
    assert found.recorded_gv == pytest.approx(STD, rel=0.05) and found.sum_std_gv == pytest.approx(1.7 * STD, rel=0.08)


@pytest.mark.parametrize("n_references", [2, 3])
def test_images_that_are_a_part_of_the_reference_do_not_set_the_noise(clean, n_references):
    """Their residual against a mean that holds them is too small: of two images by a factor of 1.7."""
    rng, mesh = np.random.default_rng(7), grid(*FRAME)
    images = np.array([clean[0]] * (n_references - 1) + [clean[k] for k in (0, 2, 3, 4)])
    images = (images + STD * rng.standard_normal(images.shape)).astype(np.float32)
    e = experiment(mesh, images, reference=n_references - 1, averaged=tuple(range(n_references)))
    assert abs(dic_stack(e).noise_gv / STD - 1.0) < 0.05
