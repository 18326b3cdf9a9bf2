"""A mesh of fewer elements: a body of the same outline and sets, on nodes that were there."""

from dataclasses import replace

import numpy as np
import pytest

from idic.fe import Coarse, make_mesh
from idic_studies.examples.polycarbonate_model import Divisions, strip_mesh


def volume(mesh, only=None):
    total = 0.0
    for block in mesh.blocks:
        points, weights = block.kind.quadrature_rule()
        jac = np.einsum("eai,qaj->eqij", mesh.nodes[block.connectivity], block.kind.shape_gradients(points))
        sizes = np.linalg.det(jac) @ weights
        inside = np.ones(block.n_elements, bool) if only is None else np.isin(
            block.first + np.arange(block.n_elements), only)
        total += sizes[inside].sum()
    return total


def grid(columns, rows, cell="quad4", shuffled=None):
    """A unit square, its columns of unequal width; two materials side by side; edge and node sets."""
    x = np.linspace(0.0, 1.0, columns + 1) ** 1.2
    x[columns // 2] = 0.5
    nodes = np.array([(a, b) for b in np.linspace(0.0, 1.0, rows + 1) for a in x])
    at = lambda i, j: j * (columns + 1) + i  # noqa: E731
    cells = np.array([(at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1))
                      for j in range(rows) for i in range(columns)])
    if shuffled is not None:  # numbers and first corners that tell nothing
        order = shuffled.permutation(len(nodes))
        nodes, cells = nodes[np.argsort(order)], order[cells]
        cells = np.array([np.roll(one, shuffled.integers(4)) for one in cells])[shuffled.permutation(len(cells))]
    middle = nodes[cells].mean(axis=1)
    left = np.flatnonzero(middle[:, 0] < 0.5)
    mesh = make_mesh(nodes, [(cell, cells)], node_sets={"TOP": np.flatnonzero(nodes[:, 1] == 1.0)},
                     element_sets={"left": left, "right": np.setdiff1d(np.arange(len(cells)), left)})
    faces = mesh.boundary_faces()
    right = np.array([face for face in faces if np.all(nodes[mesh.face_nodes(face), 0] == 1.0)])
    return replace(mesh, edge_sets={"RIGHT": right})


def length(mesh, faces):
    ends = np.array([mesh.nodes[mesh.face_nodes(face)[:2]] for face in faces])
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum()


@pytest.mark.parametrize("shuffled", [None, 3])
def test_a_rectangle_keeps_its_area_its_materials_and_its_sets(shuffled):
    mesh = grid(12, 8, shuffled=None if shuffled is None else np.random.default_rng(shuffled))
    found = Coarse.of(mesh, 24)
    found.mesh.check_elements()
    assert 20 <= found.mesh.n_elements <= 24
    assert np.array_equal(found.mesh.nodes, mesh.nodes[found.nodes])
    assert volume(found.mesh) == pytest.approx(1.0)
    for name, own in mesh.element_sets.items():
        assert volume(found.mesh, found.mesh.element_sets[name]) == pytest.approx(volume(mesh, own))
    top = found.mesh.nodes[found.mesh.node_sets["TOP"]]
    assert np.all(top[:, 1] == 1.0) and len(top) == np.sum(found.mesh.nodes[:, 1] == 1.0)
    assert length(found.mesh, found.mesh.edge_sets["RIGHT"]) == pytest.approx(1.0)


def test_the_strip_stays_one_layer_thick_and_its_elements_grow_alike():
    mesh = strip_mesh(Divisions(24, 6))
    found = Coarse.of(mesh, 36).mesh
    assert found.n_elements == 36  # 12 x 3 x 1
    assert volume(found) == pytest.approx(volume(mesh), rel=1e-12)
    x = np.unique(found.nodes[:, 0])
    assert len(x) == 13 and np.diff(x) == pytest.approx(50.0 / 12)
    assert {name: len(nodes) for name, nodes in found.node_sets.items()} == {"MIDDLE": 8, "GRIP": 8, "MIDPLANE": 52}
    assert len(found.edge_sets["FRONT"]) == 36


