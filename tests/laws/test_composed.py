"""The composed law: its short forms, the equations of its terms, and bad combinations are refused."""

import pickle

import numpy as np
import pytest
from law_paths import follow, random_path

from idic.errors import InputError
from idic.laws import point
from idic.laws import compile, composed_name, get_law
from idic.laws.composed.short_forms import SHORT_FORMS

STRAIN = np.linspace(0.0, 0.03, 16)
E, NU, YIELD = 70e3, 0.3, 200.0

# One law with every mechanism serves most tests, its terms switched off by their values: it is compiled once.
ALL_TERMS = ["hill48", "voce", "linear", "armstrong_frederick", "armstrong_frederick", "norton", "lemaitre"]
OFF = {"E": E, "nu": NU, "yield_stress": YIELD, "yield_surface_r0": 1.0, "yield_surface_r45": 1.0,
       "yield_surface_r90": 1.0, "yield_surface_angle": 0.0, "hardening_1_Q": 0.0, "hardening_1_b": 1.0,
       "hardening_2_H": 0.0, "backstress_1_C": 0.0, "backstress_1_gamma": 0.0, "backstress_2_C": 0.0,
       "backstress_2_gamma": 0.0, "rate_eta": 0.0, "rate_m": 1.0, "damage_S": 1e30, "damage_s": 1.0,
       "damage_threshold": 0.0, "damage_length": 0.0}


def whole(**values):
    """The law with every mechanism and the values of those that are meant: (law, values)."""
    law = compile(composed_name(ALL_TERMS))
    assert law.spec.parameter_names == tuple(OFF)
    return law, np.array(list((OFF | values).values()))


def equal(old, new, mode, values, own):
    path = random_path(np.random.default_rng(3), 8, 3 if mode == 0 else 2, 8)
    P, state = follow(old, mode, path, values, dt=0.1)
    Q, other = follow(new, mode, path, own, dt=0.1)
    np.testing.assert_allclose(Q, P, atol=1e-10 * np.abs(P).max())
    np.testing.assert_allclose(other[:, :7], state[:, :7], atol=1e-12)
    assert state[:, 6].max() > 1e-3  # it has yielded


@pytest.mark.parametrize("name", SHORT_FORMS)
def test_a_short_form_is_its_combination_with_the_parameters_by_other_names(name):
    form, short = SHORT_FORMS[name], get_law(name)
    whole = get_law(composed_name(form.kinds))
    assert {*whole.parameter_names} == {*_composed_names(name)}
    assert short.linearise.keys() == whole.linearise.keys() and short.isotropic == whole.isotropic
    assert short.rate_dependent == whole.rate_dependent and short.state_names == whole.state_names


def _composed_names(name):
    longer = {short: composed for composed, short in SHORT_FORMS[name].names.items()}
    return [longer.get(own, own) for own in get_law(name).parameter_names]


@pytest.mark.slow  # two laws to compile
@pytest.mark.parametrize("name", ["j2_hill", "j2_pressure"])  # parameters in another order
def test_a_short_form_has_the_stresses_of_its_combination(name, mode):
    old, new = compile(name), compile(composed_name(SHORT_FORMS[name].kinds))
    values = dict(zip(_composed_names(name), old.spec.defaults(), strict=True))
    equal(old, new, mode, old.spec.defaults(), np.array([values[own] for own in new.spec.parameter_names]))


@pytest.mark.slow  # the whole law takes 20 s to compile
@pytest.mark.parametrize("name", ["j2_linear", "j2_voce", "j2_kinematic", "j2_hill", "viscoplastic"])
def test_terms_that_are_switched_off_leave_an_older_law(name, mode):
    old = compile(name)
    values = dict(zip(old.spec.parameter_names, old.spec.defaults(), strict=True))
    if name == "j2_hill":
        values["angle"] = 25.0
    ours = {"hardening_modulus": "hardening_2_H", "Q": "hardening_1_Q", "b": "hardening_1_b", "C": "backstress_2_C",
            "gamma": "backstress_2_gamma", "eta": "rate_eta", "m": "rate_m"}
    ours |= {key: f"yield_surface_{key}" for key in ("r0", "r45", "r90", "angle")}
    new, own = whole(**{ours.get(key, key): value for key, value in values.items()})
    equal(old, new, mode, np.array(list(values.values())), own)


def test_pragers_back_stress_is_the_kinematic_law_without_recovery(mode):
    values = [E, NU, YIELD, 3000.0]
    equal(compile("j2_kinematic"), compile("elastoplastic(prager)"), mode, np.array([*values[:3], 0.0, 3000.0, 0.0]),
          np.array(values))


def tension(law, values, strain=STRAIN, seconds=1.0):
    """(Kirchhoff stress, plastic strain, state) of the solid in tension."""
    curve = point.uniaxial(law, values, strain, times=seconds * np.arange(len(strain)))
    return curve.P[:, 0, 0] * curve.F[:, 0, 0], curve.state[:, 6], curve.state


@pytest.mark.slow  # the whole law takes 20 s to compile
def test_hardening_terms_and_pragers_back_stress_add_up_in_tension():
    there = np.concatenate([np.linspace(0.0, 0.03, 16), np.linspace(0.03, 0.0, 61)[1:]])
    stress, p, _ = tension(*whole(hardening_1_Q=80.0, hardening_1_b=30.0, hardening_2_H=500.0, backstress_1_C=3000.0),
                           there)
    isotropic = YIELD + 80.0 * (1 - np.exp(-30.0 * p)) + 500.0 * p
    out = p[:16] > 0
    np.testing.assert_allclose(stress[:16][out], (isotropic + 3000.0 * p)[:16][out], rtol=1e-8)
    assert p[-1] > p[15]  # flows back
    plastic = 2.0 * p[15] - p[-1]  # plastic strain along the axis: forth, then back
    np.testing.assert_allclose(stress[-1], -isotropic[-1] + 3000.0 * plastic, rtol=1e-6)


