"""Damage, creep and pressure-dependent yield against closed solutions, and at their null values."""

import numpy as np
import pulls
import pytest
from law_paths import follow, random_path

from idic.laws import compile, directional_stresses, point_stresses, point_tangents
from idic.laws import point

DAMAGE = np.array([70e3, 0.3, 0.004, 30.0, 1.0, 0.0])  # E, nu, threshold, softening, compression, length
CREEP = np.array([70e3, 0.3, 1e-3, 4.0, 200.0])  # E, nu, rate, n, stress
PRESSURE = np.array([70e3, 0.3, 200.0, 1000.0, 0.4])  # E, nu, yield_stress, hardening_modulus, friction


# damage
def test_damaged_tension_is_Hooke_times_the_exponential_and_unloads_to_the_origin():
    out, back = np.linspace(0, 0.02, 21), np.linspace(0.019, 0.0, 20)
    curve = point.uniaxial(compile("elastic_damage", "small"), DAMAGE, np.concatenate([out, back]))
    largest = np.maximum.accumulate(np.concatenate([out, back]))
    keep = np.exp(-30.0 * np.maximum(largest - 0.004, 0.0))
    expected = keep * 70e3 * np.concatenate([out, back])
    np.testing.assert_allclose(curve.P[:, 0, 0], expected, rtol=1e-8, atol=1e-7)  # the driver's tolerance
    np.testing.assert_allclose(curve.state[:, 0], largest, atol=1e-10)
    # the peak of E e exp(-s (e - t)) is at e = 1 / s, beyond the end of this path: it still rises
    assert (np.diff(curve.P[:21, 0, 0]) > 0).all()


def test_damaged_tension_at_finite_strain_is_linear_in_Green_strain_times_the_exponential():
    strain = np.linspace(0, 0.05, 26)
    curve = point.uniaxial(compile("elastic_damage", "finite"), DAMAGE, strain)
    green = strain + 0.5 * strain**2
    expected = (1 + strain) * 70e3 * green * np.exp(-30.0 * np.maximum(green - 0.004, 0.0))
    np.testing.assert_allclose(curve.P[:, 0, 0], expected, rtol=1e-8, atol=1e-7)


# reversible nonlinear elasticity
@pytest.mark.parametrize("n", [25.0, -15.0], ids=["softens", "stiffens"])
def test_nonlinear_elastic_tension_is_Hooke_times_the_exponential_and_unloads_on_its_own_path(n):
    out = np.linspace(0, 0.02, 21)
    curve = point.uniaxial(compile("nonlinear_elastic", "small"), np.array([70e3, 0.3, n]),
                           np.concatenate([out, out[-2::-1]]))
    np.testing.assert_allclose(curve.P[:21, 0, 0], 70e3 * out * np.exp(-n * out), rtol=1e-8, atol=1e-7)
    np.testing.assert_allclose(curve.P[21:, 0, 0], curve.P[19::-1, 0, 0], rtol=1e-8, atol=1e-7)


def test_no_work_is_lost_or_won_around_a_closed_path_of_nonlinear_elasticity(rng):
    """Three directions of strain, there and back by other ways: the work of a loop is zero for a potential alone."""
    law, steps = compile("nonlinear_elastic", "small"), 1000
    corners = [np.zeros((3, 3))]
    for _ in range(3):
        direction = rng.standard_normal((3, 3))
        corners.append(0.01 * (direction + direction.T))
    corners.append(corners[0])
    strains = np.concatenate([np.linspace(a, b, steps, endpoint=False)
                              for a, b in zip(corners, corners[1:], strict=False)]
                             + [corners[-1][None]])
    P = follow(law, 0, (np.eye(3) + strains)[:, None], np.array([70e3, 0.3, 25.0]))[0][:, 0]
    work = 0.5 * np.einsum("tij,tij->t", P[1:] + P[:-1], np.diff(strains, axis=0))
    assert abs(work.sum()) < 1e-6 * np.abs(work).sum()


