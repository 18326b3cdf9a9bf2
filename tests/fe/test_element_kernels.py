"""Element matrices of the plane."""

import numpy as np
import pytest

from idic.fe.assembly import kernels


@pytest.mark.parametrize("nn", [3, 4, 6, 8])
def test_element_matrices_of_the_plane(nn):
    rng = np.random.default_rng(nn)
    grads, weights, A = rng.standard_normal((20, nn, 2)), rng.random(20) + 0.1, rng.standard_normal((20, 4, 4))
    general, fast = np.empty((2, 5, 2 * nn, 2 * nn))
    kernels.element_stiffness(grads, weights, A, general)
    kernels.element_stiffness_plane(grads, weights, A, fast)
    np.testing.assert_allclose(fast, general, atol=1e-12)