@pytest.mark.slow  # the whole law takes 20 s to compile
def test_two_back_stresses_saturate_at_the_sum_of_C_over_gamma():
    stress, p, _ = tension(*whole(backstress_1_C=40e3, backstress_1_gamma=800.0, backstress_2_C=9e3,
                                  backstress_2_gamma=300.0), np.linspace(0.0, 0.06, 31))
    np.testing.assert_allclose(stress[-1], YIELD + 40e3 / 800.0 + 9e3 / 300.0, rtol=1e-5)  # w^n of 30 steps
    x = np.zeros(2)  # backward Euler: each back stress follows x+ = (x + C dp) / (1 + gamma dp)
    for k, growth in enumerate(np.diff(p), 1):
        x = (x + np.array([40e3, 9e3]) * growth) / (1.0 + np.array([800.0, 300.0]) * growth)
        if growth > 0:
            np.testing.assert_allclose(stress[k], YIELD + x.sum(), rtol=1e-8)


@pytest.mark.slow  # three laws to compile
@pytest.mark.parametrize(("rate", "values", "resistance"), [
    ("norton", (20.0, 4.0), lambda flow, r: flow + 20.0 * r**0.25),
    ("perzyna", (0.02, 2.5), lambda flow, r: flow * (1.0 + (0.02 * r) ** 0.4)),
    ("johnson_cook", (0.03, 1e-3), lambda flow, r: flow * (1.0 + 0.03 * np.log(1.0 + r / 1e-3)))])
def test_the_rate_raises_the_flow_stress_by_its_equation(rate, values, resistance):
    seconds = 0.5
    law = compile(composed_name(["linear", rate]))
    stress, p, _ = tension(law, [E, NU, YIELD, 1000.0, *values], seconds=seconds)
    speed, flow = np.diff(p) / seconds, (YIELD + 1000.0 * p)[1:]
    yields = speed > 0
    assert yields.sum() > 10
    np.testing.assert_allclose(stress[1:][yields], resistance(flow, speed)[yields], rtol=1e-8)


@pytest.mark.slow  # the whole law takes 20 s to compile
def test_damage_grows_with_the_energy_release_rate_and_takes_stiffness():
    S, s, threshold = 0.15, 1.5, 0.004
    stress, p, state = tension(*whole(hardening_2_H=1000.0, damage_S=S, damage_s=s, damage_threshold=threshold))
    D = state[:, -1]
    effective = YIELD + 1000.0 * p  # in tension Y = (effective stress)^2 / (2 E)
    np.testing.assert_allclose(stress[p > 0], ((1.0 - D) * effective)[p > 0], rtol=1e-8)
    counted = np.diff(np.maximum(p, threshold))
    np.testing.assert_allclose(np.diff(D), (effective[1:] ** 2 / (2.0 * E * S)) ** s * counted, rtol=1e-8, atol=1e-12)
    assert D[-1] > 0.05


@pytest.mark.slow  # the whole law takes 20 s to compile
def test_no_damage_grows_in_compression():
    _, p, state = tension(*whole(damage_S=0.4, damage_s=1.5), -STRAIN)
    assert p[-1] > 0.02 and np.abs(state[:, -1]).max() < 1e-20  # rounding of the mean stress over q, squared


@pytest.mark.slow
def test_a_drucker_prager_body_with_a_rate_has_the_derivative_of_its_complex_step():
    name = composed_name(["drucker_prager", "voce", "perzyna"])
    by_hand, oracle = compile(name), compile(name, derivative="complex_step")
    values = [point.uniaxial(law, law.spec.defaults(), STRAIN, mode=2).dP for law in (by_hand, oracle)]
    np.testing.assert_allclose(values[0], values[1], atol=1e-9 * np.abs(values[1]).max())


def test_the_name_of_a_combination_says_all_that_makes_it():
    assert composed_name(["lemaitre", "mises", "voce", "linear"]) == "elastoplastic(voce+linear+lemaitre)"
    assert composed_name(["mises"]) == "elastoplastic"
    law = get_law("elastoplastic( linear + voce )")
    assert law.parameter_names == ("E", "nu", "yield_stress", "hardening_1_H", "hardening_2_Q", "hardening_2_b")
    compiled = compile("elastoplastic(linear)")
    assert pickle.loads(pickle.dumps(compiled)) is compiled  # a worker makes it from the name
    assert get_law("elastoplastic(johnson_cook)").rate_dependent and not get_law("elastoplastic(prager)").rate_dependent


@pytest.mark.parametrize(("kinds", "found"), [
    (["drucker_prager", "prager"], "drucker_prager"), (["lemaitre", "drucker_prager"], "drucker_prager"),
    (["linear", "linear"], "linear and linear"),
    (["norton", "perzyna"], "norton and perzyna"),
    (["swift", "swift"], "swift and swift"), (["ludwik"], "'ludwik'"), (["voce"] * 9, "9")])
def test_terms_that_do_not_go_together_are_refused(kinds, found):
    with pytest.raises(InputError) as error:
        composed_name(kinds)
    assert error.value.found == found and error.value.expected and error.value.remedy
