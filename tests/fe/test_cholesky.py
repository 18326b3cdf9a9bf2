"""Factors of the symmetric part, iterated to the solution of an unsymmetric matrix; where an LU takes over."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu
from test_factorisation_cost import brick, dofs_of, plate

from idic.fe.assembly import in_parts
from idic.fe.assembly.assembly import discretise, evaluate_system, stiffness_values
from idic.fe.body.boundary import drives_at
from idic.fe import Direction, march, solver_threads
from idic.fe.solver import cholesky, known_pattern, linear, storage

from fe_bodies import PARAMETERS, body, held, where


@pytest.fixture(autouse=True)
def every_factorisation_costs_much(monkeypatch):
    monkeypatch.setattr(linear, "MIN_OPERATIONS_PER_ENTRY", 0)
    monkeypatch.setattr(known_pattern, "_kept", {})  # a pattern knows how it is factorised


def nearly_symmetric(mesh, prescribed=(), skew=0.005, shift=1.0):
    """A pattern by fronts, and values that are positive definite (with a positive shift) but for a skew part."""
    dofs, rng = dofs_of(mesh), np.random.default_rng(4)
    pattern = linear.make_pattern(mesh.nodes, [dofs], np.asarray(prescribed, dtype=int))
    values, m = np.zeros(pattern.n_stored), dofs.shape[1]
    root, other = rng.standard_normal((2, len(dofs), m, m))
    storage.scatter(root @ root.transpose(0, 2, 1) / m + shift * np.eye(m) + skew * (other - other.transpose(0, 2, 1)),
                    pattern.positions(dofs), values)
    return pattern, values, csc_array((values.copy(), pattern.indices, pattern.indptr), shape=(pattern.n, pattern.n))


@pytest.mark.parametrize("mesh, prescribed",
                         [(plate(12, 9), range(40)), (brick(6, 5, 4), range(0, 300, 7)), (brick(1, 1, 1), ())],
                         ids=["plate", "brick", "one element"])
def test_the_symmetric_part_gives_the_solutions_of_superlu(mesh, prescribed):
    pattern, values, matrix = nearly_symmetric(mesh, prescribed)
    factor, reference, rhs = linear.factorise(pattern, values), splu(matrix), np.random.default_rng(0).random(
        (pattern.n, 20))  # more than are iterated at a time
    rhs[:, 1] = 0.0
    assert factor.of_symmetric_part
    for own, theirs in ((factor.solve(rhs), reference.solve(rhs)),
                        (factor.solve_transposed(rhs), reference.solve(rhs, "T")),
                        (factor.solve(rhs[:, 0]), reference.solve(rhs[:, 0]))):
        np.testing.assert_allclose(own, theirs, rtol=0, atol=1e-11 * np.abs(theirs).max())  # condition below 100


def test_its_factor_is_that_of_lapack():
    pattern, values, matrix = nearly_symmetric(brick(3, 2, 2), skew=0.0)
    own = cholesky.factor(pattern.fronts, pattern.tree, values)
    rhs = np.random.default_rng(1).random((pattern.n, 2))
    np.testing.assert_allclose(own.solve(rhs), np.linalg.solve(matrix.toarray(), rhs), rtol=0, atol=1e-13)


@pytest.mark.parametrize("size", [1.0, 1e-30, 1e30], ids=["of order 1", "tiny", "huge"])
def test_single_precision_is_iterated_to_the_accuracy_of_double_precision(size):
    """Half the memory; sizes beyond the range of single precision do not matter."""
    pattern, values, matrix = nearly_symmetric(brick(5, 4, 4), skew=0.0)
    factor, rhs = linear.factorise(pattern, size * values), size**2 * np.random.default_rng(1).random((pattern.n, 3))
    assert factor.kind is linear.FactorKind.SINGLE and factor.lu.entries.dtype == np.float32
    exact = size * splu(matrix).solve(rhs / size**2)
    for solution in (factor.solve(rhs), factor.solve_transposed(rhs)):
        np.testing.assert_allclose(solution, exact, rtol=0, atol=1e-11 * np.abs(exact).max())


def test_double_precision_takes_over_where_single_precision_is_not_accurate(monkeypatch):
    """A slender cantilever: condition 1e9."""
    mesh = brick(60, 1, 1)
    nodes = mesh.nodes * [5.0, 0.02, 0.02]
    clamped = where(replace(mesh, nodes=nodes), lambda x, *_: x < 1e-9)
    constraints = held(replace(mesh, nodes=nodes), [(clamped, i, 0.0) for i in range(3)], 2)
    system = discretise(body(replace(mesh, nodes=nodes), "solid", "elastic", "small", constraints))
    drives = drives_at(system.body, np.arange(2.0), 1.0)
    at_rest = evaluate_system(system, {"BODY": PARAMETERS["elastic"]}, np.zeros_like(nodes), system.rest_states(), 1.0,
                              drives)
    values, made = stiffness_values(system, at_rest), []
    monkeypatch.setattr(cholesky, "factor", lambda *a, **k: made.append(k) or original_cholesky(*a, **k))
    factor, rhs = linear.factorise(system.pattern, values), np.ones(system.pattern.n)
    assert factor.kind is linear.FactorKind.DOUBLE and len(made) == 2
    solution = factor.solve(rhs)
    assert np.linalg.norm(factor.matrix @ solution - rhs) < 1e-9 * np.abs(values).max() * np.linalg.norm(solution)
    linear.factorise(system.pattern, values, factor.kind)  # what served is tried first from then on
    assert len(made) == 3


@pytest.mark.parametrize("given", [{"shift": -3.0}, {"skew": 2.0}], ids=["indefinite", "far from symmetric"])
def test_an_lu_takes_over(given):
    pattern, values, matrix = nearly_symmetric(brick(4, 3, 3), **given)
    factor, rhs = linear.factorise(pattern, values), np.ones(pattern.n)
    assert isinstance(factor.lu, tuple)
    assert np.abs(matrix @ factor.solve(rhs) - rhs).max() < 1e-10


original = linear.factorise
original_cholesky = cholesky.factor


@pytest.mark.parametrize("orders, again", [(0.02, False), (2.0, True)], ids=["near", "far"])
def test_a_kept_factor_gives_the_solution_of_another_matrix_or_is_replaced(orders, again, monkeypatch):
    pattern, values, matrix = nearly_symmetric(brick(4, 3, 3))
    factor = linear.factorise(pattern, values)
    scale = 10.0 ** (orders * np.random.default_rng(3).random(pattern.n))
    columns = np.repeat(np.arange(pattern.n), np.diff(pattern.indptr))
    other = pattern.matrix(matrix.data * scale[pattern.indices] * scale[columns])
    made, rhs = [], np.random.default_rng(2).random((pattern.n, 3))
    monkeypatch.setattr(linear, "factorise", lambda *a, **k: made.append(1) or original(*a, **k))
    kept = linear.Factor(pattern, factor.lu, other, of_earlier_tangent=True)
    assert np.abs(other @ kept.solve(rhs) - rhs).max() < 1e-10 and bool(made) is again
    assert np.abs(other.T @ kept.solve_transposed(rhs) - rhs).max() < 1e-10


def test_threads_give_the_same_bits(monkeypatch):
    """Of a factorisation, of solutions, and of a march whose points are computed in parts."""
    pattern, values, _ = nearly_symmetric(brick(8, 7, 6), range(0, 300, 7))
    rhs = np.random.default_rng(0).random((pattern.n, 3))
    alone = linear.factorise(pattern, values.copy())
    with solver_threads(3):
        together = linear.factorise(pattern, values.copy())
        assert np.array_equal(together.lu.entries, alone.lu.entries)
        assert np.array_equal(together.solve(rhs), alone.solve(rhs))
    monkeypatch.setattr(in_parts, "MIN_POINTS", 1)
    monkeypatch.setattr(known_pattern, "_kept", {})  # a pattern knows how it is factorised
    one = march(*stretched(), [Direction("yield_stress", material=(0, 2))])
    with solver_threads(2):
        two = list(march(*stretched(), [Direction("yield_stress", material=(0, 2))]))
    for a, b in zip(one, two, strict=True):
        assert np.array_equal(a.u, b.u) and np.array_equal(a.du, b.du)


def stretched():
    mesh = brick(4, 3, 3)
    left, right = (where(mesh, lambda x, *_, at=at: abs(x - at) < 1e-9) for at in (0.0, 4.0))
    motion = [(right, 0, np.linspace(0.0, 0.048, 4))]
    model = body(mesh, "solid", "j2_linear", "finite", held(mesh, [(left, i, 0.0) for i in range(3)] + motion, 4))
    return model, {"BODY": PARAMETERS["j2_linear"]}, np.arange(4.0)


def test_kept_factors_of_superlu_serve_a_near_tangent_and_its_transpose():
    """SuperLU factorises where the fronts are not accurate; adjoints ask for the transpose of a later tangent."""
    pattern, values, matrix = nearly_symmetric(brick(4, 3, 3))
    near = csc_array((values * (1.0 + 1e-3 * np.cos(np.arange(values.size))), matrix.indices, matrix.indptr),
                     shape=matrix.shape)
    factor = linear.Factor(pattern, splu(matrix), matrix=near, of_earlier_tangent=True)
    rhs = np.random.default_rng(2).random((pattern.n, 3))
    np.testing.assert_allclose(near @ factor.solve(rhs), rhs, rtol=0, atol=1e-11)
    np.testing.assert_allclose(near.T @ factor.solve_transposed(rhs), rhs, rtol=0, atol=1e-11)
