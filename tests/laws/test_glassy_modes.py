"""The Eindhoven Glassy Polymer with several Maxwell modes: limits of one mode, exact identities, derivatives."""

import numpy as np
import pytest
from law_paths import follow, random_path

from idic.errors import InputError
from idic.experiment_file.schema.materials import MaterialTable
from idic.experiment_file.tables.dofs import material
from idic.laws import compile, directional_stresses, get_law, law_for, point_stresses, point_tangents
from idic.laws import point

DEFAULTS = get_law("egp").defaults()
SHARED, G1, ETA01 = 8, 8, 9
STRESSES = [0, 5, 7]  # Gr, tau0, kappa; with them all moduli and viscosities


def with_modes(*modes):
    """(law, parameters) of modes (G, eta0)."""
    return compile(f"egp_{len(modes)}"), np.concatenate([DEFAULTS[:SHARED], *modes])


def spectrum(n):
    """Moduli that fall slowly, viscosities that fall by a factor of eleven, as measured on polycarbonate.

    Every number of modes is compiled for itself, 4 s: the tests share 2, 3 and 17.
    """
    k = np.arange(1, n)
    return with_modes((350.0, 2e11), *np.stack([56.0 * 0.87**k, 3.5e10 * 11.0**-k], axis=1))


def softened(law, params, rng, mode=0, n=4, steps=30, size=0.4):
    """(F of a next step, state) of points far beyond yield."""
    d = 3 if mode == 0 else 2
    direction = rng.standard_normal((n, d, d))
    direction -= np.trace(direction, axis1=1, axis2=2)[:, None, None] / d * np.eye(d)
    direction *= size / np.linalg.norm(direction, axis=(1, 2))[:, None, None]
    path = np.array([np.eye(d) + k / steps * direction for k in range(1, steps + 1)])
    return path[-1] + 0.02 * rng.standard_normal((n, d, d)), follow(law, mode, path, params, 5.0)[1]


@pytest.fixture
def rng():
    return np.random.default_rng(5)


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_like_modes_that_share_the_modulus_are_one_mode(mode, rng):
    law, params = with_modes(*[(DEFAULTS[G1] / 3, DEFAULTS[ETA01] / 3)] * 3)
    path = random_path(rng, 5, 3 if mode == 0 else 2, steps=30, size=0.3)
    (several, state), (one, state_one) = follow(law, mode, path, params), follow(compile("egp"), mode, path, DEFAULTS)
    np.testing.assert_allclose(several, one, atol=1e-9 * np.abs(one).max())  # tau/tau0 of 60 multiplies rounding
    np.testing.assert_allclose(state[:, :6], state_one[:, :6], atol=1e-10)
    np.testing.assert_allclose(state[:, 18], state_one[:, 6], atol=1e-10)


def test_one_mode_by_this_code_is_the_law_with_one_mode(rng):
    """The same functions serve any number of modes: a second one without stiffness leaves the first alone."""
    law, params = with_modes((634.0, 1.47e11), (0.0, 1e9))
    path = random_path(rng, 5, 3, steps=30, size=0.3)
    several, one = follow(law, 0, path, params)[0], follow(compile("egp"), 0, path, DEFAULTS)[0]
    np.testing.assert_allclose(several, one, atol=1e-9 * np.abs(one).max())


@pytest.mark.parametrize("viscosity", [1e-3, 1e11])
def test_a_mode_of_little_stiffness_has_little_effect(viscosity, rng):
    path = random_path(rng, 5, 3, steps=30, size=0.3)
    one = follow(compile("egp"), 0, path, DEFAULTS)[0]
    gaps = []
    for G in (6.34, 0.634):
        law, params = with_modes((634.0, 1.47e11), (G, viscosity * G / 634.0))
        gaps.append(np.abs(follow(law, 0, path, params)[0] - one).max())
    assert gaps[1] < 2e-3 * np.abs(one).max()  # a thousandth of the modulus
    assert 5.0 < gaps[0] / gaps[1] < 20.0      # in proportion to G; jumps of the yield drop make it a little uneven


def test_a_mode_that_never_relaxes_adds_to_the_network(rng):
    """An infinite viscosity keeps Cp = 1: the mode is a neo-Hookean spring like Gr, but tau knows its stress."""
    F, state = random_path(rng, 5, 3, steps=2, size=0.05)[-1], None
    law, params = with_modes((1e-9, 1e-9), (50.0, 1e300))
    network = DEFAULTS.copy()
    network[0] += 50.0
    network[G1] = 0.0
    state = np.tile(law.initial_state(0), (5, 1))
    P, _, ok = point_stresses(law, 0, F, state, params, 1.0)
    rest = np.tile(compile("egp").initial_state(0), (5, 1))
    expected, _, _ = point_stresses(compile("egp"), 0, F, rest, network, 1.0)
    assert ok
    np.testing.assert_allclose(P, expected, atol=1e-8)  # MPa: the first mode's modulus


