"""The sums that tangents in closed form are made of, beside their slow twins in NumPy."""

import numpy as np
import pytest
from numba import njit

from idic.laws import tensors

PLACES = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])  # of the entries of a symmetric tensor in a 6-tuple


@pytest.fixture
def draw():
    rng = np.random.default_rng(5)
    return lambda *shape: rng.standard_normal(shape)


def symmetric(values):
    return values[PLACES]


@njit
def pushed(f, S, D, A):
    tensors.push_tangent(tensors.load(f), (S[0], S[1], S[2], S[3], S[4], S[5]), D, A)


@njit
def filled(x, y, u, z, p, q, M, B, A):
    load = tensors.load
    tensors.fill_tangent(load(x), load(y), load(u), load(z), load(p), load(q), A)
    tensors.add_tangent(load(u), load(x), load(q), load(z), A)
    tensors.add_blocks((M[0], M[1], M[2], M[3], M[4], M[5]), (B[0], B[1], B[2], B[3], B[4], B[5]), A)


def test_a_tangent_of_green_strain_is_pushed_forward(draw):
    """dP = dF S + F dS, dS = D : sym(F^T dF)."""
    f, S, D, A = draw(3, 3), draw(6), draw(6, 6), np.empty((9, 9))
    pushed(f, S, D, A)
    dF = draw(3, 3)
    dE = 0.5 * (f.T @ dF + dF.T @ f)
    full = D[PLACES[:, :, None, None], PLACES]
    expected = dF @ symmetric(S) + f @ np.einsum("abcd,cd->ab", full, dE)
    np.testing.assert_allclose(A @ dF.ravel(), expected.ravel(), rtol=0, atol=1e-13 * np.abs(A).sum())


def test_a_tangent_is_a_sum_of_products_of_tensors(draw):
    """x (y : dF) + u (z : dF) + q dF^T p of the sum, and the blocks dF M + B dF."""
    x, y, u, z, p, q = draw(6, 3, 3)
    M, B, A, dF = draw(6), draw(6), np.empty((9, 9)), draw(3, 3)
    filled(x, y, u, z, p, q, M, B, A)
    expected = (x * np.sum(y * dF) + u * np.sum(z * dF) + q @ dF.T @ p + u * np.sum(x * dF) + z @ dF.T @ q
                + dF @ symmetric(M) + symmetric(B) @ dF)
    np.testing.assert_allclose(A @ dF.ravel(), expected.ravel(), rtol=0, atol=1e-13 * np.abs(A).sum())
