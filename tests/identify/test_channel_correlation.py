"""Channels whose noise is correlated from frame to frame: found in the residual, counted in the error bars."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from experiment_file.small_experiment import TOML, write_experiment
from scipy.signal import lfilter

from idic.experiment_file import load_experiment
from idic.identification import Joint, identify
from idic.identification.loop import parameters_at
from idic.identification.noise.channel_correlation import ChannelNoise, channel_correlation
from idic.identification.noise.channel_noise import (
    channel_noise_notes, estimated_channel_noise, with_channel_noise,
)
from idic.identification.noise.input_noise import channel_noise, resolution
from idic_studies.cases.case import CaseJob, case_experiment, render
from idic_studies.cases.registry import make_study
from idic_studies.cases.store import StudyStore

DRAWS = 80


def autoregression(rng, n, correlation):
    """Unit variance, stationary  # (n,)"""
    white = rng.standard_normal(n + 200) * np.sqrt(1.0 - correlation**2)
    return lfilter([1.0], [1.0, -correlation], white)[200:]


def force_rows(n):
    """A force that bends over at 40 % of the test: two parameters, as stiffness and hardening  # (n, 2)"""
    t = np.linspace(1.0 / n, 1.0, n)
    return np.column_stack([t, np.where(t > 0.4, t - 0.4, 0.0)])


def fitted(rng, n, correlation, stated=True):
    """Error of the two parameters in a fit by the channel alone, and the noise found in what it leaves."""
    rows, noise = force_rows(n), autoregression(rng, n, correlation)
    inverse = np.linalg.inv(rows.T @ rows)
    error = inverse @ rows.T @ noise
    std = 1.0 if stated else channel_noise(noise)
    found = channel_correlation(noise - rows @ error, rows, range(1, n + 1), np.zeros((2, 2)), np.zeros(2), std, stated)
    return error, inverse @ rows.T @ found.covariance @ rows @ inverse, found


@pytest.mark.parametrize("n, correlation", [(10, 0.9), (30, 0.5), (30, 0.9)])
def test_error_bars_hold_under_correlated_noise(n, correlation):
    rng = np.random.default_rng(1)
    z, white = [], np.diag(np.linalg.inv(force_rows(n).T @ force_rows(n)))
    errors = []
    for _ in range(DRAWS):
        error, covariance, found = fitted(rng, n, correlation)
        z.append(error / np.sqrt(np.diag(covariance if found.is_correlated else np.diag(white))))
        errors.append(error / np.sqrt(white))
    assert np.std(errors) > 1.4  # independent noise of that size would give 1
    assert (np.abs(z) < 1.96).mean() > 0.87  # 95 % less three standard errors of 160 correlated answers, and of chance


def test_independent_noise_is_mostly_left_alone():
    rng = np.random.default_rng(2)
    wrong = [fitted(rng, n, 0.0)[2].is_correlated for n in (10, 30) for _ in range(DRAWS)]
    assert np.mean(wrong) < 0.2


@pytest.mark.parametrize("correlation", [pytest.param(0.5, marks=pytest.mark.slow), 0.9])
def test_a_standard_deviation_that_nobody_states_is_found(correlation):
    """Third differences show 0.62 and 0.25 of it."""
    rng = np.random.default_rng(3)
    third, found = [], []
    for _ in range(25):
        noise = autoregression(rng, 80, correlation)
        third.append(channel_noise(noise))
        found.append(fitted(rng, 80, correlation, stated=False)[2].std)
    assert np.median(third) < 0.7
    assert 0.8 < np.median(found) < 1.25


def test_short_logs_whose_noise_nobody_states_have_true_error_bars():
    """Nine readings of a ramp; their differences show less than half of the noise in every sixth log."""
    rng, rows, by_differences, by_residual = np.random.default_rng(7), np.arange(1.0, 9.0)[:, None], [], []
    for _ in range(200):
        noise = rng.standard_normal(9)
        error = rows[:, 0] @ noise[1:] / (rows[:, 0] @ rows[:, 0])
        std = channel_noise(60.0 * np.arange(9.0) + noise)
        left = noise[1:] - rows[:, 0] * error
        found = channel_correlation(left, rows, range(1, 9), np.zeros((1, 1)), np.zeros(1), std, False)
        sums = rows[:, 0] / (rows[:, 0] @ rows[:, 0])
        by_differences.append(abs(error) < 1.96 * std * np.linalg.norm(sums))
        by_residual.append(abs(error) < 1.96 * np.sqrt(sums @ found.covariance @ sums))
    assert np.mean(by_differences) < 0.9
    assert 0.9 < np.mean(by_residual) < 0.99  # 95 %, three standard errors of 200 answers


