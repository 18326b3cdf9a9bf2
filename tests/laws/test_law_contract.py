"""What every registered law must do, in every kinematics and mode."""

import numpy as np
import pytest
from law_paths import SIZE, follow, random_path, rotations

from idic.laws import compile, directional_stresses, point_stresses, point_tangents

N = 6


def at_rest(law, mode, n=N):
    d = 3 if mode == 0 else 2
    return np.tile(np.eye(d), (n, 1, 1)), np.tile(law.initial_state(mode), (n, 1))


def loaded(law, mode, params, rng, n=N):
    """A loaded state with history, and the next F: beyond yield for the plastic laws, unloading at some points."""
    path = random_path(rng, n, 3 if mode == 0 else 2)
    _, state = follow(law, mode, path[:-1], params)
    return path[-1], state


def stiffness_scale(law, mode, params):
    F, state = at_rest(law, mode, 1)
    return np.abs(point_tangents(law, mode, F, state, params, 1.0)[2]).max()


def test_every_parameter_is_documented(law):
    for p in law.spec.parameters:
        assert p.unit and p.description
        assert p.default is not None and p.bounds[0] <= p.default <= p.bounds[1]
    assert law.spec.reference


def test_there_is_no_stress_and_no_change_of_state_at_rest(law, mode, params):
    F, state = at_rest(law, mode)
    P, state_new, ok = point_stresses(law, mode, F, state, params, 1.0)
    assert ok
    assert np.abs(P).max() <= 1e-12 * stiffness_scale(law, mode, params)  # rounding of 1 times the stiffness
    np.testing.assert_allclose(state_new, state, atol=1e-12)


def test_inputs_are_left_untouched(law, mode, params, rng):
    F, state = loaded(law, mode, params, rng)
    dF, dstate, dparams = rng.standard_normal((N, 2, *F.shape[1:])), np.zeros((N, 2, state.shape[1])), \
        rng.standard_normal((2, len(params)))
    inputs = (F, state, params, dF, dstate, dparams)
    before = [x.copy() for x in inputs]
    point_stresses(law, mode, F, state, params, 1.0)
    point_tangents(law, mode, F, state, params, 1.0)
    directional_stresses(law, mode, F, state, params, 1.0, dF, dstate, dparams)
    for x, y in zip(inputs, before, strict=True):
        np.testing.assert_array_equal(x, y)


def test_a_point_does_not_know_its_neighbours(law, mode, params, rng):
    F, state = loaded(law, mode, params, rng)
    together = point_tangents(law, mode, F, state, params, 1.0)
    for i in range(N):
        alone = point_tangents(law, mode, F[i:i + 1], state[i:i + 1], params, 1.0)
        for x, y in zip(alone[:3], together[:3], strict=True):
            np.testing.assert_array_equal(x[0], y[i])


def test_the_three_functions_agree_on_stress_and_tangent(law, mode, params, rng):
    F, state = loaded(law, mode, params, rng)
    d = F.shape[1]
    P, state_new, ok = point_stresses(law, mode, F, state, params, 1.0)
    P_t, state_t, A, ok_t = point_tangents(law, mode, F, state, params, 1.0)
    unit = np.tile(np.eye(d * d).reshape(d * d, d, d), (N, 1, 1, 1))
    dP, _, ok_d = directional_stresses(law, mode, F, state, params, 1.0, unit)
    assert ok and ok_t and ok_d
    scale = stiffness_scale(law, mode, params)
    # the last correction of F33 is applied to first order, so the routes differ by F33_TOLERANCE squared at most,
    # and by rounding; derivatives differ by F33_TOLERANCE times the curvature (about 1 / elastic strain = 1e3)
    np.testing.assert_allclose(P_t, P, atol=1e-13 * scale)
    np.testing.assert_allclose(state_t, state_new, atol=1e-12)
    np.testing.assert_allclose(dP.reshape(N, d * d, d * d).transpose(0, 2, 1), A, atol=1e-8 * scale)


def test_the_tangent_is_the_derivative_of_the_stress(law, mode, params, rng):
    F, state = loaded(law, mode, params, rng)
    d = F.shape[1]
    _, _, A, _ = point_tangents(law, mode, F, state, params, 1.0)
    h = 3e-7
    for c in range(d * d):
        step = h * np.eye(1, d * d, c)[0].reshape(d, d)
        ahead, behind = (point_stresses(law, mode, F + s, state, params, 1.0)[0] for s in (step, -step))
        quotient = ((ahead - behind) / (2 * h)).reshape(N, d * d)
        # truncation h^2 / (elastic strain)^2 = (3e-7 / 1e-3)^2 = 1e-7, rounding 1e-16 / h = 3e-10
        np.testing.assert_allclose(quotient, A[:, :, c], atol=1e-6 * stiffness_scale(law, mode, params))


