"""The fill counted on a mesh is that of the solver."""

from __future__ import annotations

import numpy as np
import pytest

from idic.fe import Mesh, dissected, make_mesh, raise_order
from idic.fe.solver.linear import make_pattern


def plate(nx: int, ny: int) -> Mesh:
    """quad8 elements."""
    number = np.arange((nx + 1) * (ny + 1)).reshape(ny + 1, nx + 1)
    cells = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], -1).reshape(-1, 4)
    nodes = np.stack(np.meshgrid(np.arange(nx + 1.0), np.arange(ny + 1.0)), -1).reshape(-1, 2)
    return raise_order(make_mesh(nodes, [("quad4", cells)]))


def brick(nx: int, ny: int, nz: int) -> Mesh:
    """hex8 elements."""
    a = np.arange((nx + 1) * (ny + 1) * (nz + 1)).reshape(nz + 1, ny + 1, nx + 1)
    lower, upper = a[:-1], a[1:]
    cells = np.stack([layer[rows, columns] for layer in (lower.transpose(1, 2, 0), upper.transpose(1, 2, 0))
                      for rows, columns in ((np.s_[:-1], np.s_[:-1]), (np.s_[:-1], np.s_[1:]),
                                            (np.s_[1:], np.s_[1:]), (np.s_[1:], np.s_[:-1]))], -1).reshape(-1, 8)
    z, y, x = np.meshgrid(*(np.arange(n + 1.0) for n in (nz, ny, nx)), indexing="ij")
    return make_mesh(np.stack([x, y, z], -1).reshape(-1, 3), [("hex8", cells)])


def dofs_of(mesh: Mesh) -> np.ndarray:
    """Dofs of each element  # (n_elements, m)"""
    (block,) = mesh.blocks
    return (block.connectivity[:, :, None] * mesh.n_dim + np.arange(mesh.n_dim)).reshape(block.n_elements, -1)


@pytest.mark.parametrize("mesh", [plate(40, 40), plate(160, 10), brick(9, 9, 9), brick(30, 30, 1), brick(40, 5, 5)],
                         ids=["plate", "strip", "cube", "sheet", "bar"])
def test_the_fill_counted_on_the_mesh_is_that_of_the_solver(mesh):
    pattern = make_pattern(mesh.nodes, [dofs_of(mesh)], np.zeros(0, dtype=int))
    counted, sizes = dissected(mesh).entries, [(f.end - f.first, len(f.boundary)) for f in pattern.fronts]
    assert counted == sum(s * (s + 1) / 2 + s * b for s, b in sizes)


def test_the_fill_of_a_square_and_of_a_cube_grows_as_theory_says():
    """n log n entries in a plane, n^(4/3) in space; operations n^(3/2) and n^2 (George, 1973; Lipton and others,
    1979)."""
    for small, large, entries, operations in ((plate(40, 40), plate(160, 160), 1.15, 1.5),
                                              (brick(8, 8, 8), brick(24, 24, 24), 4 / 3, 2.0)):
        a, b = dissected(small), dissected(large)
        growth = np.log(large.n_nodes / small.n_nodes)
        assert np.log(b.entries / a.entries) / growth == pytest.approx(entries, abs=0.15)  # meshes are finite
        assert np.log(b.operations / a.operations) / growth == pytest.approx(operations, abs=0.25)
