"""Monte Carlo of the whole chain: over repeated noise the error in standard deviations is a unit normal variable.

Images, force and grip get new noise in every draw, the identification starts off the truth, and the report's own
standard deviation divides the error. What is rendered once are the noise-free images.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[1] / "identify"))

from twin_runs import ELASTIC, FORCE, GRIPS, SHAPE, Twin, clean_images, write_folder  # noqa: E402

from idic.experiment_file import load_experiment  # noqa: E402
from idic.identification import identify  # noqa: E402
from idic.images import ArrayStack  # noqa: E402
from idic_studies.cases.case import with_measured_start
from idic.virtual_tests import Sensor, record  # noqa: E402

YIELDING = {"E": 2000.0, "nu": 0.35, "yield_stress": 15.0, "hardening_modulus": 200.0}
PLASTIC = """
[material.BODY]
law = "j2_linear"
E = { value = 1800, unit = "MPa", identify = true }
nu = { value = 0.33, identify = true, bounds = [0.0, 0.49] }
yield_stress = { value = 17, unit = "MPa", identify = true }
hardening_modulus = { value = 150, unit = "MPa", identify = true }
"""
GRIP_NOISE = 0.002  # mm = 0.033 px; the images know the grip to some 0.01 px
TIMES = tuple(float(k) for k in range(8))
GRIP = (0.0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.12, 0.1)
MEASURED = GRIPS.replace('{ column = "grip_mm" }', '"measured"').replace("0.0", '"measured"')
NOISY_GRIPS = GRIPS.replace('"grip_mm"', f'"grip_mm", noise_std = {GRIP_NOISE}')


def drawn(experiment, clean, seed):
    """The experiment with new noise on images, force and logged motion."""
    images, force = clean
    rng = np.random.default_rng(seed)
    sensor = Sensor(SHAPE, noise_std=Twin().noise, background=25.0)
    stack = ArrayStack(np.array([record(image, sensor, rng) for image in images]))
    channels = tuple(replace(channel, values=force + channel.noise_std * rng.standard_normal(len(force)))
                     for channel in experiment.model.channels)
    prescribed = []
    for entry in experiment.model.prescribed:
        noise = getattr(entry.drive, "noise_std", 0.0)
        if noise:
            values = np.array(GRIP) + noise * rng.standard_normal(len(GRIP)) * (np.array(TIMES) > 0)
            entry = replace(entry, drive=replace(entry.drive, values=values))
        prescribed.append(entry)
    return replace(experiment, recording=replace(experiment.recording, stack=stack),
                   model=replace(experiment.model, channels=channels, prescribed=tuple(prescribed)))


def scores(folder, toml, draws, **truth):
    """Error over standard deviation of every parameter in every draw  # (draws, n)"""
    twin = Twin(grip=GRIP, times=TIMES, **truth)
    clean = clean_images(twin)
    experiment = load_experiment(write_folder(folder, twin, toml, clean))
    found = []
    for seed in range(draws):
        result = identify(*with_measured_start(drawn(experiment, clean, 1000 + seed))).result
        assert result["status"] == "converged" and result["estimator"] == "generalised"
        parameters = result["parameters"]
        found.append([(parameters[f"BODY.{name}"]["value"] - true) / parameters[f"BODY.{name}"]["std"]
                      for name, true in twin.truth.items()])
    return np.array(found)


def assert_unit_normal(z, bias=0.3):
    """Spread and mean of n draws of a unit normal variable, each to three of its own standard errors.

    The spread of n draws is known to 1 / sqrt(2 n), their mean to 1 / sqrt(n). The bias of interpolation and
    discretisation on these meshes may add `bias` standard deviations to the mean.
    """
    n = len(z)
    assert np.all(np.abs(z.std(axis=0, ddof=1) - 1.0) < 3.0 / np.sqrt(2 * n)), z.std(axis=0, ddof=1)
    assert np.all(np.abs(z.mean(axis=0)) < 3.0 / np.sqrt(n) + bias), z.mean(axis=0)


def test_errors_over_standard_deviations_are_unit_normal(tmp_path):
    """25 draws: error bars that are 42 % off are told; exact grips and 300 draws are slow."""
    assert_unit_normal(scores(tmp_path / "test", ELASTIC + NOISY_GRIPS + FORCE, 25))


@pytest.mark.slow
@pytest.mark.parametrize("grips", [GRIPS, NOISY_GRIPS], ids=["exact grips", "noisy grips"])
def test_errors_over_standard_deviations_are_unit_normal_over_many_draws(grips, tmp_path):
    assert_unit_normal(scores(tmp_path / "test", ELASTIC + grips + FORCE, 300))


@pytest.mark.slow
@pytest.mark.parametrize("draws", [12, 200])
def test_errors_over_standard_deviations_are_unit_normal_with_measured_edges(draws, tmp_path):
    """Both ends measured from the images, node by node and frame by frame; generalised least squares of themselves."""
    assert_unit_normal(scores(tmp_path / "test", ELASTIC + MEASURED + FORCE, draws))


@pytest.mark.slow
def test_errors_over_standard_deviations_are_unit_normal_for_a_body_that_yields(tmp_path):
    z = scores(tmp_path / "test", PLASTIC + GRIPS + FORCE, 100, law="j2_linear", truth=YIELDING)
    assert_unit_normal(z, bias=0.8)  # the plastic front through 24 elements; the truth has 96
