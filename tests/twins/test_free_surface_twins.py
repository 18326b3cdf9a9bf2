"""A free yield surface has weights for Hill's and Hosford's, which it was not told, along the stresses of a test, and
finds them."""

import numpy as np
import pytest
from free_surface import SURFACES, radius_errors, truth_of, write_folder
from scipy.optimize import lsq_linear, nnls

from idic.experiment_file import load_experiment
from idic.identification import evaluate_at, identify, log_progress, scaled_system
from idic.laws import POWER, equivalent, powers, surface_weights
from idic.run import prepare_in_memory

pytestmark = pytest.mark.slow  # simulates the test
WEIGHTS = [f"sheet.{name}" for name in surface_weights(6)]
DRAWS = 3  # further draws of image and force noise; each is evaluated by one linearised step


@pytest.mark.parametrize("surface", SURFACES)
def test_weights_for_the_visited_stresses_meet_the_surface_within_half_a_percent(surface):
    """Of the motion without images: what an identification of the weights can reach (docs/composed-law.md)."""
    flowing = truth_of(surface).flowing
    visited = flowing / np.linalg.norm(flowing, axis=1)[:, None]
    assert len(visited) > 1000
    q = SURFACES[surface][2](visited)
    weights = nnls(powers(6, visited[::7]) / q[::7, None] ** POWER, np.ones(len(q[::7])))[0]
    found = equivalent(weights, visited)[0] / q
    assert np.percentile(np.abs(found / np.median(found) - 1.0), 99.0) < 0.005


def solved(system, parameters, gram, image_noise):
    """(values after a step, their covariance): one step of Gauss and Newton with no weight below zero."""
    scaled = scaled_system(system, parameters, gram, image_noise)
    values = np.array([parameters[name].value for name in scaled.names])
    size, axes = np.linalg.eigh(scaled.M)
    root = np.sqrt(np.maximum(size, 1e-14 * size[-1]))
    lowest = np.where([name in WEIGHTS for name in scaled.names], -values / scaled.slopes - 1e-12, -np.inf)
    step = lsq_linear(root[:, None] * axes.T, (axes.T @ scaled.b) / root, (lowest, np.inf), method="bvls").x
    covariance = np.linalg.solve(scaled.M, np.linalg.solve(scaled.M, scaled.noise).T)
    return values + scaled.slopes * step, scaled.slopes[:, None] * covariance * scaled.slopes


@pytest.mark.parametrize("surface", SURFACES)
def test_the_surface_that_images_give_is_the_true_one_within_a_percent_and_its_band_holds_it(tmp_path, surface):
    """One draw identified, further ones by one linearised step from there, each with images and forces of its own."""
    truth = truth_of(surface)
    experiment = load_experiment(write_folder(tmp_path / "test", truth, 0))
    prepared = prepare_in_memory(experiment, print)
    found = identify(prepared.start, prepared.local, motion=prepared.motion, searched=prepared.begin is not None,
                     progress=log_progress(print))
    end = found.parameters.as_values()
    held, systems = [], [(found.point, found.weights)]
    for seed in range(1, DRAWS + 1):
        own = load_experiment(write_folder(tmp_path / f"draw{seed}", truth, seed))
        systems.append(evaluate_at(own, end, np.zeros((own.n_frames, 0))))
    for point, weights in systems:
        values, covariance = solved(point.system, found.parameters, point.reference_gram, weights.image_noise)
        at = [point.system.names.index(name) for name in ("sheet.yield_stress", *WEIGHTS)]
        error, noise, std = radius_errors(truth, values[at], covariance[np.ix_(at, at)])
        held.append([np.mean(np.abs(error) < 1.96 * std), np.mean(np.abs(error) < 1.96 * noise)])
        print(f"rms {100 * np.sqrt(np.mean(error**2)):.2f} %, mean {100 * error.mean():+.2f} %, 99 in 100 below "
              f"{100 * np.percentile(np.abs(error), 99):.2f} %, most {100 * np.abs(error).max():.2f} %, std of noise "
              f"{100 * np.median(noise):.2f} %, band holds {held[-1][0]:.3f}, of noise alone {held[-1][1]:.3f}")
        assert np.sqrt(np.mean(error**2)) < 0.01
    assert np.mean(held, axis=0)[0] > 0.9
