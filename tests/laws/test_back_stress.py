"""Kinematic hardening against its textbook curves, and at its null values."""

import numpy as np
import pulls
import pytest
from law_paths import follow, random_path

from idic.laws import compile
from idic.laws import point

LAW = "j2_kinematic"
PRAGER = np.array([70e3, 0.3, 200.0, 300.0, 2000.0, 0.0])  # E, nu, yield_stress, hardening_modulus, C, gamma
FREDERICK = np.array([70e3, 0.3, 200.0, 0.0, 10e3, 100.0])


def tension(params, strain):
    """Kirchhoff stress along the tension and equivalent plastic strain."""
    curve = point.uniaxial(compile(LAW), params, strain)
    return curve.P[:, 0, 0] * curve.F[:, 0, 0], curve.state[:, 6]


def test_Prager_tension_adds_both_moduli():
    stress, p = tension(PRAGER, np.linspace(0, 0.3, 61))
    # exact but for the elastic strain in the direction of flow
    np.testing.assert_allclose(stress[p > 0], 200.0 + 2300.0 * p[p > 0], rtol=1e-8)


def test_Armstrong_Frederick_tension_approaches_its_exponential_as_steps_shrink():
    errors = []
    for steps in (200, 400, 800):
        stress, p = tension(FREDERICK, np.linspace(0, 0.05, steps + 1))
        errors.append(np.abs(stress - 200.0 - 100.0 * (1 - np.exp(-100.0 * p)))[p > 0].max())
    assert errors[-1] < 0.3  # MPa, of 300
    np.testing.assert_allclose(np.array(errors[:-1]) / errors[1:], 2.0, rtol=0.1)  # backward Euler


def test_after_tension_compression_yields_earlier_by_the_back_stress():
    turn = np.linspace(0, 0.05, 51)
    stress, p = tension(PRAGER, np.concatenate([turn, 0.05 - np.linspace(0, 0.02, 401)[1:]]))
    yields = np.flatnonzero(p > p[50])[0]
    expected = stress[50] - 2 * (200.0 + 300.0 * p[50])  # the elastic range is twice the isotropic part
    # yield is crossed within one step of strain 5e-5, 3.5 MPa elastic
    np.testing.assert_allclose(stress[yields], expected, atol=4.0)
    assert stress[yields] > -200.0


def test_stable_cycles_have_the_amplitude_of_Armstrong_and_Frederick():
    corners = [0.0, *(0.01 * (-1) ** k for k in range(8))]
    strain = np.concatenate([[0.0], *(np.linspace(a, b, 401)[1:] for a, b in zip(corners[:-1], corners[1:],
                                                                                 strict=True))])
    stress, p = tension(FREDERICK, strain)
    turns = stress[400::400]
    plastic_range = p[-1] - p[-401]
    expected = 200.0 + 100.0 * np.tanh(50.0 * plastic_range)  # Lemaitre & Chaboche (1990), section 5.4
    np.testing.assert_allclose(np.abs(turns[-2:]), expected, rtol=1e-2)  # finite strain 1 % and steps of 5e-5


@pytest.mark.parametrize("Q", [-60.0, 60.0], ids=["softening", "hardening"])
def test_under_cycles_the_elastic_range_goes_to_its_last_size(Q):
    """Half of it, between a turn and the first yield on the way back, is 200 + Q (1 - exp(-b p)); Chaboche (1986)."""
    corners = [0.0, *(0.01 * (-1) ** k for k in range(7))]
    strain = np.concatenate([[0.0], *(np.linspace(a, b, 201)[1:] for a, b in zip(corners[:-1], corners[1:],
                                                                                 strict=True))])
    curve = point.uniaxial(compile("j2_chaboche"), [70e3, 0.3, 200.0, Q, 30.0, 0.0, 10e3, 100.0], strain)
    stress, p = curve.P[:, 0, 0] * curve.F[:, 0, 0], curve.state[:, 6]
    for turn in range(200, 1400, 200):
        yields = turn + int(np.argmax(p[turn:] > p[turn]))
        size = 0.5 * abs(stress[turn] - stress[yields])
        np.testing.assert_allclose(size, 200.0 + Q * (1.0 - np.exp(-30.0 * p[turn])), atol=3.6)  # a step: 7 MPa elastic
    assert abs(1.0 - np.exp(-30.0 * p[-1])) > 0.85


@pytest.mark.parametrize("params", [PRAGER, FREDERICK], ids=["Prager", "Armstrong-Frederick"])
def test_the_stress_does_not_oscillate_in_large_simple_shear(params):
    """The Jaumann rate would: its shear stress turns at a shear of pi / 2 (Nagtegaal & de Jong 1982)."""
    curve = pulls.simple_shear(compile(LAW), params, np.linspace(0, 6.0, 301))
    shear = (curve.P @ curve.F.transpose(0, 2, 1))[:, 0, 1]
    assert (np.diff(shear) > -1e-9 * shear.max()).all()


@pytest.mark.parametrize("mode", [0, 2])
def test_without_kinematic_modulus_it_is_linear_isotropic_hardening(mode, rng):
    path = random_path(rng, 5, 3 if mode == 0 else 2)
    params = np.array([70e3, 0.3, 200.0, 1000.0, 0.0, 50.0])
    P, state = follow(compile(LAW), mode, path, params)
    P_linear, state_linear = follow(compile("j2_linear"), mode, path, params[:4])
    np.testing.assert_allclose(P, P_linear, atol=1e-9)
    np.testing.assert_allclose(state[:, :7], state_linear[:, :7], atol=1e-13)


def test_with_infinite_yield_stress_it_is_elastic(rng):
    path = random_path(rng, 5, 2)
    _, state = follow(compile(LAW), 2, path, np.array([70e3, 0.3, np.inf, 0.0, 5000.0, 50.0]))
    assert (state[:, :13] == 0).all()


def test_huge_increments_and_strong_recovery_are_solved(rng):
    law = compile(LAW)
    for gamma in (0.0, 1.0, 1e4):
        for size in (0.3, 0.6):  # det F down to 0.2
            P, state = follow(law, 2, random_path(rng, 50, 2, size=size), np.array([70e3, 0.3, 20.0, 0.0, 5e4, gamma]))
            assert np.isfinite(P).all()
            if gamma:  # the back stress 2/3 C a never passes its saturation sqrt(2/3) C / gamma
                a = state[:, 7:13]
                norm = np.sqrt((a[:, :3] ** 2).sum(1) + 2 * (a[:, 3:] ** 2).sum(1))
                assert norm.max() <= np.sqrt(1.5) / gamma * (1 + 1e-9)
