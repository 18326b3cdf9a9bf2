"""Viscoplasticity and viscoelasticity against closed solutions in time, and at their null values."""

import numpy as np
import pulls
import pytest
from law_paths import follow, random_path

from idic.errors import InputError
from idic.laws import compile, directional_stresses, get_law, point_stresses, point_tangents
from idic.laws import point

VISCOPLASTIC = np.array([70e3, 0.3, 200.0, 1000.0, 50.0, 4.0])  # E, nu, yield_stress, hardening_modulus, eta, m
MAXWELL = get_law("maxwell").defaults()
G0 = MAXWELL[0] / 2 / (1 + MAXWELL[1])
SHARES, TIMES = MAXWELL[2::2], MAXWELL[3::2]


@pytest.mark.parametrize("rate", [1e-4, 1e-2, 1.0])
def test_viscoplastic_tension_lies_above_the_flow_stress_by_eta_times_the_rate_to_1_over_m(rate):
    strain = np.linspace(0, 0.1, 101)
    curve = point.uniaxial(compile("viscoplastic"), VISCOPLASTIC, strain, times=strain / rate)
    stress, p = curve.P[:, 0, 0] * curve.F[:, 0, 0], curve.state[:, 6]
    speed = np.diff(p, prepend=0) / (0.001 / rate)
    flowing = speed > 0
    assert flowing.sum() > 90
    expected = 200.0 + 1000.0 * p + 50.0 * speed**0.25
    np.testing.assert_allclose(stress[flowing], expected[flowing], rtol=1e-8)
    np.testing.assert_allclose(speed[-1], rate / 1.1, rtol=0.03)  # nearly the rate of the logarithmic strain


def test_viscoplastic_stress_relaxes_to_the_flow_stress_as_the_exponential():
    """m = 1 at constant strain: the overstress f decays with the time eta / (3 G + H)."""
    params = np.array([70e3, 0.3, 200.0, 1000.0, 1e4, 1.0])
    law, stiffness = compile("viscoplastic"), 3 * 70e3 / 2.6 + 1000.0
    decay = 1e4 / stiffness
    F, state = np.eye(3)[None].copy(), law.initial_state(0)[None]
    F[0, 0, 1] = 0.01
    P, state, _ = point_stresses(law, 0, F, state, params, 0.0)
    excess = [np.sqrt(3) * P[0, 0, 1] - 200.0]
    assert excess[0] == pytest.approx(np.sqrt(3) * 70e3 / 2.6 * 0.01 - 200.0, rel=1e-3)  # no time, no flow
    for _ in range(200):
        P, state, _ = point_stresses(law, 0, F, state, params, decay / 100)
        kirchhoff = (P[0] @ F[0].T)[0, 1]
        excess.append(np.sqrt(3) * kirchhoff - 200.0 - 1000.0 * state[0, 6])
    expected = excess[0] * np.exp(-np.arange(201) / 100)
    np.testing.assert_allclose(excess, expected, atol=0.01 * excess[0])  # backward Euler, steps of decay / 100


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_without_viscosity_it_is_linear_hardening_whatever_the_time(mode, rng):
    path = random_path(rng, 5, 3 if mode == 0 else 2)
    params = np.array([70e3, 0.3, 200.0, 1000.0, 0.0, 3.0])
    linear, _ = follow(compile("j2_linear"), mode, path, params[:4])
    for dt in (0.0, 1e-3, 1e3):
        P, _ = follow(compile("viscoplastic"), mode, path, params, dt)
        np.testing.assert_allclose(P, linear, atol=1e-9)


@pytest.mark.parametrize("m", [0.2, 1.0, 20.0, 200.0])
@pytest.mark.parametrize("dt", [1e-12, 1e-3, 1.0, 1e9])
def test_viscoplastic_points_take_every_exponent_and_time(m, dt, rng):
    law = compile("viscoplastic")
    params = np.array([70e3, 0.3, 200.0, 0.0, 50.0, m])
    path = random_path(rng, 20, 2, size=0.3)
    state = np.tile(law.initial_state(2), (20, 1))
    for F in path:
        P, state_new, A, ok = point_tangents(law, 2, F, state, params, dt)
        dP, dstate, ok_d = directional_stresses(law, 2, F, state, params, dt, np.zeros((20, 6, 2, 2)), None, np.eye(6))
        assert ok and ok_d
        assert all(np.isfinite(x).all() for x in (P, A, dP, dstate))
        state = state_new


