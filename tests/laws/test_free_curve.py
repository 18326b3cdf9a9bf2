"""The free hardening curve outside of the compiled code: its basis, its prior, the classical forms beside it."""

import numpy as np
import pytest

from idic.laws import point
from idic.laws import (
    ROOT, Smoothness, basis, bends, between_knots, classical_fits, compile, get_law, knots, knots_of, level_names,
    rise,
)
from idic.laws.composed.written_terms import flow_stress
from idic.parameters import Parameter, SmoothnessPrior

LAST, N = 0.1, 8


def test_the_basis_is_linear_between_the_knots_and_beyond():
    at = knots(LAST, N)
    np.testing.assert_allclose(basis(at, LAST, N), np.eye(N), atol=1e-14)
    p = np.linspace(0.0, 2.0 * LAST, 50)
    np.testing.assert_allclose(basis(p, LAST, N) @ (200.0 + 900.0 * at), 200.0 + 900.0 * p)
    assert (knots_of("elastoplastic(hill48+free12+norton)"), knots_of("elastoplastic(voce)")) == (12, 0)
    assert len(level_names("elastoplastic(free12)", "sheet")) == 12


def test_the_band_counts_a_corner_between_two_knots_and_the_chords_of_a_parabola():
    at, p = knots(LAST, N), np.linspace(0.0, LAST, 400)
    known = np.zeros((N, N))
    corner = 0.5 * (at[3] + at[4])
    rest = basis(p, LAST, N) @ np.maximum(at - corner, 0.0) - np.maximum(p - corner, 0.0)
    covariance = between_knots(p, LAST, np.maximum(at - corner, 0.0), known)
    std = np.sqrt(np.diag(covariance))
    near = (p > at[3]) & (p < at[4])
    assert rest.max() == pytest.approx(0.25 * (at[4] - at[3]), rel=0.05)
    assert np.all(rest[near] < 4.0 * std[near] + 1e-12) and rest.max() > 1.96 * std.max()
    assert np.allclose(std[p < at[2]], 0.0) and np.allclose(std[p > at[5]], 0.0)
    even = between_knots(at, LAST, at**2, known)
    assert np.allclose(even, 0.0)
    bends = np.diff(np.diff(at**2) / np.diff(at))
    noisy = np.diag(np.full(N, (bends.max() * np.diff(at).max()) ** 2))
    assert np.allclose(between_knots(p, LAST, at**2, noisy), 0.0)  # the bends may be noise


@pytest.mark.slow  # a law to compile
def test_the_law_flows_at_the_free_curve_and_never_softens():
    law = compile("elastoplastic(free4)")
    values = [70e3, 0.3, 200.0, LAST, 230.0, 220.0, 260.0]  # the third value is below the second: a plateau
    curve = point.uniaxial(law, values, np.linspace(0.0, 0.15, 40))
    written = flow_stress(law.spec.name, dict(zip(get_law(law.spec.name).parameter_names, values, strict=True)),
                          curve.state[:, 6])
    np.testing.assert_allclose((curve.P * curve.F)[1:, 0, 0], written[1:], rtol=1e-8)
    assert np.diff(written).min() >= 0.0
    oracle = point.uniaxial(compile("elastoplastic(free4)", derivative="complex_step"), values,
                            np.linspace(0.0, 0.15, 40))
    np.testing.assert_allclose(curve.dP, oracle.dP, atol=1e-9 * np.abs(oracle.dP).max())


@pytest.mark.parametrize(("form", "curve"), [
    ("voce", lambda p: 200.0 + 120.0 * (1.0 - np.exp(-15.0 * p))), ("swift", lambda p: 500.0 * (0.01 + p) ** 0.2),
    ("ludwik", lambda p: 200.0 + 350.0 * p**0.5)])
def test_the_form_of_a_curve_with_noise_is_the_nearest_one_and_lies_in_the_band(form, curve):
    rng, p = np.random.default_rng(2), knots(LAST, 12)
    covariance = 0.3**2 * (0.3 + 0.7 * np.eye(12))
    fits = classical_fits(p, curve(p) + np.linalg.cholesky(covariance) @ rng.standard_normal(12), covariance, range(12))
    own = next(fit for fit in fits if fit.form == form)
    assert fits[0].form == form
    assert own.chi2 < own.freedom + 4.0 * np.sqrt(2.0 * own.freedom)
    assert next(fit for fit in fits if fit.form == "linear").chi2 > 100.0


def test_the_smoothness_prior_pulls_a_bend_straight_and_leaves_a_line_alone():
    names = tuple("abcd")
    at = knots(LAST, 4)
    rows = bends(at, rise(200.0 + 1000.0 * at), Smoothness())
    prior = SmoothnessPrior(names, tuple(tuple(row) for row in rows.tolist()))
    slopes = np.array([200.0, 210.0, 240.0, 300.0])
    def pull(levels):
        parameters = {name: Parameter(name, value, free=True) for name, value in zip(names, levels, strict=True)}
        return prior.normal_equations(parameters, ("x", *names[1:]), np.append(1.0, slopes[1:]))
    places, M, b = pull(200.0 + 1000.0 * at)
    assert places == [1, 2, 3] and np.abs(b).max() < 1e-9
    bent = pull(200.0 + 1000.0 * at + np.array([0.0, 5.0, 0.0, 0.0]))[2]
    assert bent[0] < 0.0
    np.testing.assert_allclose(M, slopes[1:, None] * (rows.T @ rows)[1:, 1:] * slopes[1:])


def test_a_curve_is_smooth_over_what_is_stated_and_a_smaller_strength_is_a_stiffer_prior():
    at = knots(LAST, 9)
    straight, steep = 200.0 + 300.0 * at, 200.0 + 350.0 * np.sqrt(at)
    over_strain, over_root = (bends(at, 30.0, Smoothness(1.0, over)) for over in ("strain", ROOT))
    assert np.abs(over_strain @ straight).max() < 1e-9 and np.abs(over_root @ steep).max() < 1e-9
    assert np.abs(over_strain @ steep).max() > 10.0
    np.testing.assert_allclose(bends(at, 30.0, Smoothness(0.1)), 10.0 * over_strain)