def test_a_hole_stays_round_to_its_own_nodes():
    """A ring of 16 x 4 elements: only layers around the hole can go alone, sectors go where corners do not mind."""
    angle, radius = np.linspace(0, 2 * np.pi, 17)[:-1], np.linspace(1.0, 2.0, 5)
    nodes = np.array([(r * np.cos(a), r * np.sin(a)) for r in radius for a in angle])
    at = lambda i, j: j * 16 + i % 16  # noqa: E731
    cells = np.array([(at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)) for j in range(4) for i in range(16)])
    mesh = make_mesh(nodes, [("quad4", cells)], element_sets={"ring": np.arange(64)})
    mesh.check_elements()
    found = Coarse.of(mesh, 8).mesh
    found.check_elements()
    radii = np.linalg.norm(found.nodes, axis=1)
    assert found.n_elements < 64 and radii.min() == pytest.approx(1.0) and radii.max() == pytest.approx(2.0)
    outline = np.linalg.norm(found.nodes[np.unique([found.face_nodes(f) for f in found.boundary_faces()])], axis=1)
    assert np.all(np.isclose(outline, 1.0) | np.isclose(outline, 2.0))


def box(*numbers):
    """Unit bricks."""
    x, y, z = (part.ravel() for part in np.indices([n + 1 for n in numbers]))
    number = np.arange(len(x)).reshape([n + 1 for n in numbers])
    corner = lambda i, j, k: number[i:numbers[0] + i, j:numbers[1] + j, k:numbers[2] + k].ravel()  # noqa: E731
    cells = [corner(*at, k) for k in (0, 1) for at in ((0, 0), (1, 0), (1, 1), (0, 1))]
    return make_mesh(np.column_stack([x, y, z]).astype(float), [("hex8", np.stack(cells, axis=1))])


def test_plies_of_one_brick_each_keep_their_share_of_a_laminate():
    mesh = box(4, 4, 6)
    is_odd = np.floor(mesh.nodes[mesh.blocks[0].connectivity].mean(axis=1)[:, 2]) % 2 == 1
    mesh = replace(mesh, element_sets={"warp": np.flatnonzero(is_odd), "weft": np.flatnonzero(~is_odd)})
    found = Coarse.of(mesh, 12).mesh
    assert found.n_elements < 96
    assert [volume(found, found.element_sets[name]) for name in ("warp", "weft")] == pytest.approx([48.0, 48.0])


def test_a_loaded_strip_one_face_wide_keeps_its_area():
    mesh = box(5, 4, 2)
    faces = mesh.boundary_faces()
    middles = np.array([mesh.nodes[mesh.face_nodes(face)].mean(axis=0) for face in faces])
    strip = faces[(middles[:, 2] == 2.0) & (middles[:, 0] == 2.5)]
    found = Coarse.of(replace(mesh, edge_sets={"STRIP": strip}), 1).mesh
    corners = np.array([found.nodes[found.face_nodes(face)] for face in found.edge_sets["STRIP"]])
    assert found.n_elements < 40 and np.ptp(corners, axis=1)[:, :2].prod(axis=1).sum() == pytest.approx(4.0)


def test_where_no_layer_can_go_or_there_are_few_elements_there_is_no_coarser_mesh():
    mesh = grid(12, 8)
    assert Coarse.of(mesh, 96) is None
    triangles = make_mesh(mesh.nodes, [("tri3", mesh.blocks[0].connectivity[:, :3])])
    assert Coarse.of(triangles, 10) is None
    corners = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    assert Coarse.of(make_mesh(corners, [("quad4", [[0, 1, 2, 3]])]), 0) is None


def test_quadratic_quadrilaterals_become_linear_ones_on_their_corners():
    linear = grid(4, 4)
    cells = linear.blocks[0].connectivity
    edges = np.unique(np.sort(np.concatenate([cells[:, [k, (k + 1) % 4]] for k in range(4)]), axis=1), axis=0)
    number = {tuple(edge): linear.n_nodes + k for k, edge in enumerate(edges)}
    mids = np.array([[number[tuple(sorted((c[k], c[(k + 1) % 4])))] for k in range(4)] for c in cells])
    nodes = np.vstack([linear.nodes, linear.nodes[edges].mean(axis=1)])
    found = Coarse.of(make_mesh(nodes, [("quad8", np.hstack([cells, mids]))]), 4).mesh
    assert found.blocks[0].cell == "quad4" and found.n_elements == 4 and volume(found) == pytest.approx(1.0)
