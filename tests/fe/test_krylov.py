"""Corrections by an earlier factor, and a march that uses them."""

from __future__ import annotations

import numpy as np
import pytest
from test_factorisation_cost import brick
from test_multifrontal import assembled

from fe_bodies import PARAMETERS, body, grid, held, where
from idic.fe.assembly.assembly import discretise, evaluate_system
from idic.fe.assembly.assembly import stiffness_values
from idic.fe.body.boundary import drives_at
from idic.fe.solver import known_pattern, krylov, linear, multigrid
from idic.fe import Body, Direction, Section, march
from idic.laws import compile


def test_the_factor_of_a_similar_matrix_gives_the_solution_and_that_of_another_one_is_refused():
    pattern, values, matrix = assembled(brick(3, 3, 2))
    factor, rhs = linear.factorise(pattern, values.copy()), np.random.default_rng(2).random(pattern.n)
    softer = values * (1.0 - 0.5 * (np.arange(len(values)) > len(values) // 2))
    x = krylov.correction(pattern.matrix(softer), factor, rhs).x
    assert np.linalg.norm(pattern.matrix(softer) @ x - rhs) <= 1.001 * krylov.TOLERANCE * np.linalg.norm(rhs)
    other = np.random.default_rng(3).standard_normal(len(values))
    assert krylov.correction(pattern.matrix(other), factor, rhs) is None


@pytest.mark.parametrize("max_entries", [linear.MAX_FACTOR_ENTRIES, 0], ids=["factors", "multigrid"])
def test_a_march_with_kept_factors_ends_at_the_same_equilibria_and_derivatives(monkeypatch, max_entries):
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
    monkeypatch.setattr(linear, "MAX_FACTOR_ENTRIES", max_entries)
    monkeypatch.setattr("idic.fe.equilibrium.factorise", lambda *given: counted.append(1) or linear.factorise(*given))
    kept = list(march(model, values, times, directions))
    assert len(counted) < sum(frame.n_newton for frame in kept)  # or nothing was kept
    for a, b in zip(direct, kept, strict=True):
        np.testing.assert_allclose(b.u, a.u, rtol=0, atol=1e-8 * np.abs(direct[-1].u).max())
        np.testing.assert_allclose(b.du, a.du, rtol=0, atol=1e-6 * np.abs(direct[-1].du).max())


@pytest.mark.parametrize("supports", [[0, 1, 2], [0]], ids=["clamped", "rollers and a corner"])
def test_multigrid_gives_the_solution_of_a_factor_and_the_same_bits_again(monkeypatch, supports):
    """Rollers leave nodes with held and free dofs; a corner keeps the body from sliding."""
    mesh = brick(12, 7, 6)
    left, corner = (where(mesh, lambda x, y, z, last=last: (x < 1e-9) & (y + z <= last)) for last in (np.inf, 0.0))
    edge = where(mesh, lambda x, y, z: (x < 1e-9) & (z < 1e-9) & (y > 6.9))
    rest = [(left, i, 0.0) for i in supports] + ([] if len(supports) > 1 else [(corner, 1, 0.0), (corner, 2, 0.0),
                                                                              (edge, 2, 0.0)])
    model = body(mesh, "solid", "elastic", "small", held(mesh, rest, 1))
    system = discretise(model)
    evaluation = evaluate_system(system, {"BODY": PARAMETERS["elastic"]}, np.zeros_like(mesh.nodes),
                                 system.rest_states(), 1.0, drives_at(model, np.zeros(1), 0.0))
    values, rhs = stiffness_values(system, evaluation), np.random.default_rng(4).random((system.pattern.n, 3))
    exact = linear.factorise(system.pattern, values).solve(rhs)
    monkeypatch.setattr(linear, "MAX_FACTOR_ENTRIES", 0)
    monkeypatch.setattr(linear, "MIN_OPERATIONS_PER_ENTRY", 0)
    for entry in ("costs_much", "factor_entries"):
        system.pattern.__dict__.pop(entry, None)
    answers = []
    for seed in (0, 1):
        np.random.seed(seed)  # noqa: NPY002 - PyAMG draws from this generator, where it draws
        factor = linear.factorise(system.pattern, values)
        assert isinstance(factor.lu, multigrid.Hierarchy) and len(factor.lu.levels.levels) > 1
        answers.append(factor.solve(rhs))
        assert np.linalg.norm(answers[-1] - exact) <= 1e-10 * np.linalg.norm(exact)
        np.testing.assert_allclose(factor.solve_transposed(rhs), exact, rtol=0, atol=1e-10 * np.abs(exact).max())
    assert np.array_equal(*answers)


@pytest.mark.parametrize("cell, n", [("hex20", (6, 4, 4)), ("tet4", (7, 6, 6)), ("tet10", (5, 4, 4))])
def test_multigrid_in_other_elements_with_a_stiff_and_a_soft_half(cell, n):
    """Contrast 1000: the solution of a factor to within rounding, after a few corrections by some cycles each."""
    mesh = grid(cell, n, (1.5, 1.0, 1.0))
    left, law = where(mesh, lambda x, *_: x < 1e-9), compile("elastic", "small")
    soft = mesh.nodes[mesh.blocks[0].connectivity][:, :, 0].mean(axis=1) > 0.75
    sections = tuple(Section(name, law, np.flatnonzero(part)) for name, part in (("STIFF", ~soft), ("SOFT", soft)))
    model = Body(mesh, "solid", sections, held(mesh, [(left, i, 0.0) for i in range(3)], 1))
    system, params = discretise(model), {"STIFF": PARAMETERS["elastic"], "SOFT": PARAMETERS["elastic"] * [1e-3, 1.0]}
    evaluation = evaluate_system(system, params, np.zeros_like(mesh.nodes), system.rest_states(), 1.0,
                                 drives_at(model, np.zeros(1), 0.0))
    values, pattern = stiffness_values(system, evaluation), system.pattern
    levels = multigrid.hierarchy(pattern.coordinates, pattern.dofs, pattern.indptr, pattern.indices, values)
    assert len(levels.levels.levels) > 1
    rhs = np.random.default_rng(4).random((pattern.n, 1))
    exact = linear.factorise(pattern, values).solve(rhs)
    x = krylov.solution(pattern.matrix(values), levels.solve, rhs)
    np.testing.assert_allclose(x, exact, rtol=0, atol=1e-9 * np.abs(exact).max())
