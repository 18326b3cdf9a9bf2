"""A free yield surface has weights for Hill's, which it was not told, along the stresses of a test."""

import numpy as np
import pytest
from free_surface import TRUTH, truth_of
from scipy.optimize import nnls

from idic.materials.plasticity.free_locus import POWER
from idic.materials.plasticity.surface_forms import equivalent, hill48, powers

pytestmark = pytest.mark.slow  # simulates the test


def test_weights_for_the_visited_stresses_meet_hills_surface_within_half_a_percent():
    """Of the motion without images: what an identification of the weights can reach (docs/composed-law.md)."""
    flowing = truth_of().flowing
    visited = flowing / np.linalg.norm(flowing, axis=1)[:, None]
    assert len(visited) > 1000
    q = hill48(visited, *(TRUTH[name] for name in ("r0", "r45", "r90")))
    weights = nnls(powers(6, visited[::7]) / q[::7, None] ** POWER, np.ones(len(q[::7])))[0]
    found = equivalent(weights, visited)[0] / q
    assert np.percentile(np.abs(found / np.median(found) - 1.0), 99.0) < 0.005
