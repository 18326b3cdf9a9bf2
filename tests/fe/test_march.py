"""The march through time: frame times, cutting, frozen steps, and refusals that help."""

import threading
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from fe_bodies import PARAMETERS, body, grid, held, last, pressed_ring, quarter_ring, where

from idic.errors import GaveUp, InputError, NotConverged
from idic.fe import (
    Constraints, Control, Direction, Reaction, StepList, constrain, dofs_of, make_mesh, march, nodal_field,
    solver_threads,
)

TIMES = np.array([0.0, 0.3, 1.0, 1.7])


def pulled(law="neo_hookean", kind="plane_strain", history=(0.0, 0.1, 0.5, 0.3), n=3, **more):
    mesh = grid("quad4" if kind != "solid" else "hex8", (n, n) if kind != "solid" else (n, n, 1))
    left, right = (where(mesh, lambda x, *_, s=s: np.abs(x - s) < 1e-9) for s in (0, 1))
    parts = [(left, i, 0.0) for i in range(mesh.n_dim)] + [(right, i, 0.0) for i in range(1, mesh.n_dim)]
    parts.append((right, "x", np.array(history)))
    return body(mesh, kind, law, "finite", held(mesh, parts, len(history)),
                channels=(Reaction(dofs_of(right, "x", mesh.n_dim)),), **more)


def frames(model, law="neo_hookean", times=TIMES, **more):
    return list(march(model, {"BODY": PARAMETERS[law]}, times, **more))


def test_the_first_frame_is_the_undeformed_reference():
    first = frames(pulled())[0]
    assert not first.u.any() and not first.channels.any() and first.time == TIMES[0]


def test_step_cutting_hits_every_frame_time_exactly():
    model = pulled("j2_linear", "plane_stress")
    states = frames(model, "j2_linear", control=Control(max_iterations=3))
    done = np.array(states[-1].steps.times)
    assert len(done) > 6 and set(TIMES[1:]) <= set(done) and (np.diff(done) > 0).all()
    assert [s.time for s in states] == list(TIMES)


def test_a_march_that_fails_again_and_again_between_two_frames_is_given_up():
    """The same run needs cuts that succeed; without any failure allowed it ends at the first of them."""
    model = pulled("j2_linear", "plane_stress")
    with pytest.raises(NotConverged, match="no equilibrium beyond"):
        frames(model, "j2_linear", control=Control(max_iterations=3, most_failures=0))


def test_a_march_that_takes_more_evaluations_than_its_caller_allows_is_given_up():
    """Failed increments count: what converges is not enough to see a march that crawls."""
    model, cut = pulled("j2_linear", "plane_stress"), Control(max_iterations=3)
    whole = frames(model, "j2_linear", control=replace(cut, most_evaluations=100))
    assert whole[-1].steps == frames(model, "j2_linear", control=cut)[-1].steps
    converged = sum(state.n_newton for state in whole) / (len(TIMES) - 1)
    with pytest.raises(GaveUp, match=r"given up at .* evaluations of the body"):
        frames(model, "j2_linear", control=replace(cut, most_evaluations=int(converged) + 1))


