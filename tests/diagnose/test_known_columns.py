"""Columns that every model has, with amplitudes known to some per cent: other columns count by what exceeds them."""

import numpy as np
import pytest

from idic.diagnose.residual.score import Scores


def test_columns_beside_known_ones_are_tested_as_if_all_were_fitted_together():
    rng, std = np.random.default_rng(1), 0.5
    parameters, tested, known = (rng.standard_normal((60, n)) for n in (2, 3, 2))
    residual = rng.standard_normal(60) + known @ [1.4, 0.7]
    columns = np.hstack([tested, known])
    taken = np.linalg.solve(parameters.T @ parameters, parameters.T @ columns)
    free = columns - parameters @ taken
    scores = Scores(tuple("abcde"), ("p", "q"), free.T @ residual, columns.T @ columns, free.T @ free, -taken)
    found = scores.beside(2, std, np.array([True, True, False]))
    assert found.names == ("a", "b", "c")
    assert found.z[2] == scores.z[2]  # of another kind
    assert np.allclose(found.information, found.information.T)
    assert np.linalg.eigvalsh(found.information).min() > 0.0
    for k in range(2):  # least squares of the parameters, one column, and the known ones held at 1 +- std
        base = np.hstack([parameters, tested[:, [k]], known])
        held = np.diag([0.0, 0.0, 0.0, std**-2, std**-2])
        inverse = np.linalg.inv(base.T @ base + held)
        fit = inverse @ (base.T @ residual + held @ np.ones(5))
        assert found.expected_change[k] == pytest.approx(fit[2])
        assert found.std[k] == pytest.approx(np.sqrt(inverse[2, 2]))
        without = np.hstack([parameters, known])
        moved = -np.linalg.solve(without.T @ without + held[np.ix_([0, 1, 3, 4], [0, 1, 3, 4])],
                                 without.T @ tested[:, k])
        assert found.moves[:, k] == pytest.approx(moved[:2])
