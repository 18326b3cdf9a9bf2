"""Extrapolation in time: order of convergence of the laws that depend on time, derivatives, frozen increments."""

from dataclasses import replace

import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from idic.errors import InputError
from idic.fe.extrapolation import for_two, time_order
from idic.fe import (
    Constraints, Direction, Body, Reaction, Section, StepList, increments_to_try, make_mesh,
    march, march_extrapolated, without_time_error,
)
from idic.laws import all_laws, compile as compile_law

TIMES = np.array([0.0, 1.0, 2.0, 3.5, 5.0])
GRIP = np.array([0.0, 0.01, 0.02, 0.02, 0.012])  # pulled, held, let back
LAWS = {
    "creep": {"E": 2000.0, "nu": 0.35, "rate": 1e-3, "n": 2.0, "stress": 20.0},
    "maxwell": {"E": 2000.0, "nu": 0.35, "g_1": 0.3, "tau_1": 1.5, "g_2": 0.2, "tau_2": 8.0, "g_3": 0.0, "tau_3": 0.0},
    "viscoplastic": {"E": 2000.0, "nu": 0.35, "yield_stress": 0.0, "hardening_modulus": 300.0, "eta": 5000.0, "m": 1.0},
}


def bar(name):
    """A square of 1 mm in plane stress, pulled along x: the model and its parameters."""
    nodes = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    mesh = make_mesh(nodes, [("quad4", np.array([[0, 1, 2, 3]]))], element_sets={"B": np.arange(1)})
    law = compile_law(name)
    held = Constraints(np.array([2, 4, 0, 6, 1]), np.array([[1.0], [1.0], [0.0], [0.0], [0.0]]), GRIP[:, None])
    model = Body(mesh=mesh, kind="plane_stress", sections=(Section("B", law, np.arange(1)),), thickness=1.0,
                  constraints=held, channels=(Reaction(np.array([2, 4])),))
    return model, {"B": np.array([LAWS[name][parameter] for parameter in law.spec.parameter_names])}


def force(states):
    return np.array([state.channels[0] for state in states])


@pytest.mark.parametrize("name", ["creep", "maxwell", pytest.param("viscoplastic", marks=pytest.mark.slow)])
def test_extrapolation_is_one_order_above_the_step_of_the_law(name):
    """Where every increment resolves the beginning of reverse flow, which 16 per frame do not yet."""
    model, params = bar(name)
    exact = force(march_extrapolated(model, params, TIMES, increments=512))
    order = all_laws()[name].time_order
    # the part of first order in maxwell, 1e-7 of the force, shows with 64
    numbers = (32, 64) if order == 1 else (16, 32)
    plain = [np.abs(force(march(model, params, TIMES, substeps=n)) - exact).max() for n in numbers]
    ahead = [np.abs(force(march_extrapolated(model, params, TIMES, increments=n)) - exact).max() for n in numbers]
    assert time_order(model) == order
    assert np.log2(plain[0] / plain[1]) == pytest.approx(order, abs=0.15)
    assert ahead[1] < 0.2 * plain[1]
    if order == 1:  # that part hides the third order of maxwell
        assert np.log2(ahead[0] / ahead[1]) == pytest.approx(2.0, abs=0.3)


def test_derivatives_are_extrapolated_exactly():
    model, params = bar("creep")
    states = list(march_extrapolated(model, params, TIMES, (Direction("rate", material=(0, 2)),), increments=4))
    eps = 1e-4 * params["B"][2]
    moved = {"B": params["B"] + eps * np.eye(5)[2]}, {"B": params["B"] - eps * np.eye(5)[2]}
    up, down = (force(march_extrapolated(model, own, TIMES, steps=states[-1].steps)) for own in moved)
    quotient = (up - down) / (2.0 * eps)
    assert np.array([state.dchannels[0, 0]
                     for state in states]) == pytest.approx(quotient, rel=1e-5, abs=1e-5 * np.abs(quotient).max())


def test_steps_of_two_frames_tell_the_error_of_one_increment_per_frame():
    model, params = bar("creep")
    times = np.linspace(0.0, 5.0, 22)  # 21 intervals: the last step of the coarse simulation is one frame
    pulled = replace(model, constraints=replace(model.constraints, histories=0.02 * times[:, None] / times[-1]))
    fine = list(march(pulled, params, times))

    def in_steps(frames, warm_start):
        states = march(pulled.at_frames(frames), params, times[frames], warm_start=warm_start)
        return (replace(state, frame=int(frames[state.frame])) for state in states)

    ahead = list(without_time_error(pulled, len(times), lambda: ((state.u, state.channels) for state in fine),
                                    in_steps))
    exact = force(march_extrapolated(pulled, params, times, increments=64))
    errors = np.array([channels[0] for _, channels in ahead]) - exact
    assert len(ahead) == len(times) and np.array_equal(ahead[-1][0].ravel()[[2, 4]], [0.02, 0.02])
    # a quarter: the next order, with steps of a fifth of the relaxation time; the last step counts as twice its length
    assert np.abs(errors[1:-1]).max() < 0.25 * np.abs(force(fine) - exact).max()


def test_frozen_increments_repeat_the_simulation_to_the_last_bit():
    model, params = bar("viscoplastic")
    first = list(march_extrapolated(model, params, TIMES, increments=6))
    taken = first[-1].steps
    fine, coarse = taken.split()
    assert (len(fine), len(coarse)) == (6 * 4, 3 * 4) and fine[-1] == coarse[-1] == TIMES[-1]
    again = list(march_extrapolated(model, params, TIMES, steps=taken))
    assert np.array_equal([s.u for s in first], [s.u for s in again]) and again[-1].steps == taken
    assert first[-1].u.ravel()[[2, 4]] == pytest.approx([GRIP[-1]] * 2, rel=1e-14)  # prescribed values are met
    assert increments_to_try(model, TIMES, 6, taken.times, extrapolated=True) == [taken.times, None]
    cut = (*fine[:1], 0.25, *fine[1:], *coarse)
    assert len(increments_to_try(model, TIMES, 6, cut, extrapolated=True)) == 3
    with pytest.raises(InputError):
        list(march_extrapolated(model, params, TIMES, steps=StepList((*fine, *coarse[:-1]))))


@pytest.mark.parametrize("name", all_laws())
def test_a_law_depends_on_time_where_its_stress_does(name):
    """What a law says of itself, read from its code, against its stress after a fast and a slow pull and hold."""
    spec = all_laws()[name]
    law = compile_law(name)
    values = spec.defaults()
    differ = []
    F = np.array([[1.08, 0.0, 0.0], [0.0, 0.97, 0.0], [0.0, 0.0, 0.97]])
    for dt in (1e-3, 1e6):
        state, P = np.array(law.initial_state(0)), np.zeros((3, 3))
        for _ in range(3):
            new = state.copy()
            assert law.update(F, state, values, dt, P, new) == 0
            state = new
        differ.append(P.copy())
    assert spec.rate_dependent == bool(np.abs(differ[0] - differ[1]).max() > 1e-9 * np.abs(differ[0]).max())


def test_two_simulations_may_look_ahead_in_threads_of_their_own():
    """`itertools.tee` alone refuses a second thread while a first one makes the next item."""
    def slow():
        for k in range(30):
            time.sleep(1e-3)
            yield k

    first, second = for_two(slow())
    with ThreadPoolExecutor(2) as pool:
        assert [*pool.map(list, (first, second))] == [[*range(30)]] * 2
