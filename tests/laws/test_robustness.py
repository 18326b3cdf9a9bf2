"""Large increments, yield onset, extreme parameters: an answer or a status, never NaN, never a wrong root."""

import pickle

import numpy as np
import pytest
from law_paths import follow, random_path

from idic.errors import InputError
from idic.laws import compile, directional_stresses, get_law, point_stresses, point_tangents


def sheet(stretches_1, stretches_2):
    F = np.zeros((len(stretches_1), 2, 2))
    F[:, 0, 0], F[:, 1, 1] = stretches_1, stretches_2
    return F


@pytest.mark.parametrize("name", ["j2_linear", "j2_voce", "j2_power", "j2_power_reference", "j2_swift", "j2_kinematic",
                                  "j2_hill", "viscoplastic"])
def test_J2_plane_stress_takes_huge_increments_in_one_step(name):
    law = compile(name)
    grid = np.linspace(0.5, 2.0, 7)
    F = sheet(*(x.ravel() for x in np.meshgrid(grid, grid)))
    F[:, 0, 1] = 0.3
    state = np.tile(law.initial_state(2), (len(F), 1))
    P, state_new, P33, ok = point_stresses(law, 2, F, state, law.spec.defaults(), 1.0, full=True)
    assert ok
    assert np.isfinite(P).all()
    assert np.abs(P33).max() < 1e-8
    assert (state_new[:, -1] > 0.1).all() and (state_new[:, -1] < 5.0).all()
    # plastic flow is isochoric up to the elastic strain: area stretch times thickness stretch is nearly 1
    np.testing.assert_allclose(np.linalg.det(F) * state_new[:, -1], 1.0, atol=0.02)


@pytest.mark.parametrize("kappa", [1.0, 660.0, 1e6])
def test_neo_Hookean_plane_stress_takes_large_stretches_in_one_step(kappa):
    law = compile("neo_hookean")
    grid = np.geomspace(0.2, 5.0, 9)
    F = sheet(*(x.ravel() for x in np.meshgrid(grid, grid)))
    state = np.tile(law.initial_state(2), (len(F), 1))
    P, state_new, P33, ok = point_stresses(law, 2, F, state, np.array([3.3, kappa]), 1.0, full=True)
    assert ok
    assert np.abs(P33).max() <= 1e-12 * kappa * 25  # rounding of kappa times the largest area stretch
    assert (state_new[:, -1] > 0).all()


def test_a_start_far_away_finds_the_same_root():
    law = compile("neo_hookean")
    F, state = sheet([1.5], [0.8]), law.initial_state(2)[None]
    params = law.spec.defaults()
    reference = point_stresses(law, 2, F, state, params, 1.0)[1][0, -1]
    for start in (1e-3, 0.1, 10.0, 1e3):
        found = point_stresses(law, 2, F, state, params, 1.0, guess=np.array([start]))[1][0, -1]
        np.testing.assert_allclose(found, reference, rtol=1e-12)  # one root: P33 grows with F33


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_power_law_onset_is_smooth_in_stress_and_tangent(mode):
    """n < 1 starts with an infinite slope, so the tangent just beyond yield is still the elastic one."""
    law = compile("j2_power")
    params = np.array([70e3, 0.3, 200.0, 300.0, 0.2])
    d = 3 if mode == 0 else 2
    direction = np.zeros((d, d))
    direction[0, 1] = 1.0
    onset = 200.0 / np.sqrt(3) / (70e3 / 2.6)
    strains = onset * (1 + np.array([-1e-3, -1e-9, 1e-9, 1e-6, 1e-4, 0.5]))
    F = np.eye(d) + strains[:, None, None] * direction
    state = np.tile(law.initial_state(mode), (len(F), 1))
    P, state_new, A, ok = point_tangents(law, mode, F, state, params, 1.0)
    dP, dstate, ok_d = directional_stresses(law, mode, F, state, params, 1.0,
                                          np.zeros((len(F), 5, d, d)), None, np.eye(5))
    assert ok and ok_d
    for x in (P, state_new, A, dP, dstate):
        assert np.isfinite(x).all()
    shear = A[:, 1, 1]
    np.testing.assert_allclose(shear[:5], shear[0], rtol=1e-2)
    assert shear[-1] < 0.5 * shear[0]


@pytest.mark.parametrize(("extra", "expected"), [
    ({"yield_stress": np.inf}, "elastic"), ({"Q": 0.0}, "linear"), ({"b": 0.0}, "linear")])
