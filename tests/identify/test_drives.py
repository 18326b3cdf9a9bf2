"""Smoothness of measured edges: a property of the edge, not of the order in which a set names its nodes."""

import numpy as np

from idic.fe import make_mesh, raise_order, second_differences


def _plate():
    nodes = np.array([[1.3 * x, y] for y in range(4) for x in range(6)], float)
    quads = np.array([[i + 6 * j, i + 1 + 6 * j, i + 7 + 6 * j, i + 6 + 6 * j] for j in range(3) for i in range(5)])
    return make_mesh(nodes, [("quad4", quads)])


def test_a_linear_motion_of_a_closed_edge_costs_nothing_in_whatever_order_its_nodes_come():
    for mesh in (_plate(), raise_order(_plate())):
        edge = np.unique(np.concatenate([mesh.face_nodes(face) for loop in mesh.boundary_edges() for face in loop]))
        nodes = np.random.default_rng(0).permutation(edge)
        rows = second_differences(mesh, nodes)
        assert len(rows) == len(nodes) - 4  # the four corners are free to bend
        assert np.abs(rows @ (mesh.nodes[nodes] @ [0.3, -0.7] + 0.1)).max() < 1e-12  # rounding


def test_a_kink_along_a_straight_edge_is_rough_and_one_at_a_corner_is_not():
    mesh = _plate()
    bottom = np.arange(6)
    kink = np.abs(mesh.nodes[bottom, 0] - mesh.nodes[3, 0])
    assert np.abs(second_differences(mesh, bottom) @ kink).max() > 1.0
    corner = np.array([0, 1, 2, 6, 12])  # bottom left
    bent = np.where(mesh.nodes[corner, 1] > 0, mesh.nodes[corner, 1], 0.0)
    assert np.abs(second_differences(mesh, corner) @ bent).max(initial=0.0) < 1e-12


def test_raising_the_order_keeps_sets_volume_and_orientation():

    mesh = _plate()
    mesh.node_sets["BOTTOM"] = np.arange(6)
    mesh.node_sets["LEFT_HALF"] = np.flatnonzero(mesh.nodes[:, 0] < 3.0)
    finer = raise_order(mesh)
    finer.check_elements()
    assert {block.cell for block in finer.blocks} == {"quad8"}
    bottom = finer.nodes[finer.node_sets["BOTTOM"]]
    assert len(bottom) == 11 and np.all(bottom[:, 1] == 0.0)
    half = finer.nodes[finer.node_sets["LEFT_HALF"]]
    assert len(half) == 12 + 3 * 3 + 2 * 4  # corners, and the middles of every edge of the elements inside
    assert len(np.unique(finer.node_labels)) == finer.n_nodes