def test_a_residual_that_a_frame_has_taken_is_given_back():
    """Each frame fits its own reading to a quarter of the error: the noise is that of the readings all the same."""
    rng, rows, kept, found = np.random.default_rng(8), 60.0 * np.arange(1.0, 9.0)[:, None], 0.25, []
    for _ in range(60):
        std = 0.5  # that the readings are weighted by; their noise is 1
        beside = std**2 * (1.0 / kept - 1.0) * np.eye(8)
        innovation = rng.standard_normal(8) + np.sqrt(beside[0, 0]) * rng.standard_normal(8)
        found.append(channel_correlation(innovation, rows, range(8), np.zeros((1, 1)), np.zeros(1), std, False,
                                         beside).covariance[0, 0])
    assert 0.7 < np.sqrt(np.median(found)) < 1.4  # closed residuals, a quarter of these, show 0.33


def smooth_course(rng, n, length):
    """A smooth course over a recording of n frames, of unit standard deviation  # (n,)"""
    s = np.linspace(0.0, 1.0, n)
    correlation = np.exp(-0.5 * ((s[:, None] - s) / length)**2) + 1e-9 * np.eye(n)
    return np.linalg.cholesky(correlation) @ rng.standard_normal(n)


@pytest.mark.parametrize("is_share", [False, True], ids=["as large in all readings", "a share of each"])
def test_a_smooth_error_of_a_channel_is_measured_by_what_it_leaves(is_share):
    """Twenty times the stated noise; the forces alone determine both parameters."""
    rng, n, rows, held, by_noise, sizes = np.random.default_rng(9), 20, force_rows(20), [], [], []
    inverse, simulated = np.linalg.inv(rows.T @ rows), 1000.0 * rows.sum(axis=1)
    shape = simulated / np.sqrt(np.mean(simulated**2)) if is_share else np.ones(n)
    for _ in range(DRAWS):
        noise = 20.0 * shape * smooth_course(rng, n, rng.uniform(0.2, 0.5)) + rng.standard_normal(n)
        error = inverse @ rows.T @ noise
        found = channel_correlation(noise - rows @ error, rows, range(n), np.zeros((2, 2)), np.zeros(2), 1.0, True,
                                    simulated=simulated)
        smooth = np.zeros((n, n)) if found.smooth is None else found.smooth
        whole = found.covariance + smooth
        held.append(np.abs(error) < 1.96 * np.sqrt(np.diag(inverse @ rows.T @ whole @ rows @ inverse)))
        by_noise.append(np.abs(error) < 1.96 * np.sqrt(np.diag(inverse)))
        sizes.append(np.sqrt(np.diagonal(smooth).mean()))
    assert np.mean(np.array(sizes) > 0.0) > 0.95  # a course may be one of the parameters'
    assert 0.86 < np.mean(held) and np.mean(by_noise) < 0.5
    assert 0.5 < np.median(sizes) / 20.0 < 3.0  # what the parameters can take of it is not seen, and is counted


def test_a_smooth_error_is_told_by_its_channel(tmp_path):
    model = load_experiment(write_experiment(tmp_path / "test", TOML)).model
    n, readings = model.n_frames, model.channels[0].values
    size = 0.03 * np.sqrt(np.mean(readings**2))
    smooth = ChannelNoise(1.0, np.eye(n), 0, 0.0, 1.0, np.full((n, n), size**2), 12.0)
    (note,) = channel_noise_notes(model, {0: smooth})
    assert "Channel force_kN" in note and "about 3 % of its readings" in note
    assert channel_noise_notes(model, {0: replace(smooth, smooth=None)}) == []


def test_memory_does_not_grow_with_the_grid():
    """Of over a hundred covariances no more than a few exist at once."""
    n, rng = 250, np.random.default_rng(7)
    fitted(rng, n, 0.5, stated=False)  # imports
    tracemalloc.start()
    fitted(rng, n, 0.5, stated=False)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20 * 8 * n**2


def test_independent_noise_is_no_smooth_error():
    rng = np.random.default_rng(10)
    seen = [fitted(rng, n, 0.0)[2].smooth is not None for n in (10, 30) for _ in range(DRAWS)]
    assert np.mean(seen) < 0.05


def test_frames_that_are_left_out_count_as_time_that_passes():
    rng = np.random.default_rng(4)
    noise, rows = autoregression(rng, 400, 0.9), np.zeros((400, 0))
    every, dense = slice(None, None, 10), slice(0, 40)
    far = channel_correlation(noise[every], rows[every], range(0, 400, 10), np.zeros((0, 0)), np.zeros(0), 1.0, True)
    near = channel_correlation(noise[dense], rows[dense], range(40), np.zeros((0, 0)), np.zeros(0), 1.0, True)
    assert near.is_correlated and near.correlation > 0.75
    assert abs(far.covariance[0, 1]) < 0.5


def test_too_few_frames_tell_nothing():
    rows = force_rows(6)
    assert channel_correlation(np.ones(6), rows, range(6), np.eye(2), np.zeros(2), 1.0, True) is None