def test_dissipation_of_damage_equals_its_conjugate_energy(rng):
    """Work put in = stored + dissipated, the latter from the integral of (e : C : e / 2) dd."""
    law, steps = compile("elastic_damage", "small"), 2000
    direction = rng.standard_normal((3, 3))
    direction = 0.02 * (direction + direction.T) / np.linalg.norm(direction + direction.T)
    F = np.eye(3) + np.linspace(0, 1, steps + 1)[1:, None, None] * direction
    P, _ = follow(law, 0, F[:, None], DAMAGE)
    P = np.concatenate([np.zeros((1, 1, 3, 3)), P])[:, 0]
    work = np.sum(0.5 * (P[1:] + P[:-1]) * np.diff(np.concatenate([np.eye(3)[None], F]), axis=0))
    elastic, _ = follow(compile("elastic", "small"), 0, F[-1:, None], DAMAGE[:2])
    whole = 0.5 * np.sum(elastic[0, 0] * direction)
    largest = np.sqrt(2 * whole / 70e3) * np.linspace(0, 1, steps + 1)
    d = 1 - np.exp(-30.0 * np.maximum(largest - 0.004, 0.0))
    energy = 0.5 * 70e3 * largest**2
    dissipated = np.sum(0.5 * (energy[1:] + energy[:-1]) * np.diff(d))
    assert dissipated > 0
    np.testing.assert_allclose(work, (1 - d[-1]) * whole + dissipated, rtol=1e-4)  # trapezoidal rule, kink at yield


# creep
def mises_in_shear(law, params, gamma, times):
    """Mises stress of a shear strain held constant at these times (the first at once)."""
    F, state = np.eye(3)[None].copy(), law.initial_state(0)[None]
    F[0, 0, 1] = gamma
    found = []
    for dt in np.diff(times, prepend=times[0]):
        P, state, ok = point_stresses(law, 0, F, state, params, float(dt))
        assert ok
        kirchhoff = P[0] @ F[0].T
        deviator = kirchhoff - np.trace(kirchhoff) / 3 * np.eye(3)
        found.append(np.sqrt(1.5 * (deviator**2).sum()))
    return np.array(found)


@pytest.mark.parametrize("n", [1.0, 4.0])
def test_a_held_strain_relaxes_by_Nortons_law(n):
    """dq/dt = -3 G rate (q / stress)^n at constant strain: exponential for n = 1, a power of the time beyond."""
    params = CREEP * [1, 1, 1, 0, 1] + [0, 0, 0, n, 0]
    law, slope = compile("creep"), 3 * 70e3 / 2.6 * 1e-3
    q0 = mises_in_shear(law, params, 0.004, np.zeros(1))[0]
    times = np.linspace(0, 2 * q0 / slope, 4001)
    q = mises_in_shear(law, params, 0.004, times)
    if n == 1.0:
        expected = q0 * np.exp(-slope / 200.0 * times)
    else:
        expected = (q0 ** (1 - n) + (n - 1) * slope / 200.0**n * times) ** (1 / (1 - n))
    assert expected[-1] < 0.9 * q0
    np.testing.assert_allclose(q, expected, atol=2e-3 * q0)  # backward Euler, 4000 steps


def test_slow_tension_flows_at_the_rate_of_the_power_law():
    """Far beyond the elastic strain the stress is the one whose creep rate is the rate of stretching."""
    speed = 1e-3
    strain = np.linspace(0, 0.1, 201)
    curve = point.uniaxial(compile("creep"), CREEP, strain, times=strain / speed)
    stress = curve.P[-1, 0, 0] * curve.F[-1, 0, 0]
    # rate of the logarithmic strain speed / 1.1, less the elastic rate (the stress falls by a quarter of 10 % of 0.3 %)
    np.testing.assert_allclose(stress, 200.0 * (1 / 1.1) ** 0.25, rtol=2e-3)


