"""LU by fronts against SuperLU, and where its row exchanges are not enough."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csc_array
from scipy.sparse.linalg import SuperLU, splu
from test_factorisation_cost import brick, dofs_of, plate

from idic.fe.solver import linear, multifrontal, small_fronts, storage, substitution
from idic.fe.solver.linear import FactorKind, SingularMatrix, factorise, make_pattern
from idic.fe import solver_threads

WAYS = {"small": (np.inf, small_fronts.SmallFactor), "by LAPACK": (0, tuple)}


@pytest.fixture(params=WAYS)
def way(request, monkeypatch):
    """How fronts are factorised; the type of their factors."""
    least, kind = WAYS[request.param]
    monkeypatch.setattr(linear, "MIN_OPERATIONS_PER_ENTRY", least)
    return kind


def assembled(mesh, prescribed=(), shift=20.0):
    """A pattern by fronts, and random unsymmetric values on it, the nearer to singular the smaller the shift."""
    dofs, rng = dofs_of(mesh), np.random.default_rng(1)
    pattern = make_pattern(mesh.nodes, [dofs], np.asarray(prescribed, dtype=int))
    values, m = np.zeros(pattern.n_stored), dofs.shape[1]
    storage.scatter(rng.standard_normal((len(dofs), m, m)) + shift * np.eye(m), pattern.positions(dofs), values)
    return pattern, values, csc_array((values.copy(), pattern.indices, pattern.indptr), shape=(pattern.n, pattern.n))


@pytest.mark.parametrize("mesh, prescribed",
                         [(plate(12, 9), range(40)), (brick(6, 5, 4), range(0, 300, 7)), (brick(1, 1, 1), ())],
                         ids=["plate", "brick", "one element"])
def test_fronts_solve_as_superlu_does(mesh, prescribed, way):
    pattern, values, matrix = assembled(mesh, prescribed)
    factor, reference = factorise(pattern, values, kind=FactorKind.LU), splu(matrix)
    rhs = np.random.default_rng(0).random((pattern.n, 3))
    assert isinstance(factor.lu, way)
    for own, theirs in ((factor.solve(rhs), reference.solve(rhs)),
                        (factor.solve_transposed(rhs), reference.solve(rhs, "T")),
                        (factor.solve(rhs[:, 0]), reference.solve(rhs[:, 0]))):
        np.testing.assert_allclose(own, theirs, rtol=0, atol=1e-12 * np.abs(theirs).max())  # condition below 1e3


@pytest.mark.parametrize("shift", [20.0, 2.0], ids=["as numbered", "rows exchanged"])
@pytest.mark.parametrize("n", [8, 131])
def test_columns_side_by_side_are_solved_as_one_by_one(n, shift):
    pattern, values, _ = assembled(plate(12, 9), range(40), shift)
    factor = small_fronts.factor(pattern.small_fronts, values)
    own_row = np.arange(pattern.n) - np.repeat(pattern.small_fronts.first, np.diff([*pattern.small_fronts.first,
                                                                                    pattern.n]))
    assert (factor.exchanges != own_row).any() == (shift == 2.0)
    rhs = np.random.default_rng(0).random((pattern.n, n))
    for transposed in (False, True):
        one_by_one = np.hstack([factor.solve(column[:, None], transposed) for column in rhs.T])
        np.testing.assert_array_equal(factor.solve(rhs, transposed), one_by_one)


def test_every_free_equation_is_the_pivot_of_one_front():
    pattern, _, _ = assembled(plate(9, 7), range(0, 200, 3))
    ends = [front.end for front in pattern.fronts]
    assert [front.first for front in pattern.fronts] == [0, *ends[:-1]] and ends[-1] == pattern.n
    assert sorted(pattern.dofs) == sorted(set(range(len(pattern.equation))) - set(range(0, 200, 3)))
    assert all((front.boundary >= front.end).all() for front in pattern.fronts)


@pytest.mark.parametrize("pivots", [0.0, 1e-14], ids=["singular", "tiny"])
def test_pivots_that_must_come_from_another_front_are_left_to_superlu(pivots, way):
    pattern, values, matrix = assembled(plate(6, 6))
    leaf = pattern.fronts[0]
    columns = np.repeat(np.arange(pattern.n), np.diff(pattern.indptr))
    row, inside = pattern.indices, columns < leaf.end
    # equations without a pivot in their front, regular with others
    touching = np.unique(row[~inside & (row < leaf.end)])[:4]
    values[np.isin(row, touching) & inside] *= pivots
    matrix = csc_array((values.copy(), pattern.indices, pattern.indptr), shape=matrix.shape)
    factor, rhs = factorise(pattern, values, kind=FactorKind.LU), np.ones(pattern.n)
    assert isinstance(factor.lu, SuperLU)
    solution = factor.solve(rhs)
    assert np.abs(matrix @ solution - rhs).max() < 1e-9 * np.abs(matrix).max() * np.abs(solution).max()


def test_a_singular_matrix_is_refused():
    pattern, values, _ = assembled(plate(6, 6))
    with pytest.raises(SingularMatrix):
        factorise(pattern, np.zeros_like(values))
    with pytest.raises(SingularMatrix, match="not finite"):
        factorise(pattern, np.full_like(values, np.nan))


def test_threads_give_the_same_bits(monkeypatch):
    """Also with triangles so small that all ways of solving with them occur."""
    monkeypatch.setattr(substitution, "MIN_FRONTS_FOR_THREADS", 1)
    monkeypatch.setattr(linear, "MIN_OPERATIONS_PER_ENTRY", 0)
    pattern, values, _ = assembled(brick(8, 7, 6), range(0, 300, 7))
    rhs = np.random.default_rng(0).random((pattern.n, 3))
    alone = factorise(pattern, values.copy(), kind=FactorKind.LU)
    expected = alone.solve(rhs)
    for n in (2, 3):
        assert len(multifrontal.independent_parts(pattern.fronts, n)) >= n
        with solver_threads(n):
            together = factorise(pattern, values.copy(), kind=FactorKind.LU)
            for own, theirs in zip(together.lu, alone.lu, strict=True):
                assert np.array_equal(own.blocks, theirs.blocks) and np.array_equal(own.numbers, theirs.numbers)
            assert np.array_equal(together.solve(rhs), expected)
            assert np.array_equal(together.solve(rhs[:, 0]), alone.solve(rhs[:, 0]))


def test_parts_are_whole_subtrees_of_about_equal_work():
    pattern, _, _ = assembled(brick(8, 7, 6))
    parts = multifrontal.independent_parts(pattern.fronts, 2)
    covered = [k for first, end in parts for k in range(first, end)]
    assert len(set(covered)) == len(covered)
    for first, end in parts:
        below = {child for k in range(first, end) for child in pattern.fronts[k].children}
        assert below == set(range(first, end - 1))  # all but its own root


def test_a_singular_matrix_is_refused_with_threads_too():
    pattern, values, _ = assembled(plate(6, 6))
    values[pattern.indices == 5] = 0.0
    with solver_threads(2), pytest.raises(SingularMatrix):
        factorise(pattern, values)
