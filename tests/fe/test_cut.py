"""Meshes that are cut along a path: whole in area, valid, with their sets, and open along the path."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from idic.errors import InputError
from idic.fe import cut_along, make_mesh, raise_order


def sheet(n=12):
    """Squares of 1 mm, n by n."""
    nodes = np.stack(np.meshgrid(np.arange(n + 1.0), np.arange(n + 1.0)), axis=-1).reshape(-1, 2)
    first = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    cells = np.stack([first, first + 1, first + n + 2, first + n + 1], axis=1)
    return make_mesh(nodes, [("quad4", cells)], node_sets={"LEFT": np.arange(n + 1) * (n + 1)},
                     element_sets={"LOW": np.arange(n * n // 2), "HIGH": np.arange(n * n // 2, n * n)},
                     edge_sets={"LEFT": np.stack([np.arange(n) * n, np.full(n, 3)], axis=1)})


def area(mesh, elements=None):
    total = 0.0
    for block in mesh.blocks:
        corners = mesh.nodes[block.connectivity]
        ahead = np.roll(corners, -1, axis=1)
        areas = 0.5 * np.sum(corners[..., 0] * ahead[..., 1] - corners[..., 1] * ahead[..., 0], axis=1)
        numbers = block.first + np.arange(block.n_elements)
        total += areas.sum() if elements is None else areas[np.isin(numbers, elements)].sum()
    return total


PATHS = {"along a row": [[0, 6], [7, 6]], "beside a row": [[0, 6.2], [7, 6.2]], "from outside": [[-1, 5.3], [6.3, 8.1]],
         "with a corner": [[0, 3], [5, 8], [9, 8.4]], "inside": [[3.2, 3.3], [6, 9.3]], "steep": [[4.4, 0], [5, 9.7]]}


@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS)
def test_a_cut_mesh_is_whole_and_open_along_the_path(path):
    path = np.array(path, dtype=float)
    before = sheet()
    mesh, cut = cut_along(before, path)
    mesh.check_elements()
    raise_order(mesh).check_elements()
    assert area(mesh) == pytest.approx(144.0)
    assert area(mesh, mesh.element_sets["LOW"]) == pytest.approx(72.0, abs=4.0)  # nodes moved onto the path
    assert set(mesh.element_sets["LOW"]) | set(mesh.element_sets["HIGH"]) == set(range(mesh.n_elements))
    left, right = mesh.nodes[cut.left_nodes], mesh.nodes[cut.right_nodes]
    assert left == pytest.approx(right, abs=1e-12)
    inside = bool((path[0] > 0.0).all())
    assert (cut.left_nodes != cut.right_nodes).tolist() == [not inside, *[True] * (len(cut.left_nodes) - 2), False]
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(cut.path, axis=0), axis=1))])
    on_path = np.stack([np.interp(cut.place, along, axis) for axis in cut.path.T], axis=1)
    assert left == pytest.approx(on_path, abs=1e-9)
    assert len(mesh.boundary_edges()) == (2 if inside else 1)
    faces = len(mesh.boundary_faces()) - len(before.boundary_faces())
    assert faces == 2 * (len(cut.left_nodes) - 1) + int(not inside and cut.left_nodes[0] >= before.n_nodes)


def test_a_set_of_all_nodes_is_no_reason_to_look_at_edges_that_are_doubled():
    plain = sheet()
    plain = replace(plain, node_sets={**plain.node_sets, "ALL": np.arange(plain.n_nodes)})
    for path in ([[-1.0, 7.4], [8.0, 5.2]], [[-1.0, 5.45], [9.0, 4.2]], [[-1.0, 6.43], [9.5, 6.05]]):
        mesh, cut = cut_along(plain, np.array(path))
        doubled = cut.right_nodes[cut.right_nodes != cut.left_nodes]
        assert set(range(plain.n_nodes)) <= set(mesh.node_sets["ALL"].tolist())
        assert {cut.left_nodes[0], doubled[0]} <= set(mesh.node_sets["LEFT"].tolist())


def test_the_sets_of_the_edge_where_it_begins_hold_both_sides():
    mesh, cut = cut_along(sheet(), np.array([[0.0, 5.5], [6.0, 5.5]]))
    assert {int(cut.left_nodes[0]), int(cut.right_nodes[0])} <= set(mesh.node_sets["LEFT"].tolist())
    lengths = [np.ptp(mesh.nodes[mesh.face_nodes(edge), 1]) for edge in mesh.edge_sets["LEFT"]]
    assert sum(lengths) == pytest.approx(12.0) and len(lengths) == 13
    assert len(np.unique(mesh.node_labels)) == mesh.n_nodes
    assert len(np.unique(mesh.element_labels)) == mesh.n_elements


@pytest.mark.parametrize("path", [[[0, 6], [13, 6]], [[14, 14], [15, 15]], [[0, 6], [12, 6]]])
def test_a_path_that_leaves_the_body_is_refused(path):
    with pytest.raises(InputError, match="the path of a crack leaves the body"):
        cut_along(sheet(), np.array(path, dtype=float))


@pytest.mark.parametrize("path", [[[0, 5.3], [6, 5.3], [6, 8.1], [3, 8.1], [3, 2.2]], [[0, 5], [5, 5], [2, 5]],
                                  [[0, 5], [6, 5], [6, 8], [3, 8], [3, 5]]])
def test_a_path_that_crosses_itself_goes_back_or_ends_on_itself_is_refused(path):
    with pytest.raises(InputError, match="the path of a crack meets itself"):
        cut_along(sheet(), np.array(path, dtype=float))


def test_a_path_of_one_point_and_elements_of_solids_are_refused():
    with pytest.raises(InputError, match="a crack without a path"):
        cut_along(sheet(), np.array([[2.0, 2.0], [2.0, 2.0]]))
    solid = make_mesh(np.eye(4)[:, :3], [("tet4", np.arange(4)[None])])
    with pytest.raises(InputError, match="elements that cannot be split"):
        cut_along(solid, np.array([[0.0, 6.0], [7.0, 6.0]]))


def test_a_mesh_with_mid_side_nodes_is_cut_as_the_same_without_them():
    path = np.array([[-1.0, 5.3], [6.3, 8.1]])
    mesh, cut = cut_along(raise_order(sheet()), path)
    plain, plain_cut = cut_along(sheet(), path)
    assert np.array_equal(mesh.nodes, plain.nodes) and np.array_equal(cut.right_nodes, plain_cut.right_nodes)
    assert all(np.array_equal(mesh.node_sets[name], plain.node_sets[name]) for name in plain.node_sets)
    assert all(np.array_equal(mesh.edge_sets[name], plain.edge_sets[name]) for name in plain.edge_sets)


def test_two_cuts_do_not_cross():
    mesh, first = cut_along(sheet(), np.array([[0.0, 6.0], [7.0, 6.0]]))
    taken = np.concatenate([first.left_nodes, first.right_nodes])
    with pytest.raises(InputError, match="leaves the body"):
        cut_along(mesh, np.array([[4.0, 0.0], [4.0, 9.0]]), taken)
    other, _ = cut_along(mesh, np.array([[0.0, 2.0], [7.0, 2.3]]), taken)
    assert area(other) == pytest.approx(144.0)
