"""Plane stress: the seen surface moves out of its plane by half of the thickness change; exact, with derivatives."""

from dataclasses import replace

import numpy as np
import pytest

from idic.fe import Constraints, Direction, Body, Section, march
from idic.laws import compile as compile_law
from idic.virtual_tests import strip_with_hole

MESH = strip_with_hole(20.0, 12.0, 2.5, "quad8", 2, 2, 1)
TIMES = np.array([0.0, 1.0, 2.0, 3.0])
PULL = np.array([0.0, 0.02, 0.06, 0.15])


def model(law, kinematics=None, side=1):
    left, right = MESH.node_sets["LEFT"], MESH.node_sets["RIGHT"]
    middle = left[np.argmin(np.abs(MESH.nodes[left, 1]))]
    dofs = np.concatenate([2 * right, 2 * left, [2 * middle + 1]])
    basis = np.zeros((len(dofs), 1))
    basis[:len(right)] = 1.0
    return Body(mesh=MESH, kind="plane_stress", thickness=2.0, surface_side=side,
                 sections=(Section("sheet", compile_law(law, kinematics), MESH.element_sets["sheet"]),),
                 constraints=Constraints(dofs, basis, PULL[:, None]))


def last(made, values, directions=()):
    *_, state = march(made, {"sheet": np.asarray(values, float)}, TIMES, directions, substeps=2)  # where Newton is sure
    return state


def test_of_an_elastic_sheet_it_is_that_of_poissons_ratio():
    """Small strain: e33 = -nu/(1 - nu) (e11 + e22) at every point, so the mean over the sheet follows from its
    edges."""
    state = last(model("elastic", "small"), [70e3, 0.3])
    for values in state.points:
        trace = values.F[:, 0, 0] + values.F[:, 1, 1] - 2.0
        np.testing.assert_allclose(values.state[:, -1] - 1.0, -0.3 / 0.7 * trace, atol=1e-12)
    assert state.rise.min() < 0.0  # it thins: away from a camera on +z
    assert np.abs(state.rise + last(model("elastic", "small", side=-1), [70e3, 0.3]).rise).max() == 0.0
    assert last(model("elastic", "small", side=0), [70e3, 0.3]).rise is None


@pytest.mark.parametrize("law, values", [("elastic", [70e3, 0.3]), ("neo_hookean", [20.0, 500.0]),
                                         ("j2_linear", [70e3, 0.3, 200.0, 1500.0])])
def test_derivatives_are_difference_quotients(law, values):
    made = model(law)
    directions = [Direction(f"p{k}", material=(0, k)) for k in range(len(values))]
    directions += [Direction("pull", d_histories=np.linspace(0.0, 1.0, 4)[:, None]), Direction("t", thickness=True)]
    state = last(made, values, directions)
    steps = state.steps
    for k, direction in enumerate(directions):
        ends = []
        for sign in (1, -1):
            changed, own = made, np.array(values, float)
            if direction.material is not None:
                step = 1e-4 * own[k]
                own[k] += sign * step
            elif direction.thickness:
                step = 1e-4
                changed = replace(made, thickness=2.0 + sign * step)
            else:
                step = 1e-5
                histories = made.constraints.histories + sign * step * direction.d_histories
                changed = replace(made, constraints=replace(made.constraints, histories=histories))
            *_, end = march(changed, {"sheet": own}, TIMES, steps=steps)
            ends.append(end.rise)
        quotient = (ends[0] - ends[1]) / (2 * step)
        # Newton's remainder of 1e-9 mm over the step, and the step squared; a few points cross the yield surface
        assert np.abs(state.d_rise[:, k] - quotient).max() < 2e-3 * np.abs(quotient).max() + 1e-9, direction.name
