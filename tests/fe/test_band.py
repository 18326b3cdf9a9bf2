"""LU of bands by LAPACK, and the element matrices that go into them."""

import numpy as np
import pytest
from scipy.linalg.lapack import dgbtrf, dgbtrs

from idic.fe.solver.lapack import factorise_band, solve_band
from idic.fe.assembly import kernels


def stored(dense, kl):
    """A dense matrix as a flat LAPACK band."""
    n = len(dense)
    flat = np.zeros((3 * kl + 1, n), order="F")
    for i, j in zip(*np.nonzero(dense), strict=True):
        flat[2 * kl + i - j, j] = dense[i, j]
    return flat.ravel(order="F")


def banded(rng, n, kl, filled, diagonal):
    i, j = np.indices((n, n))
    dense = np.where((abs(i - j) <= kl) & (rng.random((n, n)) < filled), rng.standard_normal((n, n)), 0.0)
    return dense + diagonal * np.eye(n)


def test_lapack_is_called_as_scipy_does_bit_for_bit():
    """Without SciPy's wrappers, which keep other threads waiting."""
    rng, n, kl = np.random.default_rng(5), 60, 9
    flat = stored(banded(rng, n, kl, 1.0, 0.3), kl)
    theirs, pivots, info = dgbtrf(flat.reshape((3 * kl + 1, n), order="F"), kl, kl)
    ours = flat.copy().reshape((3 * kl + 1, n), order="F")
    exchanges, zero = factorise_band(ours, kl)
    assert info == zero == 0 and np.array_equal(ours, theirs) and np.array_equal(exchanges - 1, pivots)
    for transposed in (False, True):
        x = np.asfortranarray(rng.standard_normal((n, 3)))
        expected = dgbtrs(theirs, kl, kl, x, pivots, trans=int(transposed))[0]
        solve_band(ours, kl, exchanges, x, transposed)
        assert np.array_equal(x, expected)
    singular = flat.copy()
    singular.reshape((n, 3 * kl + 1))[17] = 0.0
    assert factorise_band(singular.reshape((3 * kl + 1, n), order="F"), kl)[1] > 0


@pytest.mark.parametrize("nn", [3, 4, 6, 8])
def test_element_matrices_of_the_plane(nn):
    rng = np.random.default_rng(nn)
    grads, weights, A = rng.standard_normal((20, nn, 2)), rng.random(20) + 0.1, rng.standard_normal((20, 4, 4))
    general, fast = np.empty((2, 5, 2 * nn, 2 * nn))
    kernels.element_stiffness(grads, weights, A, general)
    kernels.element_stiffness_plane(grads, weights, A, fast)
    np.testing.assert_allclose(fast, general, atol=1e-12)