def shear_stress(rates, times, params=MAXWELL):
    """Small-strain shear stress of a piecewise constant shear rate, closed form  # (steps + 1,)"""
    shares, taus = params[2::2], params[3::2]
    overstress, strain, out = np.zeros(len(taus)), 0.0, [0.0]
    for rate, dt in zip(rates, np.diff(times), strict=True):
        decay = np.exp(-dt / taus)
        overstress = overstress * decay + shares * G0 * rate * taus * (1 - decay)
        strain += rate * dt
        out.append(G0 * (1 - shares.sum()) * strain + overstress.sum())
    return np.array(out)


def test_maxwell_shear_is_the_Prony_series_in_steps_of_any_length():
    times = np.array([0.0, 1e-6, 0.5, 0.6, 5.0, 40.0, 41.0, 1000.0])
    shear = 1e-5 * np.array([0.0, 1.0, 1.0, 2.0, 2.0, 1.0, 1.0, 1.0])
    curve = pulls.simple_shear(compile("maxwell"), MAXWELL, shear, times=times)
    expected = shear_stress(np.diff(shear) / np.diff(times), times)
    np.testing.assert_allclose(curve.P[:, 0, 1], expected, rtol=1e-8, atol=1e-10)  # strain^2 = 1e-10


def test_maxwell_relaxation_after_a_jump_is_the_modulus_over_time():
    law, times = compile("maxwell"), np.geomspace(0.01, 1000.0, 12)
    F, state = np.eye(3)[None].copy(), law.initial_state(0)[None]
    F[0, 0, 1] = 1e-4
    P, state, _ = point_stresses(law, 0, F, state, MAXWELL, 0.0)
    np.testing.assert_allclose(P[0, 0, 1], 1e-4 * G0, rtol=1e-7)  # instantaneous
    for dt, t in zip(np.diff(times, prepend=0.0), times, strict=True):
        P, state, _ = point_stresses(law, 0, F, state, MAXWELL, dt)
        modulus = G0 * (1 - (SHARES * (1 - np.exp(-t / TIMES))).sum())
        np.testing.assert_allclose(P[0, 0, 1] / 1e-4, modulus, rtol=1e-6)  # strain^2 = 1e-8


@pytest.mark.parametrize("rate, own", [("perzyna", (5.0, 1.0)), ("johnson_cook", (1.0, 1e-4))])
def test_a_body_that_softens_within_a_step_still_meets_its_yield_condition(rate, own):
    """Flow stress 80 MPa that falls to 20, in one step of simple shear: it flows more than 80 MPa would let it."""
    E, nu, shear, dt = 1500.0, 0.3, 0.4, 0.1 if rate == "perzyna" else 1.0
    law, F = compile(f"elastoplastic(voce+{rate})"), np.eye(3)[None].copy()
    F[0, 0, 1] = shear
    params = np.array([E, nu, 80.0, -60.0, 30.0, *own])
    P, state, ok = point_stresses(law, 0, F, law.initial_state(0)[None], params, dt)
    tau, growth = P[0] @ F[0].T, state[0, 6]
    deviator = tau - np.trace(tau) / 3 * np.eye(3)
    speed = growth / dt
    factor = 1 + own[0] * speed if rate == "perzyna" else 1 + own[0] * np.log1p(speed / own[1])
    assert ok
    np.testing.assert_allclose(np.sqrt(1.5) * np.linalg.norm(deviator), (20 + 60 * np.exp(-30 * growth)) * factor,
                               rtol=1e-9)


