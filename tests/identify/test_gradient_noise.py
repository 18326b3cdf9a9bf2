"""Noise in the gradient of the reference image: told to its size, taken out where it would spoil error bars."""

import numpy as np
import pytest
from twin_runs import ELASTIC, FORCE, GRIPS, Twin, solved, write_folder

from idic.correlation import MAX_GRADIENT_NOISE, build_experiment_reference
from idic.experiment_file import load_experiment
from idic.identification.noise.input_noise import gradient_noise
from idic.images import dense_speckle, lowpass, without_noise
from idic.images.quality.gradient_noise import radial_spectrum, slope_gain


def noisy(lowpass):
    return ELASTIC + GRIPS + FORCE + f"\n[options]\nlowpass_px = {lowpass}\n"


def gradients(folder, noise, lowpass_px=0.0):
    """(experiment, its reference image, the gradient that the sums weigh by)"""
    experiment = load_experiment(write_folder(folder / str(noise), Twin(noise=noise), noisy(lowpass_px)))
    reference = build_experiment_reference(experiment, experiment.model.camera)
    return experiment, reference, np.concatenate([reference.fx, reference.fy]).astype(float)


@pytest.mark.parametrize("degree", [3, 5])
def test_a_low_pass_takes_most_of_the_noise_of_a_slope(degree):
    """White noise of a band up to pi has slopes of variance pi^2 / 3 at most; a spline cuts the highest waves."""
    gains = [slope_gain(degree, width) for width in (0.0, 0.6, 1.2)]
    assert np.pi**2 / 3 > gains[0] > 3.0 * gains[1] > 9.0 * gains[2] > 0.0


@pytest.mark.parametrize("lowpass_px", [0.0, 0.6])
def test_white_noise_has_its_variance_at_every_wave(lowpass_px):
    """Each bin is the mean of hundreds of waves, of which the taper along the edges leaves a part independent."""
    noise = 3.0 * np.random.default_rng(4).standard_normal((300, 200))
    seen = np.zeros(noise.shape, dtype=bool)
    seen[20:280, 30:190] = True
    blurred = lowpass(noise, lowpass_px)
    wave, power, gain = radial_spectrum(blurred, seen, lowpass_px)
    middle = (wave > 0.3) & (wave < 3.0)
    np.testing.assert_allclose(power[middle], 9.0 * gain[middle], rtol=0.15)
    assert np.mean(power[middle] / gain[middle]) == pytest.approx(9.0, rel=0.02)
    left, std = without_noise(blurred, seen, 3.0, lowpass_px)
    assert std == pytest.approx(3.0, rel=0.03)
    assert np.var(left[seen]) < 0.01 * np.var(blurred[seen])


def test_the_share_is_the_noise_in_the_gradient(tmp_path):
    """Few grey values of noise, so that the gradient is the image's own."""
    measured = {}
    for noise in (0.0, 4.0):
        experiment, reference, slopes = gradients(tmp_path, noise)
        measured[noise] = float(np.mean(slopes**2))
    assert 0.01 < reference.gradient_noise < MAX_GRADIENT_NOISE
    assert gradient_noise(experiment) == pytest.approx(measured[4.0] / measured[0.0] - 1.0, rel=0.1)


def test_the_filtered_gradient_is_its_common_part_with_the_pattern(tmp_path):
    """The orthogonality that makes M the right matrix: <w, w> = <w, pattern>; most of the pattern stays.

    To a twentieth: the spectrum of 4320 px scatters (eight draws: 1.01 to 1.04); error bars follow with half of that.
    """
    _, _, pattern = gradients(tmp_path, 0.0)
    experiment, reference, kept = gradients(tmp_path, 20.0)
    assert reference.gradient_noise > 3.0 * MAX_GRADIENT_NOISE
    assert gradient_noise(experiment) == reference.gradient_noise
    assert kept @ kept == pytest.approx(kept @ pattern, rel=0.05)
    assert 0.8 < kept @ kept / (pattern @ pattern) < 1.0


def test_an_image_without_the_noise_that_is_stated_keeps_its_gradient():
    """Rendered images of a planned test have none."""
    rows, columns = np.indices((160, 160))
    points = np.column_stack([columns.ravel(), rows.ravel()])
    pattern = dense_speckle(np.random.default_rng(2), sigma_px=1.8).value(points).reshape(160, 160)
    image, std = without_noise(pattern, np.ones(pattern.shape, bool), 0.3 * np.std(pattern))
    assert std < 0.02 * np.std(pattern)
    assert np.std((image - pattern)[8:-8, 8:-8]) < 0.01 * np.std(pattern)


def test_much_of_it_is_noted_in_the_result_and_little_is_not(tmp_path):
    _, result = solved(write_folder(tmp_path / "noisy", Twin(noise=20.0), noisy(0.0)))
    (note,) = [note for note in result["notes"] if "gradient" in note]
    assert "Wiener" in note
    _, result = solved(write_folder(tmp_path / "usual", Twin(), ELASTIC + GRIPS + FORCE))
    assert not any("gradient" in note for note in result["notes"])
