"""The regularisation against what it promises: affine motions untouched, waves of its length damped by half."""

from __future__ import annotations

import numpy as np
import pytest
from dic_cases import grid
from scipy import sparse
from scipy.sparse.linalg import spsolve

from idic.measure import Regularisation, build_smoother
from idic.errors import InputError
from idic.readers import roi_mesh


def passed(mesh, kind: str, length: float, wave: float, direction) -> float:
    """Part of a wave (along x, displacement along `direction`) that an image of even contrast lets through."""
    smoother = build_smoother(mesh.nodes, mesh.blocks, Regularisation(kind, length))
    # even contrast: H = integral of N N^T, here summed per element with the smoother's own areas
    mass = np.zeros(mesh.n_nodes)
    for block in mesh.blocks:
        x = mesh.nodes[block.connectivity]
        area = np.prod(np.ptp(x[:, :4], axis=1), axis=1)
        share = np.full(block.connectivity.shape[1], 0.25)
        if block.cell == "quad8":
            share = np.repeat([3 / 76, 16 / 76], 4)  # diagonal scaling of the consistent mass
        np.add.at(mass, block.connectivity, area[:, None] * share)
    penalty = smoother.matrix(1.0, np.zeros(mesh.n_nodes, dtype=bool))
    hessian = sparse.diags_array(np.repeat(mass, 2))
    field = np.outer(np.cos(2 * np.pi * mesh.nodes[:, 0] / wave), direction)
    smooth = spsolve(sparse.csc_matrix(hessian + penalty), hessian @ field.ravel()).reshape(-1, 2)
    inner = (np.abs(mesh.nodes - 240.0) < 120.0).all(axis=1)
    return float((smooth[inner] * field[inner]).sum() / (field[inner] ** 2).sum())


@pytest.mark.parametrize(("kind", "order"), [("mechanical", 4), ("gradient", 2)])
@pytest.mark.parametrize("cell", ["quad4", "quad8"])
def test_a_wave_of_the_length_is_damped_by_half_and_longer_ones_as_the_formula_says(kind, order, cell):
    mesh = grid(0, 0, 480, 480, 10 if cell == "quad4" else 20, cell)
    length = 80.0
    for wave in (80.0, 160.0):
        both = [passed(mesh, kind, length, wave, direction) for direction in ((1.0, 0.0), (0.0, 1.0))]
        theory = 1 / (1 + (length / wave) ** order)
        if kind == "gradient":  # blind to the direction; 8 nodes per wave: 2 %
            assert both == pytest.approx([theory, theory], abs=0.03)
        else:  # longitudinal waves are damped more, transverse ones less; the length is for their geometric mean
            assert both[0] < theory < both[1]
            assert np.sqrt(np.prod([1 / part - 1 for part in both])) == pytest.approx(1 / theory - 1, rel=0.25)


@pytest.mark.parametrize("shape", ["quad4", "quad8", "hole"])
def test_affine_motions_cost_nothing(shape):
    if shape == "hole":
        mesh = roi_mesh((0, 0, 200, 160), 10, [(90.0, 80.0, 30.0)], down=True)
    else:
        mesh = grid(0, 0, 200, 160, 20, shape)
    smoother = build_smoother(mesh.nodes, mesh.blocks, Regularisation("mechanical"))
    rng = np.random.default_rng(2)
    affine = rng.standard_normal(2) + mesh.nodes @ rng.standard_normal((2, 2))
    rough = rng.standard_normal(affine.shape) * affine.std()
    assert np.abs(smoother.operator @ affine.ravel()).max() < 1e-9 * np.abs(smoother.operator @ rough.ravel()).max()


def test_a_search_smooths_over_two_nodes_and_a_measurement_over_half_of_their_distance():
    for size, cell, search, measurement in ((20, "quad4", 40.0, 10.0), (40, "quad8", 40.0, 10.0),
                                            (5, "quad4", 24.0, 8.0)):
        mesh = grid(0, 0, 200, 160, size, cell)
        for regularisation, length in ((Regularisation.smooth(), search), (Regularisation(), measurement)):
            assert build_smoother(mesh.nodes, mesh.blocks, regularisation).length_px == pytest.approx(length)


def test_a_wrong_regularisation_is_refused_by_name():
    with pytest.raises(InputError, match="no such regularisation"):
        Regularisation("elastic")
    with pytest.raises(InputError, match="length"):
        Regularisation("mechanical", -1.0)
