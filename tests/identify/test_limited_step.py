"""A step of limited size: what is well determined moves first, and nothing moves further than allowed."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from idic.identification.step.parameter_covariance import Scaled
from idic.identification.step.proposal import propose
from idic.parameters import Parameter, ParameterSet

STRONG, WEAK = 1e8, 1e2  # entries of M: standard deviations of 1e-4 and 0.1 in ln(parameter)


def proposed(b, limit, M=None, damping=0.0, upper=np.inf):
    names = ("SET.a", "SET.b")
    M = np.diag([STRONG, WEAK]) if M is None else M
    scaled = Scaled(names, M, np.asarray(b, float), M, np.ones(2))
    parameters = ParameterSet(Parameter(name, 1.0, free=True, transform="log", bounds=(0.0, upper)) for name in names)
    found = scaled.spectrum()
    return propose(scaled, found, np.sqrt(1.0 / np.diagonal(M)), parameters, damping, limit)


def test_a_short_step_is_the_whole_gauss_newton_step():
    step = proposed([0.1 * STRONG, -0.3 * WEAK], 0.35)
    np.testing.assert_allclose(step.delta, [0.1, -0.3], rtol=1e-12)
    assert not step.clipped


def test_far_from_the_solution_only_well_determined_directions_move():
    """With b = (1, 0.5) of the whole way the strong one goes to its limit; the weak one waits until that is settled."""
    step = proposed([1.0 * STRONG, 0.5 * WEAK], 0.35)
    assert step.clipped and step.delta[0] == pytest.approx(0.35, rel=1e-2)
    assert abs(step.delta[1]) < 1e-5  # ridge ~ 2 STRONG: 0.5 WEAK / ridge


def test_where_only_the_weak_one_is_far_the_strong_one_still_goes_all_its_way():
    step = proposed([0.1 * STRONG, 2.0 * WEAK], 0.35)
    assert step.delta[1] == pytest.approx(0.35, rel=1e-2)
    assert step.delta[0] == pytest.approx(0.1, rel=1e-4)  # ridge ~ 5 WEAK, 5e-6 of STRONG


@pytest.mark.parametrize("damping", [0.0, 1e-2, 1.0])
def test_no_component_is_longer_than_the_limit_and_the_model_promises_progress(damping):
    rng = np.random.default_rng(0)
    for _ in range(20):
        root = rng.normal(size=(2, 2)) * 10.0 ** rng.uniform(0.0, 4.0, (2, 1))
        M = root @ root.T + np.eye(2)
        step = proposed(M @ rng.normal(size=2), 0.2, M, damping)
        assert np.abs(step.delta).max() <= 0.2 * (1.0 + 1e-12)
        assert step.predicted > 0.0


def test_a_bound_within_the_limit_is_kept():
    step = proposed([1.0 * STRONG, 0.5 * WEAK], 0.35, upper=1.1)
    assert np.exp(step.delta).max() <= 1.1 * (1.0 + 1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_where_many_components_meet_their_bounds_the_step_is_the_minimum_within_them(seed):
    """As of an independent solver: what was held at first and need not be is let go."""
    rng, n = np.random.default_rng(seed), 18
    names = [f"SET.u{k}" for k in range(n)]
    root = rng.normal(size=(n, n)) * 10.0 ** rng.uniform(0.0, 2.0, (n, 1))
    M, here = root.T @ root + np.eye(n), 0.1 * rng.integers(0, 2, n)
    b = M @ (0.3 * rng.standard_normal(n))
    parameters = ParameterSet(Parameter(name, value, free=True, bounds=(0.0, np.inf), max_step=10.0)
                              for name, value in zip(names, here, strict=True))
    scaled = Scaled(tuple(names), M, b, M, np.ones(n))
    step = propose(scaled, scaled.spectrum(), np.sqrt(1.0 / np.diagonal(M)), parameters, 0.0)
    upper = np.linalg.cholesky(M).T
    best = lsq_linear(upper, np.linalg.solve(upper.T, b), bounds=(-here - 1e-12, np.inf), method="bvls").x
    assert (here + step.delta >= 0.0).all()
    assert np.sum(here + best < 1e-9) >= 3  # are held
    np.testing.assert_allclose(step.delta, best, atol=1e-7)
