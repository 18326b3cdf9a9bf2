"""A student adds a law by writing ``update`` alone: derivatives, plane stress and history follow by themselves."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from law_paths import follow, random_path
from numba import njit

from idic.laws import LawParameter, LawSpec, all_laws, compile, directional_stresses, get_law, point_stresses, register
from idic.laws.core import law
from idic.laws.neo_hookean import inverse


def update_maxwell(F, state, params, dt, P, state_new):
    """Small-strain Maxwell element beside a spring, G and G1 with time tau; state: its viscous strain (implicit)."""
    kappa, G, G1, tau = params[0], params[1], params[2], params[3]
    trace = (F[0, 0] + F[1, 1] + F[2, 2] - 3.0) / 3.0
    for i in range(3):
        for j in range(3):
            deviator = 0.5 * (F[i, j] + F[j, i]) - (1.0 + trace if i == j else 0.0 * trace)
            viscous = (state[3 * i + j] + dt / tau * deviator) / (1.0 + dt / tau)
            state_new[3 * i + j] = viscous
            P[i, j] = 2.0 * G * deviator + 2.0 * G1 * (deviator - viscous) + (3.0 * kappa * trace if i == j else 0.0)
    return 0


TOY = LawSpec(
    name="toy_maxwell", updates={"small": update_maxwell}, state_names=tuple(f"v{k}" for k in range(9)),
    parameters=tuple(LawParameter(n, u, n, v) for n, u, v in (("kappa", "MPa", 2.0), ("G", "MPa", 1.0),
                                                               ("G1", "MPa", 3.0), ("tau", "s", 2.0))))


@pytest.fixture
def toy(monkeypatch):
    monkeypatch.setitem(law._laws, TOY.name, TOY)
    return compile("toy_maxwell")


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_a_rate_dependent_law_with_update_alone_has_exact_history_derivatives(toy, mode, rng):
    d, n, dt = 3 if mode == 0 else 2, 4, 0.7
    params = TOY.defaults()
    path = random_path(rng, n, d)
    state, dstate = np.tile(toy.initial_state(mode), (n, 1)), np.zeros((n, 4, toy.n_state(mode)))
    for F in path:
        dP, dstate_new, ok = directional_stresses(toy, mode, F, state, params, dt, np.zeros((n, 4, d, d)), dstate,
                                                np.eye(4))
        state, dstate = point_stresses(toy, mode, F, state, params, dt)[1], dstate_new
        assert ok
    h = 1e-5
    for k in range(4):
        ends = [follow(toy, mode, path, params + s * h * np.eye(4)[k], dt)[0][-1] for s in (1, -1)]
        np.testing.assert_allclose(dP[:, k], (ends[0] - ends[1]) / (2 * h), atol=1e-10)  # h^2 times the stress, 0.1


def test_its_relaxation_is_the_exponential_as_steps_shrink(toy):
    kappa, G, G1, tau = TOY.defaults()
    errors = []
    for steps in (50, 100, 200):
        F = np.eye(3)[None].copy()
        F[0, 0, 1] = 0.01
        state, dt = toy.initial_state(0)[None], 2.0 / steps
        state = point_stresses(toy, 0, F, state, TOY.defaults(), 0.0)[1]
        for _ in range(steps):
            P, state, _ = point_stresses(toy, 0, F, state, TOY.defaults(), dt)
        errors.append(abs(P[0, 0, 1] / 0.01 - (G + G1 * np.exp(-2.0 / tau))))
    order = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(order, 1.0, atol=0.05)  # backward Euler


def test_two_laws_cannot_share_a_name():
    with pytest.raises(ValueError, match="registered already"):
        register(LawSpec(name="elastic", parameters=(), updates={"small": update_maxwell}))
    assert get_law("elastic") is all_laws()["elastic"]


def test_every_alternative_set_of_constants_gives_the_laws_own_parameters():
    for spec in all_laws().values():
        for names, convert in spec.alternatives.items():
            assert set(convert(*(2.0 + k for k in range(len(names))))) <= set(spec.parameter_names)
    E, nu = 210e3, 0.28
    G, K = E / 2 / (1 + nu), E / 3 / (1 - 2 * nu)
    lam = K - 2 * G / 3
    for names, values in ((("K", "G"), (K, G)), (("E", "G"), (E, G)), (("E", "K"), (E, K)), (("lam", "mu"), (lam, G))):
        converted = get_law("elastic").alternatives[names](*values)
        np.testing.assert_allclose([converted["E"], converted["nu"]], [E, nu])


def test_importing_the_laws_compiles_nothing():
    code = ("import gc, sys; from numba.core.dispatcher import Dispatcher; "
            "import idic.laws, idic.laws.core.points, idic.laws.core.point; "
            "sys.exit(sum(len(d.signatures) for d in gc.get_objects() if isinstance(d, Dispatcher) "
            "and d.py_func.__module__.startswith('idic')))")
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_helper_of_laws_is_called_from_compiled_functions_alone():
    """Called from Python, a function without the code that takes Python's objects apart would end the process."""
    called = njit(lambda F, out: inverse(F, out))
    assert called(np.diag([1.0, 2.0, 4.0]), np.empty((3, 3))) == 8.0
    with pytest.raises(TypeError, match=r"compiled functions only.*\.py_func"):
        inverse(np.eye(3), np.empty((3, 3)))
    assert inverse.py_func(np.diag([1.0, 2.0, 4.0]), np.empty((3, 3))) == 8.0


def test_a_law_file_with_the_former_names_of_a_parameters_fields_still_reads():
    former = LawParameter("k", "MPa", "k", 1.0, reach=0.05, trials=(0.1, 0.2), calmer=0.5, sooner=0.6)
    assert former == LawParameter("k", "MPa", "k", 1.0, max_step=0.05, start_values=(0.1, 0.2), stabilising_factor=0.5,
                                  activation_factor=0.6)
    assert replace(former, default=2.0).max_step == 0.05
