"""Uniform deformation must be reproduced exactly by every cell, on a distorted mesh; rotations must cost no stress."""

import numpy as np
import pytest
from fe_bodies import PARAMETERS, affine_constraints, body, faces_where, grid, held, last, outer_nodes, skewed
from fe_bodies import straight_sided, where

from idic.fe import Loads, Reaction, cell_type, dofs_of, face_area, nodal_deformation, nodal_field, traction

CASES = [(cell, kind) for cell in ("tri3", "tri6", "quad4", "quad8") for kind in ("plane_stress", "plane_strain")]
CASES += [(cell, "solid") for cell in ("tet4", "tet10", "hex8", "hex20")]
LAWS = [("elastic", "small"), ("elastic", "finite"), ("neo_hookean", "finite")]
ROUNDING = 1e-9  # of a displacement of 0.1: the solver stops at 1e-8 of the force after quadratic convergence


def patch(cell):
    n = (2, 2, 2) if cell_type(cell).dim == 3 else (2, 3)
    return straight_sided(grid(cell, n, mapping=skewed))


@pytest.mark.parametrize("law, kinematics", LAWS)
@pytest.mark.parametrize("cell, kind", CASES)
def test_a_uniform_gradient_on_the_boundary_gives_a_uniform_gradient_inside(cell, kind, law, kinematics):
    mesh = patch(cell)
    H = np.array([[0.08, 0.05, -0.02], [-0.03, -0.04, 0.06], [0.01, 0.02, 0.05]])[: mesh.n_dim, : mesh.n_dim]
    model = body(mesh, kind, law, kinematics, affine_constraints(mesh, outer_nodes(mesh), H))
    frame = last(model, PARAMETERS[law])
    assert np.abs(frame.u - mesh.nodes @ H.T).max() < ROUNDING
    assert np.abs(nodal_field(model, frame, "F") - (np.eye(mesh.n_dim) + H)).max() < 10 * ROUNDING
    assert np.abs(nodal_deformation(mesh, frame.u) - (np.eye(mesh.n_dim) + H)).max() < 10 * ROUNDING
    stress = nodal_field(model, frame, "stress")
    assert np.abs(stress - stress[0]).max() < 1e-7 * np.abs(stress).max()  # stress carries ROUNDING / size


def test_a_node_without_a_value_leaves_no_deformation_at_the_nodes_of_its_elements():
    mesh = grid("quad4", (3, 2))
    u = np.zeros(mesh.nodes.shape)
    u[0] = np.nan
    connectivity = mesh.blocks[0].connectivity
    affected = np.unique(connectivity[(connectivity == 0).any(axis=1)])
    assert set(np.flatnonzero(np.isnan(nodal_deformation(mesh, u)).any(axis=(1, 2)))) == set(affected)


@pytest.mark.parametrize("cell, kind", CASES)
def test_a_rigid_rotation_by_60_degrees_leaves_no_stress_at_finite_strain(cell, kind):
    mesh, angle = patch(cell), np.pi / 3
    R = np.eye(mesh.n_dim)
    R[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    rigid = PARAMETERS | {"j2_linear": [200.0, 0.3, 1e6, 10.0]}  # elastic: half-way, a cut step is a true deformation
    for law in ("elastic", "neo_hookean", "j2_linear"):
        model = body(mesh, kind, law, "finite", affine_constraints(mesh, outer_nodes(mesh), R - np.eye(mesh.n_dim)))
        frame = last(model, rigid[law])
        assert np.abs(frame.u - mesh.nodes @ (R - np.eye(mesh.n_dim)).T).max() < 1e-8
        # stress rounding: stiffness times the rounding of F
        assert np.abs(nodal_field(model, frame, "stress")).max() < 1e-8 * PARAMETERS[law].max()


@pytest.mark.parametrize("cell, kind", CASES)
def test_a_uniform_traction_gives_uniaxial_stress_and_reactions_balance_it(cell, kind):
    mesh, E, nu, thickness, pull = patch(cell), 200.0, 0.3, 0.7, 3.0
    right = faces_where(mesh, lambda x, *_: np.abs(x - 1) < 1e-9)
    left = where(mesh, lambda x, *_: np.abs(x) < 1e-9)
    origin = where(mesh, lambda *x: np.linalg.norm(x, axis=0) < 1e-9)
    parts = [(left, "x", 0.0), (origin, "y", 0.0)]
    if mesh.n_dim == 3:
        parts += [(where(mesh, lambda x, y, z: np.abs(z) < 1e-9), "z", 0.0)]
    force = traction(mesh, right, np.eye(mesh.n_dim)[0], thickness)[:, None]
    model = body(mesh, kind, "elastic", "small", held(mesh, parts), thickness=thickness,
                 loads=Loads(dead=force, dead_histories=np.array([[0.0], [pull]])),
                 channels=(Reaction(dofs_of(left, "x", mesh.n_dim), factor=-2.0),))
    frame = last(model, [E, nu])
    modulus = E / (1 - nu**2) if kind == "plane_strain" else E
    assert np.allclose(frame.u[:, 0], pull / modulus * mesh.nodes[:, 0], atol=1e-12)
    depth = thickness if mesh.n_dim == 2 else 1.0
    assert face_area(mesh, right, thickness) == pytest.approx(depth)
    assert frame.channels[0] == pytest.approx(2.0 * pull * depth, rel=1e-10)
    target = np.zeros((mesh.n_dim,) * 2)
    target[0, 0] = pull
    assert np.allclose(nodal_field(model, frame, "stress"), target, atol=1e-9)
