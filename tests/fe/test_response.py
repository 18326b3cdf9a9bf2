"""First-order answers of other models along a path: small changes are what a new simulation says, shared points or
not."""

import numpy as np
import pytest
from fe_bodies import SHARP, body, grid, held, where

from idic.fe import response
from idic.fe.assembly import assembly
from idic.fe import Alternative, Reaction, Variation, first_responses, march
from idic.fe.assembly.assembly import discretise, evaluate_system
from idic.fe.body.boundary import drives_at
from idic.fe.response import like
from idic.laws import compile as compile_law

TIMES = np.arange(5.0)
PULL = np.array([0.0, 0.3, 0.6, 1.0, 0.5])


def plate(law="elastic", kinematics=None, pull=0.02, variations=()):
    """A plate pulled along x and let go by half."""
    mesh = grid("quad8", (4, 2), (2.0, 1.0))
    left, right = where(mesh, lambda x, y: x < 1e-9), where(mesh, lambda x, y: x > 2.0 - 1e-9)
    constraints = held(mesh, [(left, 0, 0.0), (left, 1, 0.0), (right, 0, pull * PULL)], len(TIMES))
    return body(mesh, "plane_stress", law, kinematics, constraints, channels=(Reaction(2 * right),),
                thickness=1.0, variations=variations)


def solved(model, params):
    states = [(s.u.copy(), s.channels[0]) for s in march(model, {"BODY": params}, TIMES, control=SHARP)]
    return np.array([u for u, _ in states]), np.array([f for _, f in states])


ELASTIC, FLOW = np.array([200.0, 0.3]), np.array([200.0, 0.3, 1.0, 10.0])
SPOT = (Variation("BODY", "spot", {"amount": 1.001, "x": 1.2, "y": 0.4, "radius": 0.4}),)
CHANGES = {"modulus": ({}, ELASTIC * [1.001, 1.0]), "contraction": ({}, ELASTIC * [1.0, 1.001]),
           "motion": ({"pull": 0.02002}, ELASTIC), "spot": ({"variations": SPOT}, ELASTIC)}  # of the plate, its law


@pytest.mark.parametrize("name", CHANGES)
def test_a_small_change_of_an_elastic_body_is_answered_as_by_a_new_simulation(name):
    change, params = CHANGES[name]
    model = plate(**change)
    u, force = solved(plate(), ELASTIC)
    base = Alternative(plate(), {"BODY": ELASTIC})
    answers = list(first_responses(base, TIMES, range(1, 5), u[1:], [Alternative(model, {"BODY": params})]))
    other_u, other_force = solved(model, params)
    du = np.array([a.du[..., 0] for a in answers])
    dforce = np.array([a.dchannels[0, 0] for a in answers])
    # one Newton step of a change of 1e-3 is exact to its square; Poisson's ratio changes the force by little anyway
    np.testing.assert_allclose(du, (other_u - u)[1:], atol=5e-3 * np.abs(other_u - u).max() + 1e-12)
    np.testing.assert_allclose(dforce, (other_force - force)[1:], atol=1e-2 * np.abs(other_force - force).max())


def test_models_solved_together_answer_as_each_alone(monkeypatch):
    flow = plate("j2_linear")
    u = solved(flow, FLOW)[0]
    base = Alternative(flow, {"BODY": FLOW})
    others = [Alternative(plate("j2_linear", variations=SPOT), {"BODY": FLOW}),
              Alternative(plate("j2_linear", pull=0.021), {"BODY": FLOW}),
              Alternative(flow, {"BODY": FLOW * [1.0, 1.0, 0.9, 1.0]}), Alternative(plate(), {"BODY": ELASTIC})]
    together = list(first_responses(base, TIMES, range(1, 5), u[1:], others))
    monkeypatch.setattr(response, "like", lambda _, model: discretise(model))  # nothing is shared
    for k, other in enumerate(others):
        for a, b in zip(together, first_responses(base, TIMES, range(1, 5), u[1:], [other]), strict=True):
            np.testing.assert_allclose(a.du[..., k], b.du[..., 0], atol=1e-12 * np.abs(u).max())
            np.testing.assert_allclose(a.dchannels[:, k], b.dchannels[:, 0], atol=1e-9)


@pytest.mark.parametrize(("before", "after"), [("elastic", "j2_linear"), ("j2_linear", "elastic"),
                                               ("elastic", "elastic_damage"), ("elastic", "orthotropic")])
def test_a_system_like_another_is_the_one_made_from_nothing(before, after):
    """Also where the law of one is linear, or its softening needs the size of an element, and that of the other not."""
    base, model = discretise(plate(before)), plate(after, variations=SPOT)
    ours, theirs = like(base, model), discretise(model)
    assert ours.body is model and ours.pattern is base.pattern
    u = solved(plate(before), FLOW if before == "j2_linear" else ELASTIC)[0][-1]
    params = {"BODY": compile_law(after).spec.defaults()}
    drives = drives_at(model, TIMES, TIMES[-1])
    one, other = (evaluate_system(system, params, u, system.rest_states(), 1.0, drives) for system in (ours, theirs))
    assert not one.trouble
    np.testing.assert_array_equal(one.internal, other.internal)
    for a, b in zip(ours.groups, theirs.groups, strict=True):
        assert a.law is b.law
        np.testing.assert_array_equal(a.weights, b.weights)
        np.testing.assert_array_equal(a.dofs, b.dofs)


def test_a_law_without_an_answer_is_lost_and_the_others_are_not():
    """A Poisson's ratio whose energy is not positive: nan for this model alone."""
    base = Alternative(plate(), {"BODY": ELASTIC})
    wrong = Alternative(plate("orthotropic"), {"BODY": np.array([10.0, 190.0, 0.53, 70.0, 0.0])})
    good = Alternative(plate(), {"BODY": ELASTIC * [1.001, 1.0]})
    u = solved(plate(), ELASTIC)[0]
    both = list(first_responses(base, TIMES, range(1, 5), u[1:], [wrong, good]))
    alone = list(first_responses(base, TIMES, range(1, 5), u[1:], [good]))
    for pair, single in zip(both, alone, strict=True):
        assert np.isnan(pair.du[..., 0]).all() and np.isnan(pair.dchannels[:, 0]).all()
        np.testing.assert_array_equal(pair.du[..., 1], single.du[..., 0])
        np.testing.assert_array_equal(pair.dchannels[:, 1], single.dchannels[:, 0])


def test_a_model_beside_one_with_a_spot_is_numbered_as_that_one(monkeypatch):
    """The numbering is what a discretisation costs, and once a spot is in the null every alternative needs one."""
    base, plain, made = discretise(plate(variations=SPOT)), discretise(plate()), []
    monkeypatch.setattr(assembly, "known_pattern", lambda *given: made.append(given))
    again = like(base, plate())
    assert not made and again.pattern is base.pattern
    np.testing.assert_array_equal(again.groups[0].weights, plain.groups[0].weights)