def test_maxwell_at_large_strain_converges_with_its_steps_and_relaxes_to_the_long_term_body():
    law, ends = compile("maxwell"), []
    for steps in (10, 80, 160, 320):
        curve = pulls.simple_shear(law, MAXWELL, np.linspace(0, 1.0, steps + 1), times=np.linspace(0, 5.0, steps + 1))
        ends.append(curve.P[-1, 0, 1])
    changes = np.abs(np.diff(ends[1:]))
    assert changes[0] / changes[1] == pytest.approx(2.0, rel=0.1)  # first order in the end, ...
    np.testing.assert_allclose(ends[0], ends[-1], rtol=3e-4)  # ... but exact up to the square of the strain
    P, _, _ = point_stresses(law, 0, curve.F[-1:], curve.state[-1:], MAXWELL, 1e9)
    elastic = MAXWELL * np.array([1, 1, 0, 1, 0, 1, 0, 1])
    instant = pulls.simple_shear(law, elastic, [0.0, 1.0]).P[-1]
    # isochoric, so no pressure either way; what is left of the branches decays as tau / dt in the ramp's weights
    np.testing.assert_allclose(P[0], instant * (1 - SHARES.sum()), atol=1e-6 * G0)


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_maxwell_without_branches_is_the_elastic_body_of_the_plastic_laws(mode, rng):
    path = random_path(rng, 5, 3 if mode == 0 else 2, size=0.3)
    elastic, _ = follow(compile("j2_linear"), mode, path, np.array([*MAXWELL[:2], np.inf, 0.0]))
    for switch in ([1, 1, 0, 1, 0, 1, 0, 1], [1, 1, 1, 0, 1, 0, 1, 0]):  # g = 0, tau = 0
        P, _ = follow(compile("maxwell"), mode, path, MAXWELL * switch)
        np.testing.assert_allclose(P, elastic, rtol=1e-9, atol=1e-8)


def test_maxwell_takes_large_stretches_in_steps_of_any_length(rng):
    law = compile("maxwell")
    F = np.zeros((49, 2, 2))
    F[:, 0, 0], F[:, 1, 1] = (x.ravel() for x in np.meshgrid(*[np.geomspace(0.3, 3.0, 7)] * 2))
    for dt in (0.0, 1e-6, 1.0, 1e9):
        state = np.tile(law.initial_state(2), (49, 1))
        for path in (F, F[::-1]):
            P, state, P33, ok = point_stresses(law, 2, path, state, MAXWELL, dt, full=True)
            assert ok
            assert np.abs(P33).max() < 1e-9 * MAXWELL[0]


def test_a_free_spectrum_on_the_times_of_maxwell_is_maxwell(rng):
    path, values = random_path(rng, 4, 3), np.array([*MAXWELL[:2], TIMES[0], TIMES[-1], *SHARES])
    np.testing.assert_allclose(TIMES, np.geomspace(TIMES[0], TIMES[-1], 3))
    found, expected = (follow(compile(law), 0, path, own)[0]
                       for law, own in (("free_relaxation", values), ("maxwell", MAXWELL)))
    np.testing.assert_allclose(found, expected, atol=1e-10 * np.abs(expected).max())


def test_a_free_spectrum_has_as_many_times_as_its_name_says_and_keeps_a_stiffness():
    law = compile("free_relaxation(5)")
    assert law.spec.parameter_names == ("E", "nu", "shortest", "longest", "g_1", "g_2", "g_3", "g_4", "g_5")
    assert law.n_state(0) == 36
    F = np.eye(3)[None] * 1.001
    for shares, fine in ((0.19, True), (0.21, False)):  # of five
        values = np.array([1000.0, 0.3, 0.1, 10.0, *[shares] * 5])
        assert point_stresses(law, 0, F, law.initial_state(0)[None], values, 1.0)[2] == fine
    for name in ("free_relaxation(2)", "free_relaxation(4+3)", "free_relaxation(x)", "free_relaxation(40)"):
        with pytest.raises(InputError, match="number of relaxation times"):
            get_law(name)


def test_the_card_of_a_spectrum_is_its_prony_series_and_calculix_has_none():
    from idic.laws import material_card

    names = get_law("free_relaxation").parameter_names
    values = dict(zip(names, [1000.0, 0.25, 1.0, 100.0, 0.3, 0.0, 0.1], strict=True))
    card = material_card("BAR", "free_relaxation", values, "abaqus")
    assert "MODULI=INSTANTANEOUS\n200, 0.003\n*VISCOELASTIC, TIME=PRONY\n0.3, 0, 1\n0.1, 0, 100\n" in card.text
    assert "no *VISCOELASTIC" in material_card("BAR", "free_relaxation", values, "calculix").missing[0]
    old = dict(zip(get_law("maxwell").parameter_names, MAXWELL, strict=True))
    rows = material_card("BAR", "maxwell", old, "abaqus").text.split("TIME=PRONY\n")[1].split()
    assert [float(x.strip(",")) for x in rows] == pytest.approx(
        [x for g, tau in zip(SHARES, TIMES, strict=True) for x in (g, 0.0, tau)])
