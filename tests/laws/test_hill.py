"""Hill's yield condition against what sheet-metal books say of tension strips, and at its null values."""

import numpy as np
import pytest
from law_paths import follow, random_path

from idic.laws import compile
from idic.laws import point

E, NU, YIELD = 210e3, 0.3, 200.0
R0, R45, R90 = 1.8, 1.1, 2.4


def parameters(r0=R0, r45=R45, r90=R90, angle=0.0, Q=0.0, b=10.0, modulus=0.0):
    return np.array([E, NU, YIELD, Q, b, modulus, r0, r45, r90, angle])


def hill(theta):
    """(stress of a strip at theta degrees over that at 0, its Lankford ratio): Hill (1948), eq. 24 and 27."""
    s, c = np.sin(np.deg2rad(theta)) ** 2, np.cos(np.deg2rad(theta)) ** 2
    g = 1 / (1 + R0)
    h, f = R0 * g, R0 / R90 * g
    n = (R0 + R90) * (1 + 2 * R45) / (2 * R90) * g
    stress = (f * s * s + g * c * c + h * (c - s) ** 2 + 2 * n * s * c) ** -0.5
    return stress, (h + (2 * n - f - g - 4 * h) * s * c) / (f * s + g * c)


@pytest.mark.parametrize("mode", [0, 2], ids=["3d", "plane_stress"])
@pytest.mark.parametrize("theta", [0.0, 20.0, 45.0, 70.0, 90.0])
def test_a_strip_cut_at_an_angle_has_Hills_yield_stress_and_ratio_of_strains(theta, mode):
    law = compile("j2_hill")
    curve = point.uniaxial(law, parameters(angle=-theta), np.linspace(0.0, 0.01, 101), mode=mode)
    d = curve.F.shape[1]
    kirchhoff = (curve.P @ curve.F.transpose(0, 2, 1))[:, 0, 0]
    stress, ratio = hill(theta)
    # ideally plastic: the stress stays. Its axis turns with the shear of the strip (0.01), the yield stress with it
    np.testing.assert_allclose(kirchhoff[20:], YIELD * stress, rtol=5e-3)
    rate = np.linalg.solve(curve.F[1:].transpose(0, 2, 1), np.diff(curve.F, axis=0).transpose(0, 2, 1))
    width = rate[20:, 1, 1]
    thickness = rate[20:, 2, 2] if d == 3 else np.diff(np.log(curve.state[:, -1]))[20:]
    np.testing.assert_allclose(width / thickness, ratio, rtol=2e-2)  # the same turn, and steps of 1e-4


def test_the_named_ratios_are_those_of_strips_at_0_45_and_90_degrees():
    np.testing.assert_allclose([hill(t)[1] for t in (0.0, 45.0, 90.0)], [R0, R45, R90])


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_with_ratios_of_one_it_is_the_isotropic_law_at_any_angle(mode, rng):
    path = random_path(rng, 5, 3 if mode == 0 else 2)
    isotropic = np.array([E, NU, YIELD, 100.0, 20.0, 500.0])
    expected, state = follow(compile("j2_voce"), mode, path, isotropic)
    found, own = follow(compile("j2_hill"), mode, path, np.array([*isotropic, 1.0, 1.0, 1.0, 33.0]))
    np.testing.assert_allclose(found, expected, atol=1e-12 * E * 10)  # rounding of the turns
    np.testing.assert_allclose(own, state, atol=1e-12)


def test_the_returned_stress_lies_on_the_hardened_yield_surface(rng):
    params = parameters(angle=25.0, Q=100.0, modulus=300.0)
    path = random_path(rng, 8, 3)
    P, state = follow(compile("j2_hill"), 0, path, params)
    F = path[-1]
    U, _, Vt = np.linalg.svd(F)
    c, s = np.cos(np.deg2rad(25.0)), np.sin(np.deg2rad(25.0))
    axes = U @ Vt @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])  # R Q
    t = axes.transpose(0, 2, 1) @ (P[-1] @ F.transpose(0, 2, 1)) @ axes
    g = 1 / (1 + R0)
    h, f, n = R0 * g, R0 / R90 * g, (R0 + R90) * (1 + 2 * R45) / (2 * R90) * g
    q = np.sqrt(f * (t[:, 1, 1] - t[:, 2, 2]) ** 2 + g * (t[:, 2, 2] - t[:, 0, 0]) ** 2
                + h * (t[:, 0, 0] - t[:, 1, 1]) ** 2 + 3 * (t[:, 1, 2] ** 2 + t[:, 0, 2] ** 2)
                + 2 * n * t[:, 0, 1] ** 2)
    p = state[:, 6]
    flow = YIELD + 100.0 * (1 - np.exp(-10.0 * p)) + 300.0 * p
    yields = follow(compile("j2_hill"), 0, path[:-1], params)[1][:, 6] < p  # in the last step
    assert yields.sum() > 3
    np.testing.assert_allclose(q[yields], flow[yields], rtol=1e-10)
    assert np.all(q <= flow * (1 + 1e-10))


@pytest.mark.parametrize("ratio", [0.1, 0.5, 5.0, 15.0])
def test_strong_anisotropy_and_large_steps_find_their_root(ratio, rng):
    path = random_path(rng, 50, 3, size=0.6)
    _, state = follow(compile("j2_hill"), 0, path, parameters(ratio, 1.0, 1 / ratio, 30.0, 100.0, 5.0, 50.0))
    assert np.all(state[:, 6] > 0.1)


@pytest.mark.parametrize("mode", [0, 2], ids=["3d", "plane_stress"])
def test_a_point_that_stays_where_it_was_left_stays_on_the_yield_surface(mode, rng):
    law, params = compile("j2_hill"), parameters(angle=25.0, Q=100.0, modulus=300.0)
    path = random_path(rng, 200, 3 if mode == 0 else 2)
    P, state = follow(law, mode, path, params)
    again, same = follow(law, mode, path[-1:], params, state=state)
    np.testing.assert_allclose(again[-1], P[-1], atol=1e-12 * E)  # rounding of the elastic strain times E
    np.testing.assert_allclose(same, state, atol=1e-12)