@pytest.mark.parametrize("n", [1.0, 4.0, 50.0])
@pytest.mark.parametrize("rate", [1e-12, 1.0, 1e30])
def test_creep_points_take_every_exponent_and_rate(n, rate, rng):
    law, params = compile("creep"), np.array([70e3, 0.3, rate, n, 200.0])
    path = random_path(rng, 20, 2, size=0.3)
    state = np.tile(law.initial_state(2), (20, 1))
    for F in path:
        P, state_new, A, ok = point_tangents(law, 2, F, state, params, 1.0)
        dP, dstate, ok_d = directional_stresses(law, 2, F, state, params, 1.0, np.zeros((20, 5, 2, 2)), None, np.eye(5))
        assert ok and ok_d
        assert all(np.isfinite(x).all() for x in (P, A, dP, dstate))
        state = state_new


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_at_a_creep_rate_of_zero_the_body_is_elastic_and_the_derivative_is_not_zero(mode, rng):
    path = random_path(rng, 5, 3 if mode == 0 else 2, size=0.004)
    law, still = compile("creep"), CREEP * [1, 1, 0, 1, 1]
    elastic, _ = follow(compile("j2_linear"), mode, path, np.array([70e3, 0.3, np.inf, 0.0]))
    P, state = follow(law, mode, path, still)
    np.testing.assert_allclose(P, elastic, atol=1e-9)
    d = path.shape[-1]
    dparams = np.array([[0.0, 0.0, 1.0, 0.0, 0.0]])
    h = 1e-10  # a millionth of the rate that would matter: the quotient from one side is good to 1e-4
    for derivative in ("auto", "complex_step"):
        used = compile("creep", derivative=derivative)
        dP, _, ok = directional_stresses(used, mode, path[-1], state, still, 1.0, np.zeros((5, 1, d, d)), None, dparams)
        ahead = point_stresses(law, mode, path[-1], state, still + h * dparams[0], 1.0)[0]
        now = point_stresses(law, mode, path[-1], state, still, 1.0)[0]
        assert ok
        np.testing.assert_allclose(dP[:, 0], (ahead - now) / h, rtol=1e-2, atol=1e-3 * np.abs(dP).max())
        assert np.abs(dP).max() > 1.0


# pressure-dependent yield
@pytest.mark.parametrize(("sign", "yields"), [(1.0, 200.0 / (1 + 0.4 / 3)), (-1.0, -200.0 / (1 - 0.4 / 3))])
def test_tension_and_compression_yield_at_different_stresses(sign, yields):
    params = PRESSURE * [1, 1, 1, 0, 1]
    curve = point.uniaxial(compile("j2_pressure"), params, sign * np.linspace(0, 0.02, 41))
    kirchhoff, p = curve.P[:, 0, 0] * curve.F[:, 0, 0], curve.state[:, 6]
    assert (p > 0).sum() > 20
    np.testing.assert_allclose(kirchhoff[p > 0], yields, rtol=1e-8)  # the yield condition holds exactly


def test_pure_shear_does_not_feel_the_friction():
    curve = pulls.simple_shear(compile("j2_pressure"), PRESSURE, np.linspace(0, 0.05, 26))
    plain = pulls.simple_shear(compile("j2_linear"), PRESSURE[:4], np.linspace(0, 0.05, 26))
    np.testing.assert_allclose(curve.P[:, 0, 1], plain.P[:, 0, 1], rtol=1e-9, atol=1e-9)  # isochoric: no pressure


def test_plastic_flow_in_tension_changes_no_volume():
    curve = point.uniaxial(compile("j2_pressure"), PRESSURE, np.linspace(0, 0.05, 26))
    J, kirchhoff = np.linalg.det(curve.F), curve.P[:, 0, 0] * curve.F[:, 0, 0]
    kappa = 70e3 / 3 / 0.4
    np.testing.assert_allclose(kappa * (J - 1) * J, kirchhoff / 3, rtol=1e-8, atol=1e-8)  # elastic in the volume


# the complex step takes the same stress and is compiled anew
@pytest.mark.parametrize("derivative", ["auto", pytest.param("complex_step", marks=pytest.mark.slow)])
@pytest.mark.parametrize("mode", [0, 1, 2])
@pytest.mark.parametrize(("law", "params", "simpler", "same"), [
    ("j2_pressure", PRESSURE * [1, 1, 1, 1, 0], "j2_linear", PRESSURE[:4]),
    ("elastic_damage", DAMAGE * [1, 1, 1, 0, 1, 1], "elastic", DAMAGE[:2]),
    ("elastic_damage", [70e3, 0.3, np.inf, 30.0, 1.0, 0.0], "elastic", DAMAGE[:2])])
def test_at_its_null_value_the_law_is_the_simpler_one(law, params, simpler, same, mode, derivative, rng):
    path = random_path(rng, 5, 3 if mode == 0 else 2)
    P, _ = follow(compile(law, derivative=derivative), mode, path, np.array(params))
    expected, _ = follow(compile(simpler), mode, path, np.array(same))
    np.testing.assert_allclose(P, expected, atol=1e-9)
