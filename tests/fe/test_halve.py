"""Meshes of half the element size: the same body, the same sets, fields carried over as the elements describe them."""

import numpy as np
import pytest
from fe_bodies import volume

from idic.errors import InputError
from idic.fe import halve, make_mesh, raise_order
from idic.virtual_tests import strip_with_hole


def triangles():
    nodes = np.array([[0, 0], [2, 0], [4, 0.3], [0, 2], [2, 2.2], [4, 2]], float)
    return make_mesh(nodes, [("tri3", [[0, 1, 4], [0, 4, 3]]), ("quad4", [[1, 2, 5, 4]])],
                     node_sets={"LEFT": np.array([0, 3]), "ALL": np.arange(6)},
                     element_sets={"BODY": np.arange(3), "QUAD": np.array([2])},
                     edge_sets={"TOP": np.array([[1, 1], [2, 2]])})


def bricks():
    x = np.array([[i, j, k] for k in range(2) for j in range(2) for i in range(3)], float)
    return make_mesh(x, [("hex8", [[0, 1, 4, 3, 6, 7, 10, 9], [1, 2, 5, 4, 7, 8, 11, 10]])],
                     node_sets={"END": np.flatnonzero(x[:, 0] == 0)}, element_sets={"BODY": np.arange(2)},
                     edge_sets={"FRONT": np.array([[0, 1], [1, 1]])})


MESHES = {"linear": triangles, "quadratic": lambda: raise_order(triangles()), "bricks": bricks,
          "quadratic bricks": lambda: raise_order(bricks()),
          "hole": lambda: strip_with_hole(28.0, 16.0, 3.0, "quad8", 2, 3, 1)}


@pytest.mark.parametrize("name", MESHES)
def test_the_body_stays_and_every_element_is_divided(name):
    coarse = MESHES[name]()
    fine = halve(coarse)
    fine.mesh.check_elements()
    assert fine.mesh.n_elements == coarse.n_elements * 2**coarse.n_dim
    assert volume(fine.mesh) == pytest.approx(volume(coarse), rel=1e-12)  # curved elements are mapped as before
    assert len(fine.mesh.boundary_faces()) == len(coarse.boundary_faces()) * 2 ** (coarse.n_dim - 1)  # no cracks
    assert np.array_equal(fine.mesh.nodes[:coarse.n_nodes], coarse.nodes)
    distances = np.linalg.norm(fine.mesh.nodes[:, None] - fine.mesh.nodes[None], axis=2) + np.eye(fine.mesh.n_nodes)
    assert distances.min() > 1e-3  # no node twice


@pytest.mark.parametrize("name", MESHES)
def test_sets_hold_the_same_parts_of_the_body(name):
    coarse = MESHES[name]()
    fine = halve(coarse).mesh
    for key, members in coarse.element_sets.items():
        assert len(fine.element_sets[key]) == len(members) * 2**coarse.n_dim
    for key, members in coarse.edge_sets.items():
        assert len(fine.edge_sets[key]) == len(members) * 2 ** (coarse.n_dim - 1)
        for mesh, faces in ((coarse, members), (fine, fine.edge_sets[key])):
            outer = set(map(tuple, mesh.boundary_faces().tolist()))
            assert all(tuple(face) in outer for face in faces.tolist())
    for key in coarse.node_sets:
        old, new = coarse.nodes[coarse.node_sets[key]], fine.nodes[fine.node_sets[key]]
        for axis in range(coarse.n_dim):
            if np.ptp(old[:, axis]) == 0.0:  # a straight side: exactly the nodes that lie on it
                assert len(new) == np.count_nonzero(np.isclose(fine.nodes[:, axis], old[0, axis]))


@pytest.mark.parametrize("name", MESHES)
def test_a_linear_field_is_carried_over_exactly(name):
    coarse = MESHES[name]()
    fine = halve(coarse)
    weights = np.arange(1.0, coarse.n_dim + 1)
    assert np.allclose(fine.carry @ (coarse.nodes @ weights), fine.mesh.nodes @ weights, rtol=1e-13)


def test_tetrahedra_are_refused():
    mesh = make_mesh(np.vstack([np.zeros(3), np.eye(3)]), [("tet4", [[0, 1, 2, 3]])])
    assert not mesh.can_halve
    with pytest.raises(InputError, match="tetrahedra"):
        halve(mesh)
