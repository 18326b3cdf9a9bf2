"""Errors over standard deviations of many draws, calibration uncertainty included; one camera and two steps for
comparison."""

from dataclasses import replace

import numpy as np
import pytest
from notched_tube import SIZE as TUBE
from notched_tube import still_tube, write_tube
from stereo_draws import build_repeats, integrated, scored, without_noise

from idic.virtual_tests import PlateSize, PlateTest

pytestmark = pytest.mark.slow  # some minutes of processor time each
REDUCED = PlateSize.of_example(reduced=True)
N, N_TWO_STEPS = 200, 20
BIAS = 0.25  # of a standard deviation: it takes a 95 % interval to 94.3 %, where the goal is 93 %


def tube_folder(test, folder, deviations):
    """The counterpart of `PlateTest.write`."""
    return write_tube(folder, test, deviations=deviations)


BODIES = {
    "plate": (lambda: PlateTest.simulated(replace(REDUCED, true=REDUCED.user)), PlateTest.write),
    "tube": (lambda: still_tube(replace(TUBE, pixel=0.15, shape=(134, 220))), tube_folder),
}


@pytest.mark.parametrize("body", BODIES)
def test_images_without_noise_leave_hardly_a_bias(tmp_path, body):
    """The tube's hardening modulus was 0.4 off before the blur on a strain gradient counted (docs/method.md, 1.12)."""
    make, write = BODIES[body]
    repeats = build_repeats(tmp_path, make(), write)
    names, error, std = integrated(repeats, without_noise(repeats))
    print(dict(zip(names, (error / std).round(2), strict=True)))
    assert np.all(np.abs(error / std) < BIAS)


@pytest.mark.parametrize("body", BODIES)
def test_errors_over_standard_deviations_are_unit_normal_and_two_steps_scatter_more(tmp_path, body):
    make, write = BODIES[body]
    repeats = build_repeats(tmp_path, make(), write)
    names, error, std = integrated(repeats, without_noise(repeats))
    bias = error / std
    draws = [scored(repeats, k, k < N_TWO_STEPS) for k in range(N)]
    scores = np.array([one["scores"] for one in draws])
    alone, steps, stated = (np.array([one[name] for one in draws[:N_TWO_STEPS]]) for name in ("alone", "steps",
                                                                                              "stated"))
    inside, rms = (np.abs(scores) < 1.96).mean(axis=0), np.sqrt(np.mean(scores**2, axis=0))
    ratio = np.std(alone, axis=0) / np.std(steps, axis=0)
    one_camera = np.divide(*np.mean(stated, axis=0))
    print(dict(zip(names, zip(inside.round(3), rms.round(2), strict=True), strict=True)), inside.mean().round(3),
          "without noise", bias.round(2), "of two steps", ratio.round(2), "of one camera", one_camera.round(2))
    # 95 % of 200 within 3 binomial deviations of 1.5 %; the parameters' mean within the 93 to 97 % of the goal
    assert np.all(np.abs(inside - 0.95) < 0.047) and 0.93 < inside.mean() < 0.97
    assert np.all(rms < 1.0 + 3.5 / np.sqrt(2 * N))  # right.fx measured 0.83: its stated deviation is a sixth too wide
    # noise and calibration move no mean: what it is off, the images without noise are off, too
    assert np.all(np.abs(scores.mean(axis=0) - bias) < 3.5 / np.sqrt(N))
    # E, nu, yield stress, hardening modulus: goal 0.6; a ratio of 20 draws is known to 23 % of itself
    assert np.all(ratio < 0.6 * 1.5)
    assert np.all(one_camera < 1.0)
