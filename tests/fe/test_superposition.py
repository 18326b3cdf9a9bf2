"""Long tests of linear bodies as sums of unit answers: the frames of the march."""

from dataclasses import replace

import numpy as np
import pytest

from idic.fe import Direction, Loads, Reaction, StepList, march, superposed, traction
from fe_bodies import PARAMETERS, SHARP, body, faces_where, grid, held, where

N_FRAMES = 12
FIELDS = ("u", "channels", "du", "dchannels", "local_du", "local_dchannels", "rise", "d_rise")


@pytest.fixture(scope="module")
def pulled():
    """A sheet under two motions, a traction and a force that take turns; its model and its directions."""
    mesh, rng = grid("quad8", (3, 2)), np.random.default_rng(5)
    courses = np.vstack([np.zeros(4), rng.normal(0.0, 0.02, (N_FRAMES - 1, 4))])
    top, right = (where(mesh, lambda x, y: y > 0.999), where(mesh, lambda x, y: (x > 0.999) & (y < 0.999)))
    parts = [(where(mesh, lambda x, y: y < 0.001), "x", 0.0), (where(mesh, lambda x, y: y < 0.001), "y", 0.0),
             (top, "y", courses[:, 0]), (top, "x", courses[:, 1])]
    point = np.zeros(mesh.nodes.size)
    point[2 * right[0]] = 1.0
    dead = np.column_stack([traction(mesh, faces_where(mesh, lambda x, y: x > 0.999), [1.0, 0.3]), point])
    model = body(mesh, "plane_stress", "elastic", None, held(mesh, parts, N_FRAMES), thickness=1.5, surface_side=1,
                 loads=Loads(dead=dead, dead_histories=courses[:, 2:]), channels=(Reaction(2 * top + 1, 2.0),),
                 local_drives=(0, 1), local_loads=(0,))
    moved = np.vstack([np.zeros(2), rng.normal(size=(N_FRAMES - 1, 2))])
    directions = (Direction("E", material=(0, 0)), Direction("nu", material=(0, 1)),
                  Direction("slip", d_histories=moved, d_loads=moved[:, ::-1]),
                  Direction("t", thickness=True, d_loads=moved))
    return model, directions


def test_every_frame_is_that_of_the_march(pulled):
    """1e-10 of the largest value: the march ends at 1e-12 of the largest force."""
    model, directions = pulled
    params, times = {"BODY": PARAMETERS["elastic"]}, np.cumsum(np.arange(1.0, N_FRAMES + 1.0))
    ours = list(superposed(model, params, times, directions, substeps=2, control=SHARP))
    theirs = list(march(model, params, times, directions, substeps=2, control=SHARP))
    assert len(ours) == len(theirs) == N_FRAMES
    for name in FIELDS:
        largest = max(np.abs(getattr(state, name)).max() for state in theirs)
        for one, other in zip(ours, theirs, strict=True):
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=0.0, atol=1e-10 * largest)
    for one, other in zip(ours, theirs, strict=True):
        assert (one.frame, one.time) == (other.frame, other.time)
        np.testing.assert_allclose(one.steps.times, other.steps.times, rtol=1e-14)
        for here, there in zip(one.points, other.points, strict=True):
            np.testing.assert_array_equal(here.elements, there.elements)
            np.testing.assert_allclose(here.P, there.P, rtol=0.0, atol=1e-10 * PARAMETERS["elastic"][0])
            np.testing.assert_allclose(here.state, there.state, rtol=1e-12)


def test_given_increments_are_told_as_given_and_no_direction_is_no_trouble(pulled):
    model, _ = pulled
    times = np.arange(float(N_FRAMES))
    given = StepList(tuple(np.sort(np.append(times[1:], 0.25)).tolist()))
    found = list(superposed(model, {"BODY": PARAMETERS["elastic"]}, times, (), given))
    assert found[-1].steps == given
    assert found[0].steps == StepList() and found[1].steps == StepList((0.25, 1.0))
    assert found[3].du.shape == (*model.mesh.nodes.shape, 0)


@pytest.mark.parametrize("change", ["law", "temperature", "frames"])
def test_no_sum_where_it_is_none_or_not_cheaper(pulled, change):
    model, params, times = pulled[0], {"BODY": PARAMETERS["elastic"]}, np.arange(float(N_FRAMES))
    if change == "law":
        sections = body(model.mesh, "plane_stress", "j2_linear").sections
        model, params = replace(model, sections=sections), {"BODY": PARAMETERS["j2_linear"]}
    elif change == "temperature":
        model = replace(model, temperature=np.zeros((N_FRAMES, model.mesh.n_nodes)))
    else:  # as many units as frames
        times = times[:5]
        constraints = replace(model.constraints, histories=model.constraints.histories[:5])
        loads = replace(model.loads, dead_histories=model.loads.dead_histories[:5])
        model = replace(model, constraints=constraints, loads=loads)
    assert superposed(model, params, times) is None
