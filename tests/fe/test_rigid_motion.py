"""Rigid motions that supports leave to parts of a mesh which only share nodes."""

import numpy as np
import pytest
from fe_bodies import PARAMETERS, body, grid, held, last

from idic.errors import InputError
from idic.fe import free_parts, make_mesh


def touching(cell, n, shared, turn=0.0):
    """Two boxes of `n` cells of side 1, the second from (1, 1[, 0]) on; `shared`: their common nodes by that place."""
    one = grid(cell, n)
    shift = np.array([1.0, 1.0, 0.0])[:one.n_dim]
    nodes, connectivity = np.vstack([one.nodes, one.nodes + shift]), one.blocks[0].connectivity
    number = np.arange(len(one.nodes), len(nodes))
    for k, x in enumerate(one.nodes + shift):
        same = np.flatnonzero(np.abs(one.nodes - x).max(axis=1) < 1e-9)
        if len(same) and shared(x):
            number[k] = same[0]
    used = np.unique(np.concatenate([connectivity.ravel(), number[connectivity].ravel()]))
    new = np.full(len(nodes), -1)
    new[used] = np.arange(len(used))
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.eye(one.n_dim)
    rotation[:2, :2] = [[c, -s], [s, c]]
    return make_mesh(nodes[used] @ rotation.T, [(cell, new[connectivity]), (cell, new[number[connectivity]])]), rotation


def all_of(mesh, nodes):
    d = mesh.n_dim
    return [(np.asarray(nodes), k, 0.0) for k in range(d)]


@pytest.mark.parametrize("turn", [0.0, 0.3])
@pytest.mark.parametrize("cell, n", [("quad4", (1, 1)), ("tri6", (3, 2)), ("hex8", (2, 1, 1)), ("tet4", (1, 1, 1))])
def test_two_boxes_that_touch_in_a_corner_or_an_edge_are_a_hinge(cell, n, turn):
    """The second box turns about what they share, at no force; the solver's answer would be rounding."""
    mesh, rotation = touching(cell, n, lambda x: True, turn)
    local = mesh.nodes @ rotation
    first, shared = np.flatnonzero((local[:, :2] <= 1 + 1e-9).all(axis=1)), np.abs(local[:, :2] - 1).max(axis=1) < 1e-9
    model = body(mesh, "solid" if mesh.n_dim == 3 else "plane_stress", constraints=held(mesh, all_of(mesh, first)))
    with pytest.raises(InputError, match="hangs on the rest by single nodes"):
        last(model, PARAMETERS["elastic"])
    (part,) = free_parts(mesh, np.asarray(model.constraints.dofs))
    assert part.motions.shape[1] == 1 and part.hangs
    np.testing.assert_array_equal(part.nodes, np.flatnonzero(shared | (local[:, :2] >= 1 - 1e-9).all(axis=1)))


@pytest.mark.parametrize("cell, n", [("quad8", (2, 2)), ("hex8", (1, 1, 1))])
def test_a_hinge_between_supported_boxes_is_computed(cell, n):
    """One more support, beyond the hinge, and the body is at rest; pulled there, it hangs straight."""
    mesh, _ = touching(cell, n, lambda x: True)
    first = np.flatnonzero((mesh.nodes[:, :2] <= 1).all(axis=1) & ~(mesh.nodes[:, :2] == 1).all(axis=1))
    top = np.flatnonzero((mesh.nodes[:, :2] == 2).all(axis=1))
    kind = "solid" if mesh.n_dim == 3 else "plane_stress"
    pull = [(top, 0, [0.0, 0.01]), (top, 1, [0.0, 0.01])]
    model = body(mesh, kind, constraints=held(mesh, [*all_of(mesh, first), *pull]))
    assert not list(free_parts(mesh, np.asarray(model.constraints.dofs)))
    frame = last(model, PARAMETERS["elastic"])
    on_diagonal = frame.u[mesh.nodes[:, 0] == mesh.nodes[:, 1], :2]
    np.testing.assert_allclose(on_diagonal[:, 0], on_diagonal[:, 1], atol=1e-12)  # mesh and pull are symmetric about it
    assert 0.0 < frame.u.max() <= 0.01 + 1e-12


def test_pieces_and_a_chain_of_hinges_are_counted_for_themselves():
    """Of four quadrilaterals in a chain, held in the first and the last, the middle ones turn against each other."""
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    nodes = np.unique(np.concatenate([square + k for k in range(4)]), axis=0)
    find = lambda x: int(np.flatnonzero((nodes == x).all(axis=1))[0])  # noqa: E731
    chain = np.array([[find(x) for x in square + k] for k in range(4)])
    mesh = make_mesh(nodes, [("quad4", chain)])
    ends = np.concatenate([2 * chain[[0, 3]].ravel(), 2 * chain[[0, 3]].ravel() + 1])
    (part,) = free_parts(mesh, ends)
    assert part.motions.shape[1] == 1 and part.hangs  # three hinges on one line: it buckles aside at no force
    bent = make_mesh(np.where(nodes == 2.0, [2.0, 2.4], nodes), [("quad4", chain)])
    assert not list(free_parts(bent, ends))  # off the line an arch stands
    (loose,) = free_parts(mesh, 2 * chain[:2].ravel())
    assert loose.motions.shape[1] > 0
