"""The answer of a body to smooth errors of its stress."""

import numpy as np
import pytest

from idic.fe.assembly.assembly import points_of
from idic.fe import Alternative, Constraints, Body, Reaction, Section, march, stress_error_responses
from idic.fe.assembly.assembly import discretise, evaluate_system
from idic.fe.body.boundary import drives_at
from idic.laws import compile as compile_law
from idic.virtual_tests import strip_with_hole

GRIP = 0.01  # mm


@pytest.fixture(scope="module")
def pulled():
    """A linear elastic strip with a hole: model, parameters, times, its displacement at the end, and its answer."""
    mesh = strip_with_hole(20.0, 10.0, 2.0, "quad8", 2, 2, 1)
    left, right = mesh.node_sets["LEFT"], mesh.node_sets["RIGHT"]
    dofs = np.concatenate([2 * right, 2 * right + 1, 2 * left, 2 * left + 1])
    basis = np.zeros((len(dofs), 1))
    basis[:len(right)] = 1.0
    model = Body(mesh=mesh, kind="plane_stress", thickness=1.0,
                  sections=(Section("sheet", compile_law("elastic", "small"), mesh.element_sets["sheet"]),),
                  constraints=Constraints(dofs, basis, np.array([[0.0], [GRIP]])), channels=(Reaction(2 * right),))
    params, times = {"sheet": np.array([70000.0, 0.3])}, np.array([0.0, 1.0])
    *_, last = march(model, params, times)
    u = last.u.copy()
    weights = np.column_stack([np.ones(len(mesh.nodes)), mesh.nodes[:, 0], mesh.nodes[:, 1] ** 2])
    answer, = stress_error_responses(Alternative(model, params), times, [u], [1], weights)
    return model, params, times, u, weights, answer


def test_the_force_of_a_stress_error_is_its_work_on_the_strain_of_the_body(pulled):
    """Betti's theorem for the linear body: dF times the grip's motion = integral of dP : grad u."""
    model, params, times, u, weights, answer = pulled
    system = discretise(model)
    at = evaluate_system(system, params, u, system.rest_states(), 1.0, drives_at(model, times, 1.0))
    group, stress = system.groups[0], at.groups[0].P
    gradient = at.groups[0].F - np.eye(2)
    sized = np.linalg.norm(stress, axis=(1, 2)) * group.weights
    fields = points_of(system, group, weights)
    work = [(sized * strain) @ fields for strain in
            (gradient[:, 0, 0], gradient[:, 0, 1] + gradient[:, 1, 0], gradient[:, 1, 1])]
    np.testing.assert_allclose(answer.dchannels[0] * GRIP, np.concatenate(work), rtol=1e-9,
                               atol=1e-12 * np.abs(work).max())  # rounding of a back-substitution


def test_held_nodes_stay_and_the_body_gives_way_to_a_missing_stress(pulled):
    model, _, _, u, _, answer = pulled
    held = np.asarray(model.constraints.dofs)
    assert not answer.du.reshape(-1, answer.du.shape[2])[held].any()
    across = answer.du[:, 1, 6]  # a further tension across, the same all over: the strip becomes narrower
    top = model.mesh.nodes[:, 1] > 4.9
    assert across[top].mean() < 0.0
