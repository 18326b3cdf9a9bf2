"""Shape functions, quadrature, faces, and the checks of a mesh."""

import numpy as np
import pytest
from fe_bodies import grid, quarter_ring

from idic.errors import InputError
from idic.fe import cell_type, make_mesh

CELLS = ["tri3", "tri6", "quad4", "quad8", "tet4", "tet10", "hex8", "hex20"]


@pytest.mark.parametrize("name", CELLS)
def test_shape_functions_are_one_at_their_node_and_sum_to_one(name):
    cell = cell_type(name)
    assert np.allclose(cell.shape_functions(cell.reference_nodes), np.eye(cell.n_nodes))
    xi = np.random.default_rng(1).random((7, cell.dim)) / 3
    assert np.allclose(cell.shape_functions(xi).sum(axis=1), 1)
    for i in range(cell.dim):
        step = 1e-6 * np.eye(cell.dim)[i]
        quotient = (cell.shape_functions(xi + step) - cell.shape_functions(xi - step)) / 2e-6
        assert np.allclose(quotient, cell.shape_gradients(xi)[:, :, i], atol=1e-8)  # quadratics: rounding / step


@pytest.mark.parametrize("name", CELLS)
def test_faces_point_outwards(name):
    cell = cell_type(name)
    mesh = make_mesh(cell.reference_nodes, [(name, np.arange(cell.n_nodes)[None])])
    centre = cell.reference_nodes[: cell.n_corners].mean(axis=0)
    for k in range(len(cell.faces)):
        x = mesh.nodes[mesh.face_nodes((0, k))]
        if cell.dim == 2:
            normal = np.array([x[1, 1] - x[0, 1], x[0, 0] - x[1, 0]])
        else:
            normal = np.cross(x[1] - x[0], x[2] - x[1])
        assert normal @ (x.mean(axis=0) - centre) > 0


def test_area_and_volume_are_integrated_exactly():
    for name, n, size in (("tri3", (2, 3), 6.0), ("quad8", (2, 3), 6.0), ("hex8", (1, 2, 1), 12.0),
                          ("hex20", (1, 2, 1), 12.0),
                          ("tet4", (1, 2, 1), 12.0), ("tet10", (1, 2, 1), 12.0)):
        lengths = (2.0, 3.0, 2.0)[: len(n)]
        mesh = grid(name, n, lengths)
        total = 0.0
        for order in (None, 3):
            (block,) = mesh.blocks
            xi, w = block.kind.quadrature_rule(order)
            jac = np.einsum("eak,qai->eqki", mesh.nodes[block.connectivity], block.kind.shape_gradients(xi))
            total = np.sum(np.linalg.det(jac) * w)
            assert total == pytest.approx(size)


def test_an_inverted_element_is_named_by_its_label():
    mesh = make_mesh([[0, 0], [1, 0], [1, 1], [0, 1], [2, 0], [2, 1]], [("quad4", [[0, 1, 2, 3], [1, 2, 5, 4]])],
                     element_labels=np.array([7, 42]))
    with pytest.raises(InputError, match="42"):
        mesh.check_elements()


def test_an_unknown_cell_names_the_known_ones():
    with pytest.raises(InputError, match="quad8"):
        cell_type("wedge6")


def test_the_boundary_of_a_plate_with_a_hole_is_an_outer_loop_and_a_hole():
    mesh = grid("quad8", (3, 3))
    block = mesh.blocks[0]
    holed = make_mesh(mesh.nodes, [("quad8", np.delete(block.connectivity, 4, axis=0))])
    outer, hole = holed.boundary_edges()
    assert (len(outer), len(hole)) == (12, 4)
    assert len(grid("hex8", (2, 2, 2)).boundary_faces()) == 24
    for loop in (outer, hole):  # consecutive edges share a node
        ends = np.array([holed.face_nodes(f)[:2] for f in loop])
        assert (ends[:, 1] == np.roll(ends[:, 0], -1)).all()


def test_the_camera_sees_the_faces_of_a_solid():
    mesh = grid("hex8", (2, 1, 1))
    front = np.array([f for f in mesh.boundary_faces() if np.allclose(mesh.nodes[mesh.face_nodes(f), 2], 1)])
    named = make_mesh(mesh.nodes, [("hex8", mesh.blocks[0].connectivity)], edge_sets={"FRONT": front})
    seen = named.surface_cells("FRONT")
    assert seen[0].cell == "quad4" and seen[0].connectivity.shape == (2, 4)
    with pytest.raises(InputError, match="FRONT"):
        named.surface_cells("BACK")
    assert quarter_ring("quad4", 2).surface_cells()[0].cell == "quad4"
