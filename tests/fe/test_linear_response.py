"""Laws that say they are linear: they are, and their kept response is the law's own in every mode."""

import numpy as np
import pytest

from idic.fe.assembly.linear import kept_response
from idic.laws import all_laws, compile as compile_law, directional_stresses, get_law, point_tangents

LINEAR = [name for name, spec in all_laws().items() if spec.linear]


def test_the_linear_laws_are_those_that_are_known_to_be():
    assert LINEAR == ["elastic", "orthotropic"]


@pytest.mark.parametrize("mode", [0, 1, 2])
@pytest.mark.parametrize("name", LINEAR)
def test_the_kept_response_is_that_of_the_law_at_any_strain(name, mode):
    law, rng = compile_law(name, "small"), np.random.default_rng(3)
    d, n, params = 3 if mode == 0 else 2, 8, get_law(name).defaults()
    F = np.eye(d) + 0.02 * rng.normal(size=(n, d, d))
    state = np.tile(law.initial_state(mode), (n, 1))
    P, state_new, A, ok = point_tangents(law, mode, F, state, params, 1.0)
    dparams = np.eye(len(params)) * np.abs(params)
    dP, _, also = directional_stresses(law, mode, F, state, params, 1.0, np.zeros((n, len(params), d, d)), None,
                                     dparams, guess=np.ascontiguousarray(state_new[:, -1]) if mode == 2 else None)
    assert ok and also
    nodes = 20 if d == 3 else 8
    kept = kept_response(law, mode, rng.normal(size=(n, nodes, d)), np.ones(n), 1, mean_dilatation=False)
    found = kept.of(params)
    stress, seen = found.stress(F)
    scale = np.abs(P).max()
    assert np.abs(stress - P).max() < 1e-12 * scale
    assert np.abs(found.tangent[0] - A).max() < 1e-12 * np.abs(A).max()
    assert seen.shape == state_new.shape and np.abs(seen - state_new).max(initial=0.0) < 1e-12
    assert np.abs(kept.changes(params, dparams, F) - dP).max() < 1e-9 * np.abs(dP).max()
    assert kept.of(params) is found and kept.of(1.1 * params) is not found


def test_a_law_that_is_not_linear_or_of_finite_strain_keeps_nothing():
    grads, weights = np.zeros((4, 8, 2)), np.ones(4)
    assert kept_response(compile_law("neo_hookean"), 2, grads, weights, 1, False) is None
    assert kept_response(compile_law("elastic", "finite"), 2, grads, weights, 1, False) is None
    assert kept_response(compile_law("elastic", "small"), 1, grads, weights, 1, True) is None
