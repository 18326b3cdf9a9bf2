"""Free curves in the identification: evidence of their knots, values in order, values that no data reach."""

from dataclasses import replace

import numpy as np
import pytest

from idic.identification import ChosenKnots, FreeCurve, FreeSpectrum, FreeSurface
from idic.identification.step.ending import beyond_bounds
from idic.identification.step.parameter_covariance import Scaled
from idic.identification.step.proposal import Step
from idic.identification.step.rising import in_order
from idic.laws import Smoothness, basis, bends, equivalent, grid, knots, relaxing
from idic.parameters import Parameter, ParameterSet, SmoothnessPrior

LAST, N, NOISE = 0.1, 24, 1.0


def measured(curve, seed=0, reach=LAST):
    """Normal equations of a curve measured at 60 points with noise, and of an alternating offset, another parameter."""
    p, rng = np.linspace(0.0, reach, 60), np.random.default_rng(seed)
    J = np.column_stack([(-1.0) ** np.arange(60), basis(p, LAST, N)]) / NOISE
    y = (curve(p) + NOISE * rng.standard_normal(60)) / NOISE
    return J.T @ J, J.T @ y, J, y


def chosen(curve, seed=0, **ways):
    M, b, *_ = measured(curve, seed)
    return ChosenKnots.of(M, b, np.zeros(N + 1), np.ones(N + 1), FreeCurve(tuple(range(1, N + 1)), LAST, 100.0), **ways)


def voce(p):
    return 200.0 + 120.0 * (1.0 - np.exp(-30.0 * p))


def ludwik(p):
    return 200.0 + 350.0 * p**0.5


@pytest.mark.parametrize("curve", [voce, ludwik, lambda p: 200.0 + 2000.0 * np.maximum(p - 0.04, 0.0)])
def test_the_curve_with_the_chosen_knots_is_the_true_one_within_the_noise_of_a_few_points(curve):
    found, p = chosen(curve), np.linspace(0.0, LAST, 101)
    made = basis(p, LAST, found.n) @ found.levels
    # 60 points and up to 20 effective unknowns: sqrt(20 / 60) = 0.58
    assert np.sqrt(np.mean((made - curve(p)) ** 2)) < 0.6 * NOISE
    assert found.evidence[4] < -10.0 and max(found.evidence.values()) == 0.0


def test_a_steep_beginning_is_smooth_over_the_root_and_a_straight_line_asks_for_the_stiffest_prior():
    assert chosen(ludwik).smoothness.over == "root"
    assert chosen(voce).smoothness.over == "strain"
    assert chosen(lambda p: 200.0 + 1000.0 * p).smoothness == Smoothness(0.03)


def test_the_evidence_is_the_probability_of_the_data():
    """Against the marginal density of the data with the unknowns of unit density spread over a wide normal prior."""
    M, b, J, y = measured(voce)
    curve = FreeCurve(tuple(range(1, N + 1)), LAST, 100.0, ("strain",))
    found = ChosenKnots.of(M, b, np.zeros(N + 1), np.ones(N + 1), curve, (6, 12))
    wide, ln_z = 1e5, {}
    for n in (6, 12):
        best = -np.inf
        for strength in (0.03, 0.1, 0.3, 1.0, 3.0):
            rows = bends(knots(LAST, n), 100.0, Smoothness(strength))
            Q = np.vstack([np.eye(n)[0], np.eye(n)[-1], rows])  # ends and bends
            A = np.column_stack([J[:, 0], J[:, 1:] @ basis(knots(LAST, N), LAST, n) @ np.linalg.inv(Q)])
            stds = np.concatenate([[1e3], [wide, wide], np.ones(n - 2)])
            covariance = (A * stds**2) @ A.T + np.eye(len(y))
            best = max(best, -0.5 * (y @ np.linalg.solve(covariance, y) + np.linalg.slogdet(covariance)[1]))
        ln_z[n] = best
    assert found.evidence[12] - found.evidence[6] == pytest.approx(ln_z[12] - ln_z[6], abs=0.01)


@pytest.mark.parametrize(("lines", "fewest"), [({8.0: 0.5}, 10), ({1.0: 0.25, 60.0: 0.25}, 8)])
def test_the_chosen_times_of_a_spectrum_give_the_true_relaxation(lines, fewest):
    """Measured at 60 times with noise of 0.2 % of the modulus; true times between those of every grid."""
    t, rng, fine = np.geomspace(0.3, 300.0, 60), np.random.default_rng(5), grid(0.1, 500.0, 24)
    true = sum(share * relaxing(t, [tau])[:, 0] for tau, share in lines.items())
    J = relaxing(t, fine) / 0.002
    y = true / 0.002 + rng.standard_normal(60)
    found = ChosenKnots.of(J.T @ J, J.T @ y, np.zeros(24), np.ones(24), FreeSpectrum(tuple(range(24)), 0.1, 500.0, 0.5))
    assert found.n >= fewest and (found.levels >= 0.0).all() and found.evidence[4] < -10.0
    made = relaxing(t, grid(0.1, 500.0, found.n)) @ found.levels
    assert np.sqrt(np.mean((made - true) ** 2)) < 0.002  # the noise of one reading