@pytest.mark.slow  # compiles every law anew; differences of the whole history: below
def test_hand_written_derivatives_equal_the_complex_step(law, mode, params, rng):
    if not law.by_hand:
        pytest.skip("the complex step is this law's own derivative")
    oracle = compile(law.spec.name, law.kinematics, derivative="complex_step")
    F, state = loaded(law, mode, params, rng)
    nd = 5
    dF, dstate = rng.standard_normal((N, nd, *F.shape[1:])), 0.1 * rng.standard_normal((N, nd, state.shape[1]))
    dparams = params * rng.standard_normal((nd, len(params)))
    a, a_state, ok = directional_stresses(law, mode, F, state, params, 1.0, dF, dstate, dparams)
    b, b_state, ok_oracle = directional_stresses(oracle, mode, F, state, params, 1.0, dF, dstate, dparams)
    assert ok and ok_oracle
    # the same formula in exact arithmetic; in plane stress both stop at their own F33, F33_TOLERANCE apart at most,
    # times the curvature 1e3
    tolerance = 1e-8 if mode == 2 else 1e-12
    assert np.abs(a - b).max() <= tolerance * np.abs(b).max()
    if a_state.size:
        assert np.abs(a_state - b_state).max() <= tolerance * max(1.0, np.abs(b_state).max())


def test_sensitivities_carry_the_history_exactly(law, mode, params, rng):
    """Direct differentiation over several steps against central differences of the whole history."""
    d = 3 if mode == 0 else 2
    path, dpath = random_path(rng, N, d), random_path(rng, N, d) - np.eye(d)
    n_params = len(params)
    nd = n_params + 1  # one direction moves the whole path, the others one parameter each
    dparams = np.zeros((nd, n_params))
    dparams[1:] = np.diag(np.where(params == 0.0, 1.0, params))
    state = np.tile(law.initial_state(mode), (N, 1))
    dstate = np.zeros((N, nd, state.shape[1]))
    for F, dF_path in zip(path, dpath, strict=True):
        dF = np.zeros((N, nd, d, d))
        dF[:, 0] = dF_path
        dP, dstate_new, ok = directional_stresses(law, mode, F, state, params, 1.0, dF, dstate, dparams)
        _, state, ok_stress = point_stresses(law, mode, F, state, params, 1.0)
        assert ok and ok_stress
        dstate = dstate_new
    h = 1e-6
    for k in range(nd):
        ends = [follow(law, mode, path + s * h * dpath * (k == 0), params + s * h * dparams[k]) for s in (1, -1)]
        stress_quotient = (ends[0][0][-1] - ends[1][0][-1]) / (2 * h)
        state_quotient = (ends[0][1] - ends[1][1]) / (2 * h)
        # rounding of the stress over h: 1e-16 * stiffness / 1e-6 = 1e-10 of the stiffness, which is up to 1e3 times
        # a plastic law's sensitivity (stress = 1e-3 stiffness); truncation as in the tangent, smaller
        floor = 1e-9 * stiffness_scale(law, mode, params)
        np.testing.assert_allclose(dP[:, k], stress_quotient, atol=floor + 1e-6 * np.abs(stress_quotient).max())
        np.testing.assert_allclose(dstate[:, k], state_quotient, atol=1e-8)


def test_rotating_the_body_only_rotates_the_stress(law, params, rng):
    if law.small:
        pytest.skip("small-strain laws are not objective, by definition")
    path, Q = random_path(rng, N, 3), rotations(rng, N)
    P, state = follow(law, 0, path, params)
    P_turned, state_turned = follow(law, 0, Q @ path, params)
    scale = stiffness_scale(law, 0, params)
    np.testing.assert_allclose(P_turned[-1], Q @ P[-1], atol=1e-12 * scale)  # rounding times the stiffness
    np.testing.assert_allclose(state_turned, state, atol=1e-11)  # internal variables live in the reference


def test_moment_of_momentum_is_balanced(law, params, rng):
    F, state = loaded(law, 0, params, rng)
    P, _, _ = point_stresses(law, 0, F, state, params, 1.0)
    kirchhoff = P if law.small else P @ F.transpose(0, 2, 1)
    np.testing.assert_allclose(kirchhoff, kirchhoff.transpose(0, 2, 1), atol=1e-12 * stiffness_scale(law, 0, params))


def test_an_isotropic_law_has_no_preferred_direction(law, params, rng):
    path, Q = random_path(rng, N, 3), rotations(rng, N)
    P, _ = follow(law, 0, path, params)
    Qt = Q.transpose(0, 2, 1)
    P_turned, _ = follow(law, 0, Q @ path @ Qt, params)
    same = np.abs(P_turned[-1] - Q @ P[-1] @ Qt).max() <= 1e-12 * stiffness_scale(law, 0, params)
    assert same == law.spec.isotropic


