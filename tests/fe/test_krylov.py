"""Corrections by an earlier factor, and a march that uses them."""

from __future__ import annotations

import numpy as np
from test_factorisation_cost import brick
from test_multifrontal import assembled

from fe_bodies import PARAMETERS, body, held, where
from idic.fe.solver import known_pattern, krylov, linear
from idic.fe import Direction, march


def test_the_factor_of_a_similar_matrix_gives_the_solution_and_that_of_another_one_is_refused():
    pattern, values, matrix = assembled(brick(3, 3, 2))
    factor, rhs = linear.factorise(pattern, values.copy()), np.random.default_rng(2).random(pattern.n)
    softer = values * (1.0 - 0.5 * (np.arange(len(values)) > len(values) // 2))
    x = krylov.correction(pattern.matrix(softer), factor, rhs).x
    assert np.linalg.norm(pattern.matrix(softer) @ x - rhs) <= 1.001 * krylov.TOLERANCE * np.linalg.norm(rhs)
    other = np.random.default_rng(3).standard_normal(len(values))
    assert krylov.correction(pattern.matrix(other), factor, rhs) is None


def test_a_march_with_kept_factors_ends_at_the_same_equilibria_and_derivatives(monkeypatch):
    """Newton's tolerance is 1e-9 of the largest force; derivatives follow the state to first order."""
    mesh = brick(4, 3, 3)
    left, right = (where(mesh, lambda x, *_, at=at: abs(x - at) < 1e-9) for at in (0.0, 4.0))
    motion = [(right, 0, np.linspace(0.0, 0.048, 4))]
    model = body(mesh, "solid", "j2_linear", "finite", held(mesh, [(left, i, 0.0) for i in range(3)] + motion, 4))
    monkeypatch.setattr(known_pattern, "_kept", {})
    times, values = np.arange(4.0), {"BODY": PARAMETERS["j2_linear"]}
    directions = [Direction("yield_stress", material=(0, 2))]
    direct = list(march(model, values, times, directions))
    counted = []
    monkeypatch.setattr(known_pattern, "_kept", {})  # a pattern knows how it is factorised
    monkeypatch.setattr(linear, "MIN_OPERATIONS_PER_ENTRY", 0)
    monkeypatch.setattr("idic.fe.equilibrium.factorise", lambda *given: counted.append(1) or linear.factorise(*given))
    kept = list(march(model, values, times, directions))
    assert len(counted) < sum(frame.n_newton for frame in kept)  # or nothing was kept
    for a, b in zip(direct, kept, strict=True):
        np.testing.assert_allclose(b.u, a.u, rtol=0, atol=1e-8 * np.abs(direct[-1].u).max())
        np.testing.assert_allclose(b.du, a.du, rtol=0, atol=1e-6 * np.abs(direct[-1].du).max())