@pytest.mark.parametrize("mode", [0, 1, 2])
@pytest.mark.slow  # compiled anew, 8 s
@pytest.mark.parametrize("n", [2, 17])
def test_hand_written_derivatives_equal_the_complex_step(n, mode, rng):
    law, params = spectrum(n)
    oracle = compile(law.spec.name, derivative="complex_step")
    F, state = softened(law, params, rng, mode)
    nd = 2 + len(params)
    dF = rng.standard_normal((len(F), nd, *F.shape[1:]))
    dstate = 0.1 * rng.standard_normal((len(F), nd, state.shape[1]))
    dstate[..., 6 * n + 1] = 0.0  # where the search begins
    dparams = np.vstack([np.zeros((2, len(params))), np.diag(params)])
    dF[:, 2:], dstate[:, 2:] = 0.0, 0.0
    a, a_state, ok = directional_stresses(law, mode, F, state, params, 1.0, dF, dstate, dparams)
    b, b_state, ok_oracle = directional_stresses(oracle, mode, F, state, params, 1.0, dF, dstate, dparams)
    assert ok and ok_oracle
    tolerance = 1e-7 if mode == 2 else 1e-9  # as with one mode; sums over modes of either sign cancel
    for k in range(nd):
        assert np.abs(a[:, k] - b[:, k]).max() <= tolerance * np.abs(b[:, k]).max() + 1e-11 * np.abs(b).max(), k
        np.testing.assert_allclose(a_state[:, k, :6 * n + 1], b_state[:, k, :6 * n + 1],
                                   atol=tolerance * max(1.0, np.abs(b_state[:, k, :6 * n + 1]).max()))


@pytest.mark.parametrize("mode", [0, 2])
def test_the_tangent_is_the_difference_quotient_of_the_stress(mode, rng):
    law, params = spectrum(3)
    F, state = softened(law, params, rng, mode)
    A = point_tangents(law, mode, F, state, params, 1.0)[2]
    d, h = F.shape[1], 1e-6
    for c in range(d * d):
        step = np.zeros((d, d))
        step[c // d, c % d] = h
        up, down = (point_stresses(law, mode, F + s * step, state, params, 1.0)[0] for s in (1, -1))
        quotient = ((up - down) / (2 * h)).reshape(len(F), -1)
        np.testing.assert_allclose(A[:, :, c], quotient, atol=1e-5 * np.abs(A).max())  # (h d ln E)^2 = (1e-6 * 1e3)^2


def test_a_tension_curves_sensitivities_are_difference_quotients(rng):
    law, params = spectrum(3)
    strain = np.linspace(0, 0.2, 41)
    curve = point.uniaxial(law, params, strain, times=1e3 * strain)
    h = 1e-5
    for k in range(len(params)):
        step = h * params * (np.arange(len(params)) == k)
        ahead, behind = (point.uniaxial(law, params + s * step, strain, times=1e3 * strain).P[:, 0, 0]
                         for s in (1, -1))
        scale = np.abs(params[k] * curve.dP[:, k, 0, 0]).max()
        np.testing.assert_allclose(params[k] * curve.dP[:, k, 0, 0], (ahead - behind) / (2 * h),
                                   atol=1e-5 * scale + 1e-4)  # as with one mode: truncation and the driver's 1e-10


@pytest.mark.parametrize("mode", [0, 2])
def test_all_parameters_of_stress_together_scale_the_stress_and_nothing_else(mode, rng):
    law, params = spectrum(3)
    F, state = softened(law, params, rng, mode)
    stresses = [*STRESSES, *range(SHARED, len(params))]
    scaled = params.copy()
    scaled[stresses] *= 2.0
    P, new, ok = point_stresses(law, mode, F, state, params, 1.0)
    P2, new2, ok2 = point_stresses(law, mode, F, state, scaled, 1.0)
    assert ok and ok2
    np.testing.assert_allclose(P2, 2 * P, rtol=1e-11, atol=1e-9)
    np.testing.assert_allclose(new2, new, rtol=1e-11, atol=1e-12)
    dparams = np.zeros((1, len(params)))
    dparams[0, stresses] = params[stresses]
    dP, dnew, _ = directional_stresses(law, mode, F, state, params, 1.0, np.zeros((len(F), 1, *F.shape[1:])), None,
                                     dparams)
    np.testing.assert_allclose(dP[:, 0], P, atol=1e-9 * np.abs(P).max())
    assert np.abs(dnew[..., :19]).max() < 1e-9


def test_the_equations_of_flow_are_satisfied_by_the_state(rng):
    """Every viscosity by its definition at the end of the step, out of stresses alone, moves its own Cp."""
    law, params = spectrum(3)
    F, state = softened(law, params, rng, n=10)
    P, new, _ = point_stresses(law, 0, F, state, params, 1.0)
    J = np.linalg.det(F)[:, None, None]
    iso = F / np.cbrt(J)
    deviators = []
    for i in range(3):
        Be = iso @ np.linalg.inv(_tensor(new, 6 * i)) @ iso.transpose(0, 2, 1)
        deviators.append(Be - np.trace(Be, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3))
    G, eta0 = params[SHARED::2], params[SHARED + 1::2]
    s = sum(g * dev for g, dev in zip(G, deviators, strict=True))
    tau = np.sqrt(0.5 * (s**2).sum((1, 2)))
    p = -3750.0 * (J[:, 0, 0] - 1)
    gamma = new[:, 18]
    S = 27 * ((1 + (0.965 * np.exp(gamma)) ** 50.0) / (1 + 0.965**50)) ** (-4 / 50)
    a = (tau / 0.7) / np.sinh(tau / 0.7) * np.exp(0.08 * p / 0.7) * np.exp(S)
    np.testing.assert_allclose(1.0 / a, new[:, 19], rtol=1e-8)  # tau/tau0 of 40 multiplies its rounding
    tau1 = G[0] * np.sqrt(0.5 * (deviators[0] ** 2).sum((1, 2)))
    np.testing.assert_allclose(gamma - state[:, 18], tau1 / (eta0[0] * a), rtol=1e-8, atol=1e-15)
    Ct = iso.transpose(0, 2, 1) @ iso
    for i in range(3):
        Y = _tensor(state, 6 * i) + (G[i] / (eta0[i] * a))[:, None, None] * Ct
        np.testing.assert_allclose(_tensor(new, 6 * i), Y / np.cbrt(np.linalg.det(Y))[:, None, None], rtol=1e-7,
                                   atol=1e-8)


def _tensor(state, first):
    out = np.empty((len(state), 3, 3))
    for m, (i, j) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))):
        out[:, i, j] = out[:, j, i] = state[:, first + m] + (i == j)
    return out


