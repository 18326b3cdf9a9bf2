"""The compiled kernels against slow NumPy twins, and the element matrices against difference quotients."""

import numpy as np
import pytest
from fe_bodies import PARAMETERS, body, faces_where, grid, held, skewed, where

from idic.fe.solver import linear, storage
from idic.fe.assembly import kernels
from idic.fe.assembly.assembly import stiffness_values
from idic.fe import Loads
from idic.fe.assembly.assembly import discretise, evaluate_system, stiffness_times
from idic.fe.body.boundary import Drives, at_time, pressure_faces, pressure_force, pressure_stiffness

KINDS = [("tri3", "plane_stress"), ("quad4", "plane_strain"), ("quad8", "plane_strain"), ("hex8", "solid"),
         ("tet10", "solid")]


def moved_body(cell, kind, law, kinematics, **more):
    mesh = grid(cell, (2, 2) if kind != "solid" else (2, 1, 1), mapping=skewed)
    base = where(mesh, lambda x, *_: x < 1e-9)
    parts = [(base, i, 0.0) for i in range(mesh.n_dim)]
    top = faces_where(mesh, lambda x, y, *_: y > 1 - 1e-9)
    model = body(mesh, kind, law, kinematics, held(mesh, parts), thickness=0.6,
                 loads=Loads(pressure_faces=(top,), pressure_histories=np.array([[0.0], [2.0]])), **more)
    u = 0.03 * np.random.default_rng(3).standard_normal(mesh.nodes.shape)
    return discretise(model), u


@pytest.mark.parametrize("cell, kind", KINDS)
def test_kernels_agree_with_numpy(cell, kind):
    system, u = moved_body(cell, kind, "elastic", "small")
    group, rng = system.groups[0], np.random.default_rng(0)
    n, d = group.n_points, system.n_dim
    owner = np.repeat(np.arange(len(group.elements)), group.points_per_element)
    nodes = group.connectivity[owner]
    F = np.empty((n, d, d))
    smallest = kernels.deformation_gradients(group.connectivity, group.grads, u, F)
    assert np.allclose(F, np.eye(d) + np.einsum("pai,paj->pij", u[nodes], group.grads))
    assert smallest == pytest.approx(np.linalg.det(F).min())
    P, force = rng.random((n, d, d)), np.zeros_like(u)
    kernels.add_internal_forces(group.connectivity, group.grads, group.weights, P, force)
    slow = np.zeros_like(u)
    np.add.at(slow, nodes, np.einsum("p,pij,paj->pai", group.weights, P, group.grads))
    assert np.allclose(force, slow)
    A = rng.random((n, d * d, d * d))
    Ke, m = np.empty((*group.dofs.shape, group.dofs.shape[1])), group.dofs.shape[1]
    kernels.element_stiffness(group.grads, group.weights, A, Ke)
    slow = np.einsum("p,paj,pijkl,pbl->paibk", group.weights, group.grads, A.reshape(n, d, d, d, d), group.grads)
    assert np.allclose(Ke, slow.reshape(len(Ke), -1, m, m).sum(axis=1))
    fields, out = rng.random((u.size, 2)), np.zeros((u.size, 2))
    kernels.add_stiffness_times(Ke, group.dofs, fields, out)
    slow = np.zeros_like(out)
    np.add.at(slow, group.dofs, np.einsum("eij,ejk->eik", Ke, fields[group.dofs]))
    assert np.allclose(out, slow)


@pytest.mark.parametrize("law, kinematics", [("elastic", "small"), ("neo_hookean", "finite"), ("j2_linear", "finite")])
@pytest.mark.parametrize("cell, kind", KINDS)
@pytest.mark.parametrize("locking", ["none", "mean_dilatation"])
def test_the_stiffness_is_the_derivative_of_the_residual(cell, kind, law, kinematics, locking):
    """With mean dilatation, follower pressure and plasticity: Newton is quadratic only if this holds."""
    if kind == "plane_stress" and locking != "none":
        pytest.skip("plane stress does not lock")
    system, u = moved_body(cell, kind, law, kinematics, locking=locking)
    params, states = {"BODY": PARAMETERS[law]}, system.rest_states()
    drives = Drives(1.0, np.zeros(0), np.zeros(0), np.array([2.0]))

    def residual(x, stiffness=False):
        return evaluate_system(system, params, x, states, 1.0, drives, stiffness=stiffness)

    change, h = np.random.default_rng(5).standard_normal(u.shape), 1e-6
    quotient = (residual(u + h * change).residual - residual(u - h * change).residual) / (2 * h)
    exact = stiffness_times(system, residual(u, True), change.reshape(-1, 1)).reshape(u.shape)
    assert np.abs(quotient - exact).max() < 1e-7 * np.abs(exact).max()  # h² and rounding / h, both near 1e-9


@pytest.mark.parametrize("cell", ["quad4", "quad8", "hex8", "hex20", "tet4", "tet10"])
def test_the_load_stiffness_of_follower_pressure_meets_the_difference_quotient(cell):
    system, u = moved_body(cell, "plane_strain" if cell.startswith("quad") else "solid", "elastic", "finite")
    faces, x, h = system.pressures[0], system.body.mesh.nodes + u, 1e-6
    change = np.random.default_rng(2).standard_normal(u.shape)
    quotient = (pressure_force(faces, x + h * change) - pressure_force(faces, x - h * change)) / (2 * h)
    exact = np.einsum("eij,ej->ei", pressure_stiffness(faces, x), change.ravel()[faces.dofs])
    assert np.abs(quotient.reshape(exact.shape) - exact).max() < 1e-8  # rounding / h
    assert pressure_faces(system.body)[0].nodes.shape[1] == {"quad4": 2, "quad8": 3, "hex8": 4, "hex20": 8, "tet4": 3,
                                                              "tet10": 6}[cell]


