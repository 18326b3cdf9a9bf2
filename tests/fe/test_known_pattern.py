"""The numbering of a mesh is made once for the simulations that follow each other on it."""

import numpy as np
import pytest

from idic.fe.solver import known_pattern as module
from idic.fe.solver.known_pattern import MAX_KEPT_PATTERNS, known_pattern
from idic.fe.solver.linear import make_pattern
from idic.virtual_tests import strip_with_hole


@pytest.fixture
def asked(monkeypatch):
    """Numberings that were made, none kept at first."""
    made = []
    monkeypatch.setattr(module, "_kept", {})
    monkeypatch.setattr(module, "make_pattern", lambda *given: made.append(given) or make_pattern(*given))
    return made


def mesh_of(cells):
    mesh = strip_with_hole(10.0, 6.0, 1.0, "quad8", cells, cells, cells, name="BODY")
    nodes = mesh.blocks[0].connectivity
    return mesh.nodes, [(nodes[:, :, None] * 2 + np.arange(2)).reshape(len(nodes), -1)]


def test_equal_meshes_held_alike_share_their_numbering(asked):
    nodes, dofs = mesh_of(2)
    first = known_pattern(nodes, dofs, np.array([0, 1]))
    again = known_pattern(nodes.copy(), [dofs[0].copy()], np.array([0, 1]))
    assert again is first and len(asked) == 1
    plain = make_pattern(nodes, dofs, np.array([0, 1]))
    np.testing.assert_array_equal(first.equation, plain.equation)


def test_another_shape_or_another_hold_is_numbered_anew(asked):
    nodes, dofs = mesh_of(2)
    for moved, held in ((nodes, [0]), (nodes, [0, 1]), (nodes + 0.1, [0])):
        known_pattern(moved, dofs, np.array(held))
    known_pattern(nodes, [dofs[0][1:]], np.array([0]))
    assert len(asked) == 4


def test_few_are_kept_the_last_ones_used(asked):
    nodes, dofs = mesh_of(2)
    for k in range(MAX_KEPT_PATTERNS):
        known_pattern(nodes, dofs, np.array([k]))
    known_pattern(nodes, dofs, np.array([0]))  # used again
    known_pattern(nodes, dofs, np.array([99]))
    assert len(module._kept) == MAX_KEPT_PATTERNS
    n = len(asked)
    known_pattern(nodes, dofs, np.array([0]))
    assert len(asked) == n
    known_pattern(nodes, dofs, np.array([1]))
    assert len(asked) == n + 1


def test_kept_patterns_have_few_entries_together(asked, monkeypatch):
    nodes, dofs = mesh_of(2)
    n_entries = make_pattern(nodes, dofs, np.array([0])).n_stored
    monkeypatch.setattr(module, "MAX_KEPT_ENTRIES", 2 * n_entries)
    for k in range(3):
        known_pattern(nodes, dofs, np.array([2 * k]))
    assert len(module._kept) == 2
    known_pattern(nodes, dofs, np.array([4]))
    assert len(asked) == 3
    monkeypatch.setattr(module, "MAX_KEPT_ENTRIES", n_entries // 2)
    known_pattern(nodes, dofs, np.array([6]))
    known_pattern(nodes, dofs, np.array([6]))
    assert len(asked) == 5