def test_a_spectrum_yields_gradually_before_the_peak():
    """Fast modes flow first: the tangent modulus falls before yield, where one mode is nearly linear."""
    strain = np.linspace(0, 0.03, 61)
    law, params = spectrum(17)
    moduli = []
    for which, values in ((law, params), (compile("egp"), DEFAULTS)):
        stress = point.uniaxial(which, values, strain, times=1e3 * strain).cauchy[:, 0, 0]
        slope = np.gradient(stress, strain)
        moduli.append(slope[40] / slope[1])
    assert moduli[0] < 0.75 < 0.9 < moduli[1]


@pytest.mark.parametrize("dt", [1e-12, 1.0, 1e6, 1e15, 1e30])
@pytest.mark.parametrize("scale", [0.01, 0.3])
def test_a_step_of_any_length_is_taken(dt, scale, rng):
    law, params = spectrum(17)
    F = np.linalg.qr(rng.standard_normal((20, 3, 3)))[0]
    F = F * np.exp(scale * rng.standard_normal((20, 1, 3))) @ F.transpose(0, 2, 1)
    F *= 1.0 / np.cbrt(np.linalg.det(F))[:, None, None]
    P, new, A, ok = point_tangents(law, 0, F, np.tile(law.initial_state(0), (20, 1)), params, dt)
    assert ok
    for values in (P, new, A):
        assert np.isfinite(values).all()


def test_the_number_of_modes_follows_from_the_names_of_the_parameters():
    assert law_for("egp", ("Gr", "G1", "eta0")) is get_law("egp") is get_law("egp_1")
    names = law_for("egp", ("G1", "eta01", "G3", "eta03")).parameter_names
    assert names[8:] == ("G1", "eta01", "G2", "eta02", "G3", "eta03")
    table = MaterialTable.model_validate({"law": "egp", **dict(zip(get_law("egp_2").parameter_names,
                                                                   get_law("egp_2").defaults(), strict=True))})
    record, parameters, _ = material("strip", table, "experiment.toml")
    assert record.law == "egp_2" and [p.name for p in parameters][-2:] == ["strip.G2", "strip.eta02"]
    with pytest.raises(InputError, match="eta02"):
        material("strip", MaterialTable.model_validate(
            {"law": "egp", **{name: 1.0 for name in ("Gr", "Sa", "r0", "r1", "r2", "tau0", "mu", "kappa", "G1",
                                                     "eta01", "G2")}}), "experiment.toml")
