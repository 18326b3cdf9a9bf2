"""Parameters that depend on the temperature: their factors, and a warmed body whose history is differentiated
exactly."""

from dataclasses import replace

import numpy as np
import pytest

from idic.errors import InputError, NotConverged
from idic.fe import Constraints, Control, Direction, Loads, Body, Reaction, Section, make_mesh, march
from idic.laws import compile, get_law

LAW = "elastoplastic(linear+linear*E+johnson_cook*flow_stress)"
VALUES = np.array([70e3, 0.3, 200.0, 1500.0, -4e-4, 1.1, 640.0, 20.0])
MELTING, REFERENCE = 640.0, 20.0
TIMES = np.arange(5.0)
WARMING = np.array([0.0, 60.0, 90.0, 200.0, 120.0])  # K since the first frame


def model(law, warming, start, grip):
    """A quadrilateral, homogeneous in tension; temperatures (n_frames, n_nodes)."""
    nodes = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)])
    mesh = make_mesh(nodes, [("quad4", np.array([[0, 1, 2, 3]]))], element_sets={"BODY": np.array([0])})
    return Body(mesh, "plane_stress", (Section("BODY", compile(law), np.array([0])),),
                 Constraints(np.array([0, 6, 1, 2, 4]), np.array([[0.0], [0.0], [0.0], [1.0], [1.0]]), grip[:, None]),
                 channels=(Reaction(np.array([2, 4])),), temperature=warming, start_temperature=start)


GRIP = np.array([0.0, 0.004, 0.012, 0.03, 0.05])


def pulled(values, warming=WARMING[:, None] + np.zeros(4), start=np.full(4, 20.0), grip=GRIP,
           directions=()):  # noqa: B008
    return list(march(model(LAW, warming, start, grip), {"BODY": values}, TIMES, directions,
                      control=Control(tolerance=1e-13)))


def test_the_flow_stress_follows_johnson_and_cook_and_the_modulus_falls_linearly():
    states = pulled(VALUES)
    for frame, state in enumerate(states[1:], 1):
        T = 20.0 + WARMING[frame]
        F, P, p = (state.points[0].F[0], state.points[0].P[0], state.points[0].state[0, 6])
        if frame == 1:
            E = 70e3 * (1.0 - 4e-4 * (T - 20.0))
            strain = F[0, 0] - 1.0
            assert P[0, 0] == pytest.approx(E * strain, rel=3.0 * strain) and p == 0.0  # finite strain: that order
        else:
            factor = 1.0 - ((T - REFERENCE) / (MELTING - REFERENCE)) ** 1.1
            assert P[0, 0] * F[0, 0] == pytest.approx(factor * (200.0 + 1500.0 * p), rel=1e-9)
    assert state.points[0].state[0, 6] > 0.01


def test_a_body_without_load_has_no_stress_at_any_temperature():
    states = pulled(VALUES, grip=0.0 * GRIP)
    assert max(np.abs(s.points[0].P).max() for s in states[1:]) < 1e-9


def test_a_body_that_is_unloaded_and_warmed_keeps_its_shape():
    """A modulus that changes leaves no stress behind: the state holds strains."""
    free = model(LAW, WARMING[:, None] + np.zeros(4), np.full(4, 20.0), GRIP)
    pull = np.zeros(8)
    pull[[2, 4]] = 0.5
    free = replace(
        free, constraints=Constraints(np.array([0, 6, 1]), np.zeros((3, 0)), np.zeros((5, 0))), channels=(),
        loads=Loads(dead=pull[:, None], dead_histories=np.array([0.0, 150.0, 210.0, 0.0, 0.0])[:, None]))
    warming = np.array([0.0, 0.0, 0.0, 0.0, 200.0])[:, None] + np.zeros(4)
    *_, before, after = list(march(replace(free, temperature=warming), {"BODY": VALUES}, TIMES))
    assert before.u.max() > 1e-3
    np.testing.assert_allclose(after.u, before.u, atol=1e-9 * before.u.max())


def test_the_history_of_a_warmed_body_is_differentiated_exactly():
    """By every parameter and by a shift of the temperature, over loading, with a temperature that varies in the
    body."""
    start = np.array([20.0, 35.0, 50.0, 25.0])
    warming = WARMING[:, None] * np.array([1.0, 0.8, 1.2, 1.1])
    shift = np.gradient(warming, TIMES, axis=0)
    shift[0] = 0.0
    names = compile(LAW).spec.parameter_names
    directions = [*(Direction(name, material=(0, i)) for i, name in enumerate(names)),
                  Direction("T", d_temperature=shift)]
    exact = pulled(VALUES, warming, start, directions=directions)[-1]
    for k in range(len(directions)):
        step = 3e-5 * (abs(VALUES[k]) if k < len(names) else 1.0)  # by 1e-5 rounding of the quotient is 2e-6 of nu
        moved = np.eye(len(VALUES) + 1)[k] * step
        ends = [pulled(VALUES + s * moved[:-1], warming + s * moved[-1] * shift, start)[-1] for s in (1, -1)]
        force = (ends[0].channels[0] - ends[1].channels[0]) / (2.0 * step)
        motion = (ends[0].u - ends[1].u) / (2.0 * step)
        assert exact.dchannels[0, k] == pytest.approx(force, rel=2e-6), directions[k].name
        np.testing.assert_allclose(exact.du[..., k], motion, atol=2e-6 * np.abs(motion).max() + 1e-13)


def test_an_arrhenius_factor_holds_at_the_absolute_temperature():
    law = get_law("elastoplastic(norton+arrhenius*rate_eta)")
    values = np.array([70e3, 0.3, 10.0, 50.0, 1.5, 4000.0, 25.0])
    found = law.temperature.values(values, np.array([25.0, 100.0]))[:, 3]
    np.testing.assert_allclose(found, [50.0, 50.0 * np.exp(4000.0 * (1.0 / 373.15 - 1.0 / 298.15))])


def test_a_body_above_its_melting_point_is_no_body():
    with pytest.raises(NotConverged, match="would be multiplied by"):
        pulled(VALUES, WARMING[:, None] * 4.0 + np.zeros(4))


@pytest.mark.parametrize(("law", "found"), [
    ("elastoplastic(linear*E*E)", "'E'"), ("elastoplastic(linear*Q)", "'Q'"), ("elastoplastic(cubic*E)", "'cubic*E'"),
    ("elastoplastic(linear*temperature_1_slope)", "'temperature_1_slope'")])
def test_a_factor_on_nothing_is_refused(law, found):
    with pytest.raises(InputError) as error:
        get_law(law)
    assert error.value.found == found and error.value.remedy
