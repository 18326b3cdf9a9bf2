"""The kernels for three dimensions do what the general ones do."""

import numpy as np
import pytest

from idic.fe.assembly import kernels, kernels_solid, locking

N_EL, N_NODES, ND = 5, 20, 4


@pytest.fixture(params=[4, 8, 10], ids="{}-nodes".format)
def elements(request):
    """connectivity, grads, weights, F (n_points, 3, 3), scale, and a source of numbers."""
    rng, nn = np.random.default_rng(request.param), request.param
    connectivity = np.array([rng.permutation(N_NODES)[:nn] for _ in range(N_EL)])
    n = 8 * N_EL
    return (connectivity, rng.standard_normal((n, nn, 3)), rng.random(n) + 0.1,
            np.eye(3) + 0.2 * rng.standard_normal((n, 3, 3)), 1.0 + 0.1 * rng.random(n), rng)


def test_element_matrices(elements):
    connectivity, grads, weights, *_, rng = elements
    A, size = rng.standard_normal((len(weights), 9, 9)), 3 * connectivity.shape[1]
    general, fast = np.empty((N_EL, size, size)), np.empty((N_EL, size, size))
    kernels.element_stiffness(grads, weights, A, general)
    kernels_solid.element_stiffness(grads, weights, A, fast)
    np.testing.assert_allclose(fast, general, atol=1e-12)


def test_the_tangent_of_mean_dilatation(elements):
    connectivity, grads, weights, F, scale, rng = elements
    A, P, Jbar = rng.standard_normal((len(weights), 9, 9)), rng.standard_normal(F.shape), 1.0 + 0.1 * rng.random(N_EL)
    changed, sides = [A.copy(), A.copy()], np.empty((2, N_EL, 3 * connectivity.shape[1]))
    locking.tangent_finite(F, scale, Jbar, grads, weights, P, changed[0], sides[0])
    kernels_solid.tangent_finite(F, scale, Jbar, grads, weights, P, changed[1], sides[1])
    np.testing.assert_allclose(changed[1], changed[0], atol=1e-11 * np.abs(changed[0]).max())  # F is nearly singular
    np.testing.assert_allclose(sides[1], sides[0], atol=1e-11 * np.abs(sides[0]).max())        # at some points


def test_changes_along_directions(elements):
    connectivity, grads, weights, *_, rng = elements
    du = rng.standard_normal((N_NODES, 3, ND))
    dF, force = np.empty((2, len(weights), ND, 3, 3)), np.zeros((2, N_NODES, 3, ND))
    for k, module in enumerate((kernels, kernels_solid)):
        module.gradient_changes(connectivity, grads, du, dF[k])
        module.add_internal_force_changes(connectivity, grads, weights, dF[0], force[k])
    np.testing.assert_allclose(dF[1], dF[0], atol=1e-12)
    np.testing.assert_allclose(force[1], force[0], atol=1e-11)
