"""A free hardening curve finds laws that it was not told."""

import numpy as np
import pytest
from free_hardening import FORMS, FREE, true_flow_stress, truth_of, write_folder

import idic
from idic.experiment_file.load import load_experiment
from idic.identify.free_form.evidence import MOST_KNOTS, choose_knots
from idic.identify.free_form.forms import FreeCurve
from idic.identify.in_memory import evaluate_at
from idic.materials.composed.free_curve import basis, knots, level_names
from idic.materials.composed.smoothness import bends

pytestmark = pytest.mark.slow
RANGE, RISE, DRAWS = 0.12, 120.0, 100  # RISE: of the starting curve, MPa


@pytest.mark.parametrize("form", ["swift", "voce", "ludwik"])
def test_a_free_curve_is_the_true_one_within_one_percent(tmp_path, form):
    truth = truth_of(form)
    material = FREE.replace("KNOTS", '"evidence"').replace("RANGE", str(RANGE))
    write_folder(tmp_path / "test", truth, 0, material)
    result = idic.identify(str(tmp_path / "test"))
    assert result.status == "converged"
    entries = [entry for name, entry in result.content["parameters"].items()
               if name == "sheet.yield_stress" or name.startswith("sheet.hardening_1_s")]
    p = np.linspace(0.0, np.percentile(truth.plastic_strain, 99.0), 60)
    found = basis(p, RANGE, len(entries)) @ np.maximum.accumulate([entry["value"] for entry in entries])
    assert any("by their evidence" in note for note in result.content["notes"])
    expected = np.array([true_flow_stress(*FORMS[form], x)[0] for x in p])
    assert np.abs(found / expected - 1.0).max() < 0.01


@pytest.mark.parametrize("form", ["swift", "voce", "ludwik"])
def test_the_band_holds_the_truth_over_draws_of_the_noise(tmp_path, form):
    """In the linearised problem at the true curve, knots and smoothness chosen anew in each draw; no mesh error."""
    material = FREE.replace("KNOTS", '"evidence"').replace("RANGE", str(RANGE))
    path = write_folder(tmp_path / "test", truth := truth_of(form), 0, material)
    experiment = load_experiment(path, {"options.substeps": 3})
    names = level_names(f"elastoplastic(free{MOST_KNOTS})", "sheet")
    at = np.array([70e3, *(true_flow_stress(*FORMS[form], p)[0] for p in knots(RANGE, MOST_KNOTS))])
    values = experiment.parameters.as_values() | dict(zip(("sheet.E", *names), at, strict=True))
    point, weights = evaluate_at(experiment, values, np.zeros((experiment.n_frames, 0)), generalised=True)
    order = [point.system.names.index(name) for name in ("sheet.E", *names)]
    noise = point.system.spread + weights.image_noise**2 * point.reference_gram
    noise = noise[np.ix_(order, order)] * np.outer(at, at)
    M = point.system.M[np.ix_(order, order)] * np.outer(at, at)
    curve, rng, inside = FreeCurve(tuple(range(1, len(at))), RANGE, RISE), np.random.default_rng(2), []
    p = np.linspace(0.0, np.percentile(truth.plastic_strain, 99.0), 60)
    expected = np.array([true_flow_stress(*FORMS[form], x)[0] for x in p])
    for b in rng.multivariate_normal(np.zeros(len(at)), noise, DRAWS, method="eigh"):
        chosen = choose_knots(M, b, at, at, curve)
        T = np.zeros((len(at), chosen.n + 1))
        T[0, 0], T[1:, 1:] = 1.0, basis(knots(RANGE, MOST_KNOTS), RANGE, chosen.n) / at[1:, None]
        P = np.zeros((chosen.n + 1, chosen.n + 1))
        P[1:, 1:] = (rows := bends(knots(RANGE, chosen.n), RISE, chosen.smoothness)).T @ rows
        inverse = np.linalg.inv(T.T @ M @ T + P)
        B = basis(p, RANGE, chosen.n)
        covariance = B @ (inverse @ (T.T @ noise @ T + P) @ inverse)[1:, 1:] @ B.T
        inside.append(np.mean(np.abs(B @ chosen.levels - expected) < 1.96 * np.sqrt(np.diagonal(covariance))))
    # 93 to 97 %, known to two standard errors: the points of one draw err together
    assert abs(np.mean(inside) - 0.95) < 0.02 + 2.0 * np.std(inside) / np.sqrt(DRAWS), np.mean(inside)
