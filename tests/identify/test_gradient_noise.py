"""Noise in the gradient of the reference image: told to its size, and spoken of where it spoils error bars."""

import numpy as np
import pytest
from twin_runs import ELASTIC, FORCE, GRIPS, Twin, identify, write_folder

from idic.correlation.rows import build_reference
from idic.edge.config import load_experiment
from idic.identify.gradient_noise import gradient_noise, slope_gain


def noisy(lowpass):
    return ELASTIC + GRIPS + FORCE + f"\n[options]\nlowpass_px = {lowpass}\n"


@pytest.mark.parametrize("degree", [3, 5])
def test_a_low_pass_takes_most_of_the_noise_of_a_slope(degree):
    """White noise of a band up to pi has slopes of variance pi^2 / 3 at most; a spline cuts the highest waves."""
    gains = [slope_gain(degree, width) for width in (0.0, 0.6, 1.2)]
    assert np.pi**2 / 3 > gains[0] > 3.0 * gains[1] > 9.0 * gains[2] > 0.0


@pytest.mark.parametrize("lowpass", [0.0, 0.6])
def test_the_share_is_what_noise_adds_to_the_gradient(lowpass, tmp_path):
    measured = {}
    for noise in (0.0, 12.0):
        path = write_folder(tmp_path / str(noise), Twin(noise=noise), noisy(lowpass))
        experiment = load_experiment(path)
        reference = build_reference(experiment, experiment.camera)
        measured[noise] = float(np.mean(reference.fx.astype(float) ** 2 + reference.fy.astype(float) ** 2))
    share = measured[12.0] / measured[0.0] - 1.0
    assert gradient_noise(experiment) == pytest.approx(share, rel=0.1)


def test_much_of_it_is_noted_in_the_result_and_little_is_not(tmp_path):
    _, result = identify(write_folder(tmp_path / "noisy", Twin(noise=20.0), noisy(0.0)), tmp_path / "noisy_run")
    (note,) = [note for note in result["notes"] if "gradient" in note]
    assert "lowpass_px" in note
    _, result = identify(write_folder(tmp_path / "usual", Twin(), ELASTIC + GRIPS + FORCE), tmp_path / "usual_run")
    assert not any("gradient" in note for note in result["notes"])