def test_at_its_null_value_a_parameter_has_no_effect(extra, expected, rng):
    law, linear = compile("j2_voce"), compile("j2_linear")
    names = law.spec.parameter_names
    params = np.array([extra.get(p, v) for p, v in zip(names, law.spec.defaults(), strict=True)])
    path = random_path(rng, 5, 2)
    P, state = follow(law, 2, path, params)
    if expected == "elastic":
        assert (state[:, :7] == 0).all()
    else:
        P_linear, _ = follow(linear, 2, path, params[[0, 1, 2, 5]])
        np.testing.assert_allclose(P, P_linear, atol=1e-9)


# the complex step takes the same stress and is compiled anew
@pytest.mark.parametrize("derivative", ["auto", pytest.param("complex_step", marks=pytest.mark.slow)])
@pytest.mark.parametrize(("law", "params", "simpler", "same"), [
    ("j2_swift", [70e3, 0.3, 200.0, 0.01, 0.0], "j2_linear", [70e3, 0.3, 200.0, 0.0]),
    ("j2_swift", [70e3, 0.3, np.inf, 0.01, 0.2], "j2_linear", [70e3, 0.3, np.inf, 0.0]),
    ("j2_swift", [70e3, 0.3, 300.0, 0.0, 0.3], "j2_power", [70e3, 0.3, 0.0, 300.0, 0.3]),
    ("j2_power_reference", [70e3, 0.3, 200.0, 50.0, 0.3, 2e-3],
     "j2_power", [70e3, 0.3, 200.0, 50.0 * 2e-3**-0.3, 0.3]),
    ("j2_power_reference", [70e3, 0.3, np.inf, 50.0, 0.3, 2e-3], "j2_linear", [70e3, 0.3, np.inf, 0.0]),
    ("mooney_rivlin", [3.0, 0.0, 660.0], "neo_hookean", [3.0, 660.0])])
def test_at_null_values_a_law_is_its_simpler_one(law, params, simpler, same, derivative, rng):
    path = random_path(rng, 5, 2)
    P, state = follow(compile(law, derivative=derivative), 2, path, np.array(params))
    expected, expected_state = follow(compile(simpler), 2, path, np.array(same))
    np.testing.assert_allclose(P, expected, atol=1e-9)
    np.testing.assert_allclose(state, expected_state, atol=1e-12)


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_softening_is_solved_until_nothing_is_left_to_carry(mode):
    law = compile("j2_linear")
    d = 3 if mode == 0 else 2
    F = np.eye(d) + np.linspace(0, 0.3, 7)[:, None, None] * np.diag([1.0, -1.0, 0.0][:d])
    state = np.tile(law.initial_state(mode), (7, 1))
    P, state_new, ok = point_stresses(law, mode, F, state, np.array([70e3, 0.3, 200.0, -1000.0]), 1.0)
    gone = state_new[:, 6] == 0
    assert np.isfinite(P).all()
    assert not ok  # beyond p = 0.2 the flow stress would be negative: reported
    assert not gone[1:4].any()


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_read_only_and_strided_inputs_are_taken(mode):
    law = compile("elastic")
    d = 3 if mode == 0 else 2
    F = np.broadcast_to(1.01 * np.eye(d), (4, d, d))
    state = np.broadcast_to(law.initial_state(mode), (4, law.n_state(mode)))
    P, _, ok = point_stresses(law, mode, F, state, law.spec.defaults(), 1.0)
    assert ok and np.ptp(P, axis=0).max() == 0.0


def test_errors_about_wrong_shapes_name_the_expected_shape():
    law = compile("elastic")
    with pytest.raises(ValueError, match=r"expected F of shape \(3, 2, 2\), got \(3, 3, 3\)"):
        point_stresses(law, 2, np.zeros((3, 3, 3)), np.zeros((3, 1)), law.spec.defaults(), 1.0)


def test_an_unknown_law_lists_near_matches_and_unknown_kinematics_the_ones_on_offer():
    with pytest.raises(InputError, match="j2_linear"):
        compile("j2_liner")
    with pytest.raises(InputError, match="finite"):
        compile("j2_linear", "small")


@pytest.mark.parametrize(("author", "law"), [
    ("Ludwik", "j2_power"), ("prager", "j2_kinematic"), ("Armstrong", "j2_kinematic"), ("perzyna", "viscoplastic"),
    ("norton", "creep"), ("Swift", "j2_swift"), ("hill", "j2_hill"), ("mooney", "mooney_rivlin"), ("hooke", "elastic")])
def test_a_law_asked_for_by_the_name_of_its_author_is_pointed_at(author, law):
    with pytest.raises(InputError) as refused:
        get_law(author)
    assert law in refused.value.remedy


def test_a_compiled_law_crosses_process_boundaries_by_name():
    law = compile("j2_linear")
    assert pickle.loads(pickle.dumps(law)) is law