def test_an_identification_counts_a_drifting_force(tmp_path):
    """The force alone tells E: its error bar grows; nu, which the images tell, keeps its own."""
    study, store = make_study("coverage", "sketch"), StudyStore(tmp_path)
    case = next(case for case in study.cases if case.group == "drifting_force_polymer-ordinary")
    rendering = study.rendering(case.images)
    render(CaseJob(str(tmp_path), "coverage", "sketch", rendering.name))
    drifting = case_experiment(store, rendering, case)
    steady = case_experiment(store, rendering, replace(case, disturbance=replace(case.disturbance,
                                                                               channel_correlation=0.0)))
    found, usual = identify(drifting).result, identify(steady).result
    channel = found["noise"]["channels"]["force_N"]
    assert channel["correlation"] > 0.5 and channel["order"] == 1 and "channels" not in usual["noise"]
    assert [note for note in found["notes"] if "correlated from frame to frame" in note]
    ratio = {name: found["parameters"][name]["std_noise"] / usual["parameters"][name]["std_noise"]
             for name in ("sheet.E", "sheet.nu")}
    assert ratio["sheet.E"] > 1.2 and abs(ratio["sheet.nu"] - 1.0) < 0.15


def test_a_drifting_force_is_that_of_its_own_experiment(tmp_path):
    """Two recordings identified together: the one whose load cell drifts is named, the other's readings are
    independent."""
    study, store = make_study("coverage", "sketch"), StudyStore(tmp_path)
    case = next(case for case in study.cases if case.group == "drifting_force_polymer-ordinary")
    rendering = study.rendering(case.images)
    render(CaseJob(str(tmp_path), "coverage", "sketch", rendering.name))
    steady = replace(case, disturbance=replace(case.disturbance, channel_correlation=0.0))
    experiments = {"steady": case_experiment(store, rendering, steady),
                   "drifting": case_experiment(store, rendering, case)}
    found = {name: identify(experiment) for name, experiment in experiments.items()}
    joint = Joint.of(experiments)
    point = joint.combine({name: one.point for name, one in found.items()},
                          {name: one.weights.image_noise for name, one in found.items()})
    channels = estimated_channel_noise(joint.whole, parameters_at(joint.whole.model, found["drifting"].state), point)
    assert [joint.whole.model.channels[number].column for number in channels] == ["drifting.force_N"]
    with_noise = with_channel_noise(point.system, joint.whole.model, channels)
    assert with_noise.spread[0, 0] > 1.2 * point.system.spread[0, 0]


def logged(rng, n: int, course, uneven: float) -> float:
    """Root mean square of the noise found in 100 ramps whose readings have the noise 1."""
    found = []
    for _ in range(100):
        even = np.linspace(0.0, 1.0, n)
        times = uneven * np.sort(np.r_[0.0, 1.0, rng.random(n - 2)]) + (1.0 - uneven) * even
        found.append(channel_noise(1000.0 * course(times) + rng.standard_normal(n), times) ** 2)
    return float(np.sqrt(np.mean(found)))


@pytest.mark.parametrize("n, course, uneven, most", [
    (7, lambda t: t, 0.7, 1.5), (40, lambda t: t, 0.7, 1.3),  # by the numbers of the stages: 75 and 7
    (9, np.tanh, 0.7, 1.5), (9, lambda t: np.minimum(t, 0.4), 0.0, 2.0), (60, lambda t: t, 0.0, 1.2)])
def test_short_and_uneven_ramps_have_the_noise_of_their_readings(n, course, uneven, most):
    """Medians of few differences scatter: seven readings tell their noise within a factor of two or so."""
    assert 0.75 < logged(np.random.default_rng(6), n, course, uneven) < most


@pytest.mark.parametrize("n, step, scale", [(10, 100.0, 1.0), (40, 500.0, 1.0), (60, 2.4414, 0.1)])
def test_readings_of_a_coarse_load_cell_have_the_noise_of_rounding(n, step, scale):
    """Most differences of rounded readings are zero; files round them once more."""
    exact = np.linspace(0.0, 2800.0 * scale, n)
    rounded = np.round(np.round(exact / step) * step, 2)
    assert resolution(rounded) == pytest.approx(step, rel=1e-3)
    assert channel_noise(rounded) == pytest.approx(step / np.sqrt(12.0), rel=1e-3)


def test_courses_without_noise_are_not_taken_for_rounded_ones():
    steady, held = np.arange(12.0), np.array([0, 1, 2, 3, 3, 3, 4, 5, 6, 6, 6, 4, 2, 0.0])
    fast_and_slow, constant = np.r_[0:6:2, 6:12], np.ones(9)
    held_loads = np.repeat([0.0, 500.0, 0.0], 20), np.repeat(100.0 * np.arange(5), 8)  # creep; dead weights
    noisy = np.linspace(0.0, 100.0, 20) + np.random.default_rng(1).standard_normal(20)
    for course in (steady, held, fast_and_slow, constant, noisy, np.zeros(0), *held_loads):
        assert resolution(course) == 0.0, course
