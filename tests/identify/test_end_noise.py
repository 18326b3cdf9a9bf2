"""Noise of measured ends that looks like information: on the edges of a plain strip, which its fields cannot tell.

The truth is uniform tension, a closed solution. M of noisy stages exceeds that of exact ones by N.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from idic.experiment_file import load_experiment
from idic.identification import evaluate_at, identify
from idic.identification.step.parameter_covariance import without_end_noise
from idic.model import Experiment
from idic_studies.cases.case import with_measured_start

E, NU, WIDTH, LENGTH, THICKNESS, STAGES, NOISE_MM, FORCE_NOISE_N = 70e3, 0.3, 12.0, 24.0, 2.0, 6, 0.5e-3, 3.0
MARGIN = 0.5  # that the mesh leaves out on each side
OUTLINE = "geometry.outline"
EXPERIMENT = f"""
[experiment]
fields = "stage_*.csv"
fields_noise_um = {1e3 * NOISE_MM}
loads = "loads.csv"
mesh = {{ around_points_mm = [{0.6 - MARGIN}, 0.6], element_mm = 3 }}
kind = "plane_stress"
thickness_mm = {THICKNESS}
[material.ALL]
law = "elastic"
E = {{ value = {E}, unit = "MPa", identify = true }}
nu = {{ value = {NU}, identify = true }}
[[boundary]]
nodes = "TOP"
u = "measured"
[[boundary]]
nodes = "BOTTOM"
u = "measured"
[[channel]]
column = "force_N"
simulated = {{ reaction = "TOP", component = "y" }}
noise_std = {FORCE_NOISE_N}
[[dof]]
name = "{OUTLINE}"
prior = {{ mean = 0.0, std = 1.0 }}
"""

WARMING = f"""alpha = {{ value = 0.0, identify = true }}
[[boundary]]
temperature = {{ course = [[0.0, 0.0], [{STAGES - 1}.0, 1.0]] }}
[[boundary]]"""


def strip(folder: Path, seed: int | None) -> tuple[Experiment, np.ndarray]:
    """The experiment with the start of its ends; seed : of the noise, None: exact stages."""
    folder.mkdir()
    rng = np.random.default_rng(seed)
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(0.6, WIDTH, 1.2), np.arange(0.6, LENGTH, 1.2)))
    log = ["time_s,force_N"]
    for k in range(STAGES):
        strain = 4e-4 * k
        u = np.column_stack([-NU * strain * x, strain * y])
        force = E * strain * WIDTH * THICKNESS
        if seed is not None:
            u, force = u + rng.normal(0.0, NOISE_MM, u.shape), force + rng.normal(0.0, FORCE_NOISE_N)
        rows = [f"{a:.4f},{b:.4f},{p:.8f},{q:.8f}" for a, b, p, q in zip(x, y, *u.T, strict=True)]
        (folder / f"stage_{k}.csv").write_text("\n".join(["x_mm,y_mm,ux_mm,uy_mm", *rows]))
        log.append(f"{k},{force:.4f}")
    (folder / "loads.csv").write_text("\n".join(log))
    (folder / "experiment.toml").write_text(EXPERIMENT)
    return with_measured_start(load_experiment(folder))


def at_the_truth(folder: Path, seed: int | None):
    """The system at the truth with the ends of the fields, in units of the values."""
    experiment, local = strip(folder, seed)
    truth = experiment.model.parameters.as_values() | {OUTLINE: MARGIN}
    for _ in range(2):
        system = evaluate_at(experiment, truth, local)[0].system
        local = local.copy()
        for record in system.frames:
            local[record.frame] += record.local_step
    size = np.array([{"ALL.E": E, "ALL.nu": NU}.get(name, 1.0) for name in system.names])
    return system.names.index(OUTLINE), np.outer(size, size) * system.M, np.outer(size, size) * system.end_noise


def given_the_others(M: np.ndarray, i: int) -> float:
    """Information on one parameter while the others are free."""
    return float(1.0 / np.linalg.inv(M)[i, i])


def test_noise_of_the_ends_adds_what_drawn_noise_predicts_to_the_information(tmp_path):
    i, exact, of_draws = at_the_truth(tmp_path / "exact", None)
    noisy = np.mean([at_the_truth(tmp_path / str(seed), seed)[1] for seed in range(3)], axis=0)
    told, predicted = given_the_others(noisy, i), given_the_others(exact + of_draws, i)
    assert given_the_others(exact, i) < 0.1 * predicted  # the fields hardly tell where the edges are
    # a draw scatters by a third (a dozen shapes of the ends, which the reference stage shares), N by a tenth
    assert told == pytest.approx(predicted, rel=0.3)


def test_a_temperature_that_rises_takes_no_part_in_the_noise_of_the_ends(tmp_path):
    """The ends alone move then, and the specimen stays as warm as at the reference."""
    experiment, local = strip(tmp_path / "cold", 0)
    truth = experiment.model.parameters.as_values() | {OUTLINE: MARGIN}
    cold = evaluate_at(experiment, truth, local)[0].system
    file = tmp_path / "cold" / "experiment.toml"
    file.write_text(EXPERIMENT.replace("[[boundary]]", WARMING, 1))
    warm_experiment = load_experiment(file.parent)
    warm = evaluate_at(warm_experiment, truth | {"ALL.alpha": 0.0}, local)[0].system
    shared = [warm.names.index(name) for name in cold.names]
    np.testing.assert_allclose(warm.end_noise[np.ix_(shared, shared)], cold.end_noise, rtol=1e-6)
    assert not warm.end_noise[warm.names.index("ALL.alpha")].any() and warm.M[warm.names.index("ALL.alpha")].any()


def test_where_noise_of_the_ends_rules_the_prior_decides(tmp_path):
    found = identify(*strip(tmp_path / "strip", 0)).result
    outline, modulus = (found["parameters"][name] for name in (OUTLINE, "ALL.E"))
    assert found["status"] == "converged"
    assert outline["std"] > 0.95 and abs(outline["value"]) < 0.2  # of the prior, 0 ± 1 mm
    assert modulus["std"] > 0.1 * E and abs(modulus["value"] - E) < 2.0 * modulus["std"]
    assert abs(found["parameters"]["ALL.nu"]["value"] - NU) < 3.0 * found["parameters"]["ALL.nu"]["std"]


def test_the_weight_is_the_share_of_the_information_that_is_no_noise():
    rng = np.random.default_rng(3)
    mix = rng.normal(size=(4, 4)) * [1.0, 10.0, 30.0, 0.1]
    exact, noise = np.array([1e4, 9.0, 0.8, 1e-3]), np.array([1.0, 1.0, 1.0, 1.0])
    M, N = mix @ np.diag(exact + noise) @ mix.T, mix @ np.diag(noise) @ mix.T
    left, weight = without_end_noise(M, N)
    share = exact / (exact + noise)
    ramp = np.array([1.0, 1.0, 6.0 * (2.0 / 3.0 - 1.0 / 1.8), 0.0])  # from a half to two thirds of noise
    np.testing.assert_allclose(weight, mix @ np.diag(share * ramp) @ np.linalg.inv(mix), rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(left, weight @ (M - N), rtol=1e-6, atol=1e-6 * np.abs(left).max())
    same, nothing = without_end_noise(M, 0.0 * N)
    np.testing.assert_allclose(same, M, rtol=1e-8)
    np.testing.assert_allclose(nothing, np.eye(4), atol=1e-6)
