"""Equations of a frame's own unknowns: positive, semi-definite, neither."""

import numpy as np
import pytest

from idic.correlation.image_equations.system import solve_positive


def test_unknowns_that_look_alike_share_what_they_explain():
    columns = np.random.default_rng(3).standard_normal((40, 5)).astype(np.float32)
    columns[:, 3] = 2.0 * columns[:, 1]  # gain and offset of a patch that shows one grey value
    data = columns @ np.array([1.0, -2.0, 0.5, 0.0, 3.0])
    gram = columns.T @ columns  # in single precision: its zero eigenvalue may be a little below zero
    gram = gram.astype(float) - 1e-8 * np.diag(np.diagonal(gram))
    found = solve_positive(gram, columns.T @ data)
    np.testing.assert_allclose(columns @ found, data, atol=1e-4)
    assert np.abs(found).max() < 4.0  # none of the huge, opposite values that cancel
    both = solve_positive(gram, np.column_stack([columns.T @ data, np.zeros(5)]))
    np.testing.assert_allclose(both, np.column_stack([found, np.zeros(5)]), atol=1e-12)


def test_an_indefinite_matrix_is_refused():
    with pytest.raises(np.linalg.LinAlgError):
        solve_positive(np.array([[1.0, 2.0], [2.0, 1.0]]), np.ones(2))