def test_a_closed_cycle_from_rest_gives_no_work(law, mode, params, rng):
    """Second law for a cycle: what is put in is stored or dissipated, never gained."""
    d = 3 if mode == 0 else 2
    steps = 200
    out = random_path(rng, N, d, 2, SIZE)
    corners = np.array([np.tile(np.eye(d), (N, 1, 1)), out[0], out[1], np.tile(np.eye(d), (N, 1, 1))])
    path = np.concatenate([a + (b - a) * np.linspace(0, 1, steps + 1)[1:, None, None, None]
                           for a, b in zip(corners[:-1], corners[1:], strict=True)])
    P, _ = follow(law, mode, path, params)
    F = np.concatenate([corners[:1], path])
    P = np.concatenate([np.zeros((1, N, d, d)), P])
    work = np.einsum("snij,snij->n", 0.5 * (P[1:] + P[:-1]), np.diff(F, axis=0))
    # trapezoidal rule: a relative error of about 1 / steps^2 of the energy scale, stiffness * SIZE^2
    tolerance = stiffness_scale(law, mode, params) * SIZE**2 / steps**2
    if law.spec.name.startswith("egp"):  # sigma = G dev(Be), not tau, in its source: energy only up to third order
        tolerance += params[law.spec.parameter_names.index("G1")] * SIZE**3
    assert work.min() >= -tolerance


def test_plane_stress_has_no_stress_out_of_plane(law, params, rng):
    F, state = loaded(law, 2, params, rng)
    P, state_new, P33, ok = point_stresses(law, 2, F, state, params, 1.0, full=True)
    scale = stiffness_scale(law, 0, params)
    assert ok
    assert np.abs(P33).max() <= 1e-13 * scale  # second order in the last correction: below rounding
    full = np.tile(np.eye(3), (N, 1, 1))
    full[:, :2, :2] = F
    full[:, 2, 2] = state_new[:, -1]
    solid, _, _ = point_stresses(law, 0, full, state[:, :-1], params, 1.0)
    np.testing.assert_allclose(solid[:, :2, :2], P, atol=1e-12 * scale)
    assert np.abs(solid[:, 2, 2]).max() <= 1e-12 * scale  # F33 is stored rounded


def test_plane_strain_is_the_solid_with_no_strain_across(law, params, rng):
    F, state = loaded(law, 1, params, rng)
    full = np.tile(np.eye(3), (N, 1, 1))
    full[:, :2, :2] = F
    P, _, P33, _ = point_stresses(law, 1, F, state, params, 1.0, full=True)
    solid, _, _ = point_stresses(law, 0, full, state, params, 1.0)
    np.testing.assert_array_equal(solid[:, :2, :2], P)
    np.testing.assert_array_equal(solid[:, 2, 2], P33)


def test_the_search_for_F33_does_not_depend_on_its_start(law, params, rng):
    F, state = loaded(law, 2, params, rng)
    reference, _, _ = point_stresses(law, 2, F, state, params, 1.0)
    for start in (0.7, 0.9, 1.2, 1.5):
        P, _, ok = point_stresses(law, 2, F, state, params, 1.0, guess=np.full(N, start))
        assert ok
        # both end within F33_TOLERANCE, the rest is second order
        np.testing.assert_allclose(P, reference, atol=1e-12 * stiffness_scale(law, 2, params))


def test_a_hopeless_deformation_is_reported_and_never_nan(law, mode, params):
    F, state = at_rest(law, mode, 3)
    F[1] *= -1.0 if mode == 0 else np.array([[1.0, 1.0], [-1.0, -1.0]])  # det F = -1: no body does that
    if law.small:
        pytest.skip("the small strain of every F has a stress")
    P, state_new, A, ok = point_tangents(law, mode, F, state, params, 1.0)
    assert not ok
    plain, state_plain, found = point_stresses(law, mode, F, state, params, 1.0)
    assert not found
    dF = np.zeros((3, 1, *F.shape[1:]))
    dF[:, 0, 0, 0] = 1.0
    changes = directional_stresses(law, mode, F, state, params, 1.0, dF)
    assert not changes[2]
    for x in (P, state_new, A, plain, state_plain, *changes[:2]):
        assert np.isfinite(x).all()
    assert np.abs(A[[0, 2]]).max() > 0.0  # its neighbours are served


def test_outputs_go_into_the_arrays_that_are_given(law, mode, params, rng):
    F, state = loaded(law, mode, params, rng)
    d = F.shape[1]
    out = (np.empty_like(F), np.empty_like(state), np.empty((N, d * d, d * d)))
    P, state_new, A, _ = point_tangents(law, mode, F, state, params, 1.0, out=out)
    assert P is out[0] and state_new is out[1] and A is out[2]
    expected = point_tangents(law, mode, F, state, np.tile(params, (N, 1)), 1.0)  # parameters per point
    for x, y in zip(out, expected[:3], strict=True):
        np.testing.assert_array_equal(x, y)