def test_a_closed_surface_under_pressure_feels_no_net_force():
    for cell in ("quad8", "hex8"):
        mesh = grid(cell, (2, 2) if cell == "quad8" else (2, 2, 2), mapping=skewed)
        faces = faces_where(mesh, lambda *x: x[0] < np.inf)
        model = body(mesh, "plane_strain" if cell == "quad8" else "solid", loads=Loads(
            pressure_faces=(faces,), pressure_histories=np.ones((2, 1))), constraints=held(mesh, [([0], 0, 0.0)]))
        x = mesh.nodes + 0.05 * np.random.default_rng(0).standard_normal(mesh.nodes.shape)
        force = sum(pressure_force(p, x).sum(axis=(0, 1)) for p in pressure_faces(model))
        assert np.abs(force).max() < 1e-13  # rounding of unit forces


@pytest.mark.parametrize("cell, n", [("quad4", (5, 4)), ("hex8", (3, 2, 2))])
def test_small_fronts_and_those_of_lapack_solve_the_same_system(cell, n, monkeypatch):
    mesh = grid(cell, n)
    model = body(mesh, "solid" if cell == "hex8" else "plane_strain", "elastic", "small",
                 held(mesh, [(where(mesh, lambda x, *_: x < 1e-9), i, 0.0) for i in range(mesh.n_dim)]))
    system = discretise(model)
    drives = Drives(1.0, np.zeros(0), np.zeros(0), np.zeros(0))
    ev = evaluate_system(system, {"BODY": PARAMETERS["elastic"]}, np.zeros_like(mesh.nodes), system.rest_states(), 1.0,
                           drives)
    dofs = [g.dofs for g in system.groups]
    solutions, rhs = [], np.random.default_rng(0).random((system.pattern.n, 3))
    for least in (np.inf, 0):
        monkeypatch.setattr(linear, "MIN_OPERATIONS_PER_ENTRY", least)
        pattern = linear.make_pattern(mesh.nodes, dofs, model.constraints.dofs)
        values = np.zeros(pattern.n_stored)
        stiffness_values(system, ev)
        storage.scatter(ev.groups[0].Ke, pattern.positions(dofs[0]), values)
        full = np.zeros((model.n_dof, 3))
        factor = linear.factorise(pattern, values, kind=linear.FactorKind.LU)
        full[pattern.dofs] = factor.solve(rhs[system.pattern.equation[pattern.dofs]])
        solutions.append(full)
    assert np.allclose(*solutions, rtol=1e-9)


def test_a_singular_matrix_is_reported():
    pattern = linear.make_pattern(np.eye(2), [np.array([[0, 1, 2, 3]])], np.zeros(0, dtype=int))
    with pytest.raises(linear.SingularMatrix):
        linear.factorise(pattern, np.zeros(pattern.n_stored))


def test_histories_are_linear_between_frames_and_exact_at_them():
    times, table = np.array([0.0, 0.1, 0.3, 0.7]), np.array([[9.0], [0.1], [0.3], [-0.7]])
    assert at_time(table, times, 0.0)[0] == 0.0  # the reference is unloaded whatever the log says
    assert all(at_time(table, times, t)[0] == row for t, row in zip(times[1:], table[1:, 0], strict=True))
    assert at_time(table, times, 0.05)[0] == pytest.approx(0.05)
    assert at_time(table, times, 0.5)[0] == pytest.approx(-0.2)


@pytest.mark.parametrize("exchanges", [False, True])
@pytest.mark.parametrize("n_nodes", [1, 6, 13])
def test_a_small_front_solves_with_and_without_row_exchanges(exchanges, n_nodes):
    rng, n = np.random.default_rng(1), 2 * n_nodes
    matrix = rng.uniform(0.5, 1.0, (n, n)) + np.diag(np.full(n, 0.0 if exchanges else 3.0 * n))
    matrix[np.diag_indices(n)] *= 0.01 if exchanges else 1.0
    points = np.column_stack([np.arange(n_nodes), np.zeros(n_nodes)])
    pattern = linear.make_pattern(points, [np.arange(n)[None]], np.zeros(0, dtype=int))
    values, rhs = np.zeros(pattern.n_stored), rng.random((n, 2))
    storage.scatter(matrix[None], pattern.positions(np.arange(n)[None]), values)
    factor = linear.factorise(pattern, values)
    assert (factor.lu.exchanges != np.arange(n)).any() == exchanges
    equations, solution = pattern.equation, np.empty((n, 2))
    solution = factor.solve(rhs[np.argsort(equations)])[equations]
    np.testing.assert_allclose(matrix @ solution, rhs, atol=1e-10)  # condition up to 1e4 times rounding
    solution = factor.solve_transposed(rhs[np.argsort(equations)])[equations]
    np.testing.assert_allclose(matrix.T @ solution, rhs, atol=1e-10)