@pytest.mark.parametrize("n", range(5, 9))
def test_a_surface_of_fewer_knots_is_one_of_the_most_knots_exactly(n):
    form = FreeSurface(tuple(range(27)), tuple(np.full(27, 1.0)), 1.0, 0.9)
    rng = np.random.default_rng(n)
    weights, stress = rng.uniform(0.2, 1.8, 3 * n), rng.standard_normal((40, 3))
    q = [equivalent(w, stress)[0] for w in (weights, form.finer(n) @ weights)]
    np.testing.assert_allclose(q[1], q[0], rtol=1e-9)
    np.testing.assert_allclose(form.seen(n, 9) @ np.ones(3 * n), 0.0, atol=1e-9)  # Mises's, the radius of all alike
    assert (form.finer(n) @ np.ones(3 * n)).mean() == pytest.approx(1.0)


def test_a_surface_that_is_seen_all_around_gets_as_many_knots_as_its_noise_shows():
    """Radii of a surface of 6 knots with a noise of 0.1 %; Mises's needs the fewest and the smoothest."""
    stress, rng = np.random.default_rng(1).standard_normal((300, 3)), np.random.default_rng(2)
    here = np.ones(27)
    q, slopes = equivalent(here, stress)
    J = -slopes / q[:, None] / 1e-3
    form = FreeSurface(tuple(range(27)), tuple(here), 1.0, 0.9)
    noise = rng.standard_normal(300)
    mises = ChosenKnots.of(J.T @ J, J.T @ noise, here, np.ones(27), form)
    assert mises.n <= 6 and mises.smoothness.strength == 0.03 and min(mises.evidence.values()) > -1.0
    true = form.finer(6) @ rng.uniform(0.3, 1.7, 18) - here
    found = ChosenKnots.of(J.T @ J, J.T @ (J @ true + noise), here, np.ones(27), form)
    assert found.n == 6 and (found.levels >= 0.0).all()
    assert found.evidence[5] < -10.0
    error = J @ (form.finer(6) @ found.levels - here - true)
    assert np.sqrt(np.mean(error**2)) < 0.4  # of the noise of one radius, 18 unknowns by 300 of them


def prior(n, rising=False):
    names = tuple(f"s{k}" for k in range(n))
    return SmoothnessPrior(names, tuple(map(tuple, bends(knots(LAST, n), 100.0, Smoothness()).tolist())), rising)


def test_values_that_no_data_reach_follow_their_neighbours():
    """Far values have a standard deviation beyond a factor of e by the prior alone, and are not left at their start."""
    n, start = 6, np.full(6, 20.0)
    rows = np.array(prior(n).bends) * 20.0
    data = np.diag([1e6, 1e6, 1e6, 0.0, 0.0, 0.0])
    smooth = rows.T @ rows
    b = data @ np.log([2.0, 2.1, 2.3, 1.0, 1.0, 1.0]) - smooth @ np.ones(n)
    scaled = Scaled(tuple("abcdef"), data + smooth, b, data + smooth, start)
    assert not scaled.spectrum().determined.all()
    step = Scaled(scaled.names, scaled.M, b, scaled.M, start, smooth).spectrum().inverse @ b
    made = start * (1.0 + step)
    slopes = np.diff(made) / np.diff(knots(LAST, n))
    assert slopes[3:] == pytest.approx(slopes[2], rel=0.05)


def test_a_step_keeps_the_values_of_a_rising_curve_in_order_and_is_the_nearest_that_does():
    n, rng = 6, np.random.default_rng(3)
    A = rng.standard_normal((9, n + 1))
    names = ("E", *prior(n).names)
    scaled = Scaled(names, A.T @ A, np.zeros(n + 1), A.T @ A, np.ones(n + 1))
    here = np.concatenate([[0.0], np.linspace(0.0, 0.5, n)])
    step = 0.4 * rng.standard_normal(n + 1)
    parameters = ParameterSet([Parameter(name, 1.0, free=True) for name in names], (prior(n, rising=True),))
    kept = in_order(scaled, parameters, here, step)
    assert np.diff((here + step)[1:]).min() < 0.0 <= np.diff((here + kept)[1:]).min() + 1e-12
    far = lambda delta: (delta - step) @ scaled.M @ (delta - step)  # noqa: E731
    for _ in range(200):
        other = kept + rng.choice([1e-3, 0.1]) * rng.standard_normal(n + 1)
        other[1:] = np.maximum.accumulate((here + other)[1:]) - here[1:]
        assert far(other) >= far(kept) - 1e-9
    straight = ParameterSet(parameters.values(), (prior(n),))
    assert in_order(scaled, straight, here, step) is step


def test_values_of_a_curve_that_stay_at_zero_are_a_solution_and_a_law_at_its_bound_is_none():
    names = ("BAR.g_1", "BAR.g_2")
    weights = [Parameter(name, value, "-", True, (0.0, 1.0)) for name, value in zip(names, (1e-9, 0.4), strict=True)]
    modulus = Parameter("BAR.E", 1500.0, "MPa", True, (100.0, 1500.0))
    prior = SmoothnessPrior(names, ((1.0, -1.0),))
    step = Step(np.zeros(3), 0.01, 0.01, 0.01, 0.0, 0.0, False, names[:1])
    curve = ParameterSet([*weights, modulus], [prior])
    assert beyond_bounds(step, curve) == ()
    for pinned, parameters, beyond in ((("BAR.g_1", "BAR.E"), curve, ("BAR.E",)),
                                       (names[:1], ParameterSet(weights), names[:1])):
        assert beyond_bounds(replace(step, pinned=pinned), parameters) == beyond