@pytest.mark.parametrize("control", [Control(), Control(max_iterations=3), Control(max_iterations=3, most_failures=0)])
def test_increments_solved_ahead_in_a_second_thread_give_the_same_bits_and_the_same_failure(control):
    model, wanted = pulled("j2_linear", "plane_stress"), [Direction("yield_stress", material=(0, 2))]

    def run():
        found = []
        try:
            for state in march(model, {"BODY": PARAMETERS["j2_linear"]}, TIMES, wanted, control=control):
                found.append((state.u, state.du, state.channels, state.dchannels, state.steps.times, state.n_newton))
        except NotConverged as problem:
            found.append((str(problem),))
        return found

    alone = run()
    with solver_threads(2):
        ahead = run()
    assert len(alone) > 1 and len(alone) == len(ahead)
    for one, other in zip(alone, ahead, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def test_a_march_that_is_left_early_leaves_no_thread():
    before = threading.active_count()
    with solver_threads(2):
        states = march(pulled(), {"BODY": PARAMETERS["neo_hookean"]}, TIMES, [Direction("a", material=(0, 0))])
        next(states), next(states)
        assert threading.active_count() > before  # the next increment is ahead
        states.close()
    assert threading.active_count() == before


def test_substeps_do_not_change_a_path_independent_answer():
    once, many = frames(pulled()), frames(pulled(), substeps=4)
    assert len(many[-1].steps.times) == 12
    for a, b in zip(once, many, strict=True):
        assert np.abs(a.u - b.u).max() < 1e-8  # the solver's tolerance


def test_frozen_steps_repeat_a_run_to_the_last_bit():
    model = pulled("j2_linear", "plane_stress")
    reference = frames(model, "j2_linear", control=Control(max_iterations=4))
    again = frames(model, "j2_linear", steps=reference[-1].steps)
    assert again[-1].steps == reference[-1].steps
    fixed = frames(model, "j2_linear", steps=reference[-1].steps)
    assert (fixed[-1].u == again[-1].u).all()
    assert np.abs(fixed[-1].u - reference[-1].u).max() < 1e-8  # another Newton path, the same increments


def test_frozen_steps_must_hit_the_frames():
    with pytest.raises(InputError, match="frame"):
        frames(pulled(), steps=StepList((0.3, 1.0)))


def test_histories_of_the_same_frames_do_not_depend_on_requested_derivatives():
    model = pulled("j2_linear", "solid", n=2)
    plain = frames(model, "j2_linear")
    with_derivatives = frames(model, "j2_linear", directions=(Direction("E", material=(0, 0)),))
    assert all((a.u == b.u).all() for a, b in zip(plain, with_derivatives, strict=True))


def test_a_hopeless_increment_ends_with_the_time_reached_and_no_nan():
    model = pulled(history=(0.0, 0.1, -1.5, 0.0))
    reached = []
    with pytest.raises(NotConverged, match="no equilibrium beyond") as stop:
        for frame in march(model, {"BODY": PARAMETERS["neo_hookean"]}, TIMES):
            reached.append(frame)
    assert len(reached) == 2 and np.isfinite(reached[-1].u).all()
    assert 0.3 <= stop.value.time < 1.0 and stop.value.frame == 2


def test_frozen_steps_are_never_cut():
    model = pulled(history=(0.0, 0.1, -0.999, 0.0))
    with pytest.raises(NotConverged, match="fixed increments"):
        frames(model, steps=StepList(tuple(TIMES[1:])))


def test_frozen_steps_are_halved_where_they_may_be_and_need_it():
    """Few Newton iterations stand for a start that is far: the increments of a warm start are too long."""
    model, given = pulled("j2_linear", "plane_stress"), StepList(tuple(TIMES[1:]))
    few = Control(max_iterations=3)
    with pytest.raises(NotConverged, match="fixed increments"):
        frames(model, "j2_linear", steps=given, control=few)
    states = frames(model, "j2_linear", steps=given, control=few, may_cut=True)
    assert [s.time for s in states] == list(TIMES)
    done = np.array(states[-1].steps.times)
    assert set(TIMES[1:]) < set(done)
    exact = frames(model, "j2_linear", steps=states[-1].steps)
    assert np.abs(exact[-1].u - states[-1].u).max() < 1e-8
    easy = frames(model, "j2_linear", steps=given, may_cut=True)
    assert easy[-1].steps == given  # no cut where none is needed
    hopeless = pulled(history=(0.0, 0.1, -1.5, 0.0))
    with pytest.raises(NotConverged, match="down to increments"):
        frames(hopeless, steps=given, may_cut=True)


def test_reactions_balance_the_pressure_on_the_ring():
    mesh = quarter_ring("quad8", 3)
    model = pressed_ring(mesh, "plane_strain", "neo_hookean", "finite", pressure=5.0, n_frames=3, thickness=0.4)
    left = where(mesh, lambda x, y: np.abs(x) < 1e-9)
    model = replace(model, channels=(Reaction(dofs_of(left, "x", 2)),))
    frame = last(model, PARAMETERS["neo_hookean"], np.arange(3.0))
    inner = where(mesh, lambda x, y: (np.abs(y) < 1e-9) | (np.hypot(x, y) < 1 + 1e-6))
    radius = (mesh.nodes + frame.u)[inner][:, 1].max()
    # the pressure acts on the projection radius x thickness
    assert frame.channels[0] == pytest.approx(-5.0 * 0.4 * radius, rel=1e-6)


def test_a_hold_and_an_unloading_are_solved():
    model = pulled("j2_linear", "plane_strain", history=(0.0, 0.02, 0.02, 0.0))
    states = frames(model, "j2_linear")
    assert states[2].channels[0] == pytest.approx(states[1].channels[0], rel=1e-6)
    assert states[3].channels[0] < 0 < states[2].channels[0]
    assert (nodal_field(model, states[3], "plastic_strain") >= nodal_field(model, states[1], "plastic_strain")).all()


def test_two_materials_in_one_mesh_share_the_load():
    model = pulled("elastic")
    halves = (np.array([0, 1, 2, 3, 4]), np.array([5, 6, 7, 8]))
    two = replace(model, sections=tuple(replace(model.sections[0], name=name, elements=part)
                                        for name, part in zip("AB", halves, strict=True)))
    same = frames(model, "elastic")[-1]
    params = {"A": PARAMETERS["elastic"], "B": PARAMETERS["elastic"]}
    assert np.abs(list(march(two, params, TIMES))[-1].u - same.u).max() < 1e-12  # other order of summation


def test_nodes_of_no_element_stay_where_they_are():
    mesh = grid("quad4", (2, 2))
    extra = make_mesh(np.vstack([mesh.nodes, [[5.0, 5.0]]]), [("quad4", mesh.blocks[0].connectivity)])
    left, right = where(extra, lambda x, y: x < 1e-9), where(extra, lambda x, y: np.abs(x - 1) < 1e-9)
    model = body(extra, "plane_stress", constraints=held(extra, [(left, "x", 0.0), (left, "y", 0.0),
                                                                 (right, "x", [0.0, 0.1])]))
    frame = last(model, PARAMETERS["elastic"])
    assert not frame.u[-1].any() and frame.u[right, 0] == pytest.approx(0.1)
    assert np.isnan(nodal_field(model, frame, "strain")[-1]).all()


def test_full_integration_of_quad8_is_an_option_and_a_little_stiffer():
    mesh = grid("quad8", (2, 2))
    left, right = where(mesh, lambda x, y: x < 1e-9), where(mesh, lambda x, y: x > 1 - 1e-9)
    parts = [(left, "x", 0.0), (left, "y", 0.0), (right, "y", 0.0), (right, "x", [0.0, 0.1])]
    model = body(mesh, "plane_strain", constraints=held(mesh, parts), channels=(Reaction(dofs_of(right, "x", 2)),))
    full_model = replace(model, quadrature={"quad8": 3})
    reduced, full = (last(m, PARAMETERS["elastic"]).channels[0] for m in (model, full_model))
    assert reduced < full < 1.05 * reduced


def test_memory_does_not_grow_with_the_number_of_frames():
    model = pulled("j2_linear", "plane_stress", history=np.linspace(0, 0.05, 41), n=6)
    tracemalloc.start()
    sizes = []
    for frame in march(model, {"BODY": PARAMETERS["j2_linear"]}, np.arange(41.0), (Direction("E", material=(0, 0)),)):
        sizes.append(tracemalloc.get_traced_memory()[0])
        assert frame.u.shape == (49, 2)
    tracemalloc.stop()
    one_frame = 36 * 4 * (8 * 2 + 4 * 3) * 8  # state and its derivative, F, P, A per point, in bytes
    assert sizes[-1] - sizes[10] < one_frame  # thirty frames later: less than one more frame


# refusals -----------------------------------------------------------------------------------------
def refusal(model, times=(0.0, 1.0), params=PARAMETERS["elastic"]):
    with pytest.raises(InputError) as stop:
        march(model, {"BODY": params}, np.asarray(times))
    return str(stop.value)


def square(parts, **more):
    mesh = grid("quad4", (2, 2))
    nodes = {"left": where(mesh, lambda x, y: x < 1e-9), "corner": where(mesh, lambda x, y: x + y < 1e-9)}
    return body(mesh, more.pop("kind", "plane_stress"), more.pop("law", "elastic"),
                constraints=held(mesh, [(nodes[n], c, h) for n, c, h in parts]), **more)


def test_a_body_that_can_move_rigidly_is_refused_and_the_free_motion_is_named():
    assert "translation along y" in refusal(square([("left", "x", 0.0)]))
    assert "rotation" in refusal(square([("corner", "x", 0.0), ("corner", "y", 0.0)]))
    text = refusal(square([]))
    assert "rigid motion not prevented" in text and "translation along x" in text
    cube = grid("hex8", (1, 1, 1))
    edge = where(cube, lambda x, y, z: x + y < 1e-9)
    hinge = held(cube, [(edge, i, 0.0) for i in range(3)])
    assert "rotation about z" in refusal(body(cube, "solid", constraints=hinge))


def test_a_loose_second_piece_is_refused():
    a = grid("quad4", (1, 1))
    both = make_mesh(np.vstack([a.nodes, a.nodes + 3]), [("quad4", np.vstack([a.blocks[0].connectivity,
                                                                              a.blocks[0].connectivity + 4]))])
    model = body(both, "plane_stress", constraints=held(both, [(np.arange(4), i, 0.0) for i in range(2)]))
    assert "node 5" in refusal(model)


def test_inconsistent_input_is_refused_with_a_remedy():
    good = [("left", "x", 0.0), ("left", "y", 0.0)]
    assert "plane stress does not lock" in refusal(square(good, locking="mean_dilatation"))
    assert "thickness" in refusal(square(good, thickness=0.0))
    held_cube = Constraints(np.arange(9), np.zeros((9, 0)), np.zeros((2, 0)))
    assert "2D" in refusal(body(grid("hex8", (1, 1, 1)), "plane_stress", constraints=held_cube))
    assert "twice" in refusal(square([("left", "x", [0, 1.0]), ("left", "x", [0, 1.0]), ("left", "y", 0.0)]))
    assert "first frame" in refusal(square([*good[1:], ("left", "x", [0.5, 1.0])]))
    assert "not a number" in refusal(square([*good[1:], ("left", "x", [0.0, np.nan])]))
    assert "increase" in refusal(square(good), times=(0.0, 0.0))
    assert "E, nu" in refusal(square(good), params=np.array([1.0]))
    model = square(good)
    partly = replace(model, sections=(replace(model.sections[0], elements=np.array([0, 1])),))
    assert "no material" in refusal(partly)


def test_a_dof_held_at_rest_twice_is_kept_once():
    parts = [(dofs_of(np.array([0, 1]), "x", 2), np.zeros((2, 0)), np.zeros((2, 0))),
             (dofs_of(np.array([1, 2]), "x", 2), np.zeros((2, 0)), np.zeros((2, 0)))]
    assert list(constrain(parts, 2).dofs) == [0, 2, 4]


@pytest.mark.parametrize("away", [1e-3, 0.5], ids=["near", "far"])
def test_a_warm_start_saves_iterations_and_changes_nothing(away):
    model = pulled("j2_linear", history=(0.0, 0.02, 0.05, 0.03))
    values = PARAMETERS["j2_linear"]
    other = [state.u for state in march(model, {"BODY": np.asarray(values) * (1.0 + away)}, TIMES)]
    plain, led = frames(model, "j2_linear"), frames(model, "j2_linear", warm_start=other)
    for one, two in zip(plain, led, strict=True):
        np.testing.assert_allclose(two.u, one.u, rtol=0, atol=1e-9)  # the tolerance of equilibrium, as a displacement
    assert led[-1].steps == plain[-1].steps
    if away < 0.01:
        assert sum(state.n_newton for state in led) < sum(state.n_newton for state in plain)
