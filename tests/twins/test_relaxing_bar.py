"""A free spectrum finds kernels that are no sums of exponentials, on a bar whose truth is a convolution."""

import numpy as np
import pytest
from relaxing_bar import E, KERNELS, MATERIAL, NU, write_folder
from scipy.optimize import lsq_linear, nnls

import idic
from idic.experiment_file import load_experiment
from idic.identification import ChosenKnots, FreeSpectrum, evaluate_at
from idic.laws import grid, grid_covariance, relaxing, weight_names
from idic.laws.free_forms.relaxation_forms import mittag_leffler
from idic.run.reporting.write import load_record

pytestmark = pytest.mark.slow
DRAWS = 50
GIVEN, CHOSEN = (12, 23), (None, 24)  # times of the grid and of a fine one, where every second is one of the 12
OTHERS = {  # share that has relaxed, of no kernel above; lines lie between two times of the coarse grids
    "zener": lambda t: 0.6 * (1.0 - mittag_leffler(0.6, t / 8.0)), "logarithmic": lambda t: 0.09 * np.log1p(t / 0.8),
    "line": {11: 0.5}, "two lines": {7: 0.3, 17: 0.3},
}


@pytest.mark.parametrize("kernel", list(KERNELS))
def test_the_modulus_of_a_free_spectrum_is_the_true_one_over_the_visited_times(tmp_path, kernel):
    """One draw of the noise: the points of the band err together, so that nine tenths of it are asked for."""
    write_folder(tmp_path / "test", kernel)
    result = idic.identify(str(tmp_path / "test"), out=str(tmp_path / "run"))
    assert result.status == "converged"
    curve, = load_record(tmp_path / "run").relaxation
    assert curve.time[0] < 0.3 and curve.time[-1] > 250.0  # s
    expected = E / (2.0 * (1.0 + NU)) * KERNELS[kernel](curve.time)
    error = curve.modulus - expected
    assert np.abs(error / expected).max() < 0.01
    assert np.mean(np.abs(error) < 1.96 * curve.std) >= 0.9
    assert (np.abs(error) < 3.0 * curve.std).all()


@pytest.mark.parametrize("times", [GIVEN, CHOSEN])
@pytest.mark.parametrize("kernel", list(OTHERS))
def test_the_band_holds_other_kernels_over_draws_of_the_noise(tmp_path, kernel, times):
    """In the linearised problem at a spectrum of twice as many times, which the identified one does not have, or of
    24 times, of which every draw of the noise chooses its own number and smoothness."""
    given, n_fine = times
    path = write_folder(tmp_path / "test", next(iter(KERNELS)), 0,
                        MATERIAL.replace("times = 12", f"times = {n_fine}"))
    experiment = load_experiment(path)
    if given:
        path.write_text(path.read_text().replace(f"times = {n_fine}", f"times = {given}"))
        stated = np.array(load_experiment(path).model.parameters.joint[0].bends)
    fine, at = grid(0.05, 300.0, n_fine), np.geomspace(0.05, 400.0, 400)
    form = FreeSpectrum(tuple(range(2, n_fine + 2)), 0.05, 300.0, 0.5 * (n_fine - 1) / n_fine)
    true = np.zeros(n_fine)
    if isinstance(OTHERS[kernel], dict):
        true[list(OTHERS[kernel])] = list(OTHERS[kernel].values())
    else:
        true = nnls(relaxing(at, fine), OTHERS[kernel](at))[0]
    names, values = ["sheet.E", "sheet.nu", *(f"sheet.{k}" for k in weight_names(n_fine))], np.array([E, NU, *true])
    start = experiment.model.parameters.as_values() | dict(zip(names, values, strict=True))
    point, weights = evaluate_at(experiment, start, np.zeros((experiment.model.n_frames, 0)))
    order = np.ix_(*2 * [[point.system.names.index(name) for name in names]])
    M, noise = point.system.M[order], (point.system.spread + weights.image_noise**2 * point.reference_gram)[order]
    scales = np.concatenate([[E], np.full(n_fine + 1, 0.3)])
    t, inside, alone, numbers = np.geomspace(0.25, 300.0, 60), [], [], []
    expected = E / (2.0 * (1.0 + NU)) * (1.0 - relaxing(t, fine) @ true)
    for b in np.random.default_rng(4).multivariate_normal(np.zeros(len(values)), noise, DRAWS, method="eigh"):
        n, bends = given, stated if given else None
        if n is None:
            chosen = ChosenKnots.of(scales[:, None] * M * scales, scales * b, values, scales, form)
            n, bends = chosen.n, form.bends(chosen.n, chosen.smoothness)
        taus, T, prior = grid(0.05, 300.0, n), np.zeros((n_fine + 2, n + 2)), np.zeros((n + 2, n + 2))
        T[:2, :2], T[2:, 2:], prior[2:, 2:] = np.eye(2), form.finer(n), bends.T @ bends
        A = T.T @ M @ T + prior
        covariance = np.linalg.solve(A, np.linalg.solve(A, T.T @ noise @ T + prior).T)
        root, lowest = np.linalg.cholesky(A).T, np.array([0.0, -1.0, *np.zeros(n)])
        found = lsq_linear(root, np.linalg.solve(root.T, T.T @ (M @ values + b)), (lowest, np.inf), method="bvls").x
        G = found[0] / (2.0 * (1.0 + found[1]))
        modulus = G * (1.0 - relaxing(t, taus) @ found[2:])
        J = np.column_stack([modulus / found[0], -modulus / (1.0 + found[1]), -G * relaxing(t, taus)])
        own = J @ covariance @ J.T
        numbers.append(n)
        for shares, more in ((inside, G**2 * grid_covariance(t, taus, found[2:])), (alone, 0.0)):
            shares.append(np.mean(np.abs(modulus - expected) < 1.96 * np.sqrt(np.diagonal(own + more))))
    print(kernel, "in the band", np.mean(inside), "without the error of the grid", np.mean(alone),
          dict(zip(*np.unique(numbers, return_counts=True), strict=True)))
    # known to two standard errors: the points of one draw err together
    assert np.mean(inside) > 0.93 - 2.0 * np.std(inside) / np.sqrt(DRAWS)
