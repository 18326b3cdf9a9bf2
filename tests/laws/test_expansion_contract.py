"""What every law owes a warmed body: stress-free expansion, consistent tangent, exact history, objectivity."""

import numpy as np
import pytest
from law_paths import random_path, rotations

from idic.fe.assembly import expansion
from idic.laws import point_stresses, point_tangents

N = 4
WARM = np.array([0.004, -0.003, 0.01, 0.0])  # free expansion of the points: of the size of a metal's yield strain


def follow_warm(law, mode, path, warmth, params):
    """Stress at the end and state after every step; path (steps, n, d, d), warmth (steps, n)."""
    state = np.tile(law.initial_state(mode), (path.shape[1], 1))
    for F, e in zip(path, warmth, strict=True):
        P, state, ok = expansion.stress(law, mode, F, e, state, params, 1.0)
        assert ok
    return P, state


def warmth_of(steps):
    return np.outer(np.linspace(0.25, 1.0, steps), WARM)


def stiffness_scale(law, mode, params):
    F, state = np.eye(3 if mode == 0 else 2)[None], law.initial_state(mode)[None]
    return np.abs(point_tangents(law, mode, F, state, params, 1.0)[2]).max()


def test_a_freely_expanded_point_has_no_stress(law, mode, params):
    if mode == 1:
        pytest.skip("plane strain holds back the third direction")
    d = 3 if mode == 0 else 2
    F = np.eye(d) * (1.0 + WARM)[:, None, None]
    P, state = follow_warm(law, mode, F[None], WARM[None], params)
    assert np.abs(P).max() < 1e-11 * stiffness_scale(law, mode, params)  # F33_TOLERANCE of the plane-stress search
    if mode == 2:
        np.testing.assert_allclose(state[:, -1], 1.0 + WARM, atol=1e-11)


def test_plane_strain_is_the_solid_with_its_third_direction_held(law, params, rng):
    path = random_path(rng, N, 2)
    full = np.tile(np.eye(3), (*path.shape[:2], 1, 1))
    full[:, :, :2, :2] = path
    P, state = follow_warm(law, 1, path, warmth_of(len(path)), params)
    P_full, state_full = follow_warm(law, 0, full, warmth_of(len(path)), params)
    np.testing.assert_array_equal(P, P_full[:, :2, :2])
    np.testing.assert_array_equal(state, state_full)


def test_no_expansion_is_the_law_itself(law, mode, params, rng):
    path = random_path(rng, N, 3 if mode == 0 else 2)
    P, state = follow_warm(law, mode, path, np.zeros((len(path), N)), params)
    plain = np.tile(law.initial_state(mode), (N, 1))
    for F in path:
        P_plain, plain, _ = point_stresses(law, mode, F, plain, params, 1.0)
    np.testing.assert_allclose(P, P_plain, atol=1e-14 * stiffness_scale(law, mode, params))
    np.testing.assert_allclose(state, plain, atol=1e-14)


def test_the_tangent_of_a_warmed_point_is_the_derivative_of_its_stress(law, mode, params, rng):
    d = 3 if mode == 0 else 2
    path = random_path(rng, N, d)
    _, state = follow_warm(law, mode, path[:-1], warmth_of(len(path))[:-1], params)
    A = expansion.tangent(law, mode, path[-1], WARM, state, params, 1.0)[2]
    h = 3e-7
    for c in range(d * d):
        step = h * np.eye(1, d * d, c)[0].reshape(d, d)
        ahead, behind = (expansion.stress(law, mode, path[-1] + s, WARM, state, params, 1.0)[0] for s in (step, -step))
        quotient = ((ahead - behind) / (2 * h)).reshape(N, d * d)
        np.testing.assert_allclose(quotient, A[:, :, c], atol=1e-6 * stiffness_scale(law, mode, params))


def test_the_history_of_a_warmed_point_is_differentiated_exactly(law, mode, params, rng):
    """By the coefficient (all temperatures scaled), by the path and by every parameter, over the whole history."""
    d = 3 if mode == 0 else 2
    path, dpath = random_path(rng, N, d), random_path(rng, N, d) - np.eye(d)
    warmth, n_params = warmth_of(len(path)), len(params)
    nd = n_params + 2
    dparams = np.zeros((nd, n_params))
    dparams[2:] = np.diag(np.where(params == 0.0, 1.0, params))
    state = np.tile(law.initial_state(mode), (N, 1))
    dstate = np.zeros((N, nd, state.shape[1]))
    for F, dF_path, e in zip(path, dpath, warmth, strict=True):
        P, state_new, ok = expansion.stress(law, mode, F, e, state, params, 1.0)
        assert ok
        dF, de = np.zeros((N, nd, d, d)), np.zeros((N, nd))
        dF[:, 0], de[:, 1] = dF_path, e
        dP, dstate, ok = expansion.directional(law, mode, F, e, P, state, params, 1.0, dF, dstate, dparams, de,
                                               guess=state_new[:, -1] if mode == 2 else None)
        assert ok
        state = state_new
    h = 1e-6
    for k in range(nd):
        ends = [follow_warm(law, mode, path + s * h * dpath * (k == 0), warmth * (1 + s * h * (k == 1)),
                            params + s * h * dparams[k]) for s in (1, -1)]
        stress_quotient = (ends[0][0] - ends[1][0]) / (2 * h)
        state_quotient = (ends[0][1] - ends[1][1]) / (2 * h)
        floor = 1e-9 * stiffness_scale(law, mode, params)  # as in test_law_contract.py
        np.testing.assert_allclose(dP[:, k], stress_quotient, atol=floor + 1e-6 * np.abs(stress_quotient).max())
        np.testing.assert_allclose(dstate[:, k], state_quotient, atol=1e-8)


def test_rotating_a_warmed_body_only_rotates_its_stress(law, params, rng):
    if law.small:
        pytest.skip("small-strain laws are not objective, by definition")
    path, Q = random_path(rng, N, 3), rotations(rng, N)
    P, _ = follow_warm(law, 0, path, warmth_of(len(path)), params)
    P_turned, _ = follow_warm(law, 0, Q @ path, warmth_of(len(path)), params)
    np.testing.assert_allclose(P_turned, Q @ P, atol=1e-12 * stiffness_scale(law, 0, params))
