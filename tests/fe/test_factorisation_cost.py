"""The fill counted on a mesh is that of SuperLU, which the solver uses, within a factor of two."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from idic.fe.factorisation_cost import dissected
from idic.fe.mesh.mesh import Mesh, make_mesh
from idic.fe.mesh.refine import raise_order


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


def stiffness(mesh: Mesh):
    """A regular matrix with the pattern of the stiffness."""
    (block,), n = mesh.blocks, mesh.n_nodes * mesh.n_dim
    dofs = (block.connectivity[:, :, None] * mesh.n_dim + np.arange(mesh.n_dim)).reshape(block.n_elements, -1)
    m = dofs.shape[1]
    values = np.tile(-np.ones((m, m)) + (m + 1.0) * np.eye(m), (block.n_elements, 1, 1))
    return coo_array((values.ravel(), (np.repeat(dofs, m, axis=1).ravel(), np.tile(dofs, (1, m)).ravel())),
                     shape=(n, n)).tocsc()


@pytest.mark.parametrize("mesh", [plate(40, 40), plate(160, 10), brick(9, 9, 9), brick(30, 30, 1), brick(40, 5, 5)],
                         ids=["plate", "strip", "cube", "sheet", "bar"])
def test_the_fill_counted_on_the_mesh_is_that_of_the_solver(mesh):
    factor = splu(stiffness(mesh), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01, options={"SymmetricMode": True})
    assert 0.5 < dissected(mesh).entries / factor.L.nnz < 2.0


def test_the_fill_of_a_square_and_of_a_cube_grows_as_theory_says():
    """n log n entries in a plane, n^(4/3) in space; operations n^(3/2) and n^2 (George, 1973; Lipton and others, 1979)."""
    for small, large, entries, operations in ((plate(40, 40), plate(160, 160), 1.15, 1.5),
                                              (brick(8, 8, 8), brick(24, 24, 24), 4 / 3, 2.0)):
        a, b = dissected(small), dissected(large)
        growth = np.log(large.n_nodes / small.n_nodes)
        assert np.log(b.entries / a.entries) / growth == pytest.approx(entries, abs=0.15)  # meshes are finite
        assert np.log(b.operations / a.operations) / growth == pytest.approx(operations, abs=0.25)
