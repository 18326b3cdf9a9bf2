"""The free motion of a cross-section: known motions come back, noise goes where theory puts it."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path[:0] = [str(Path(__file__).parents[1] / "correlation")]

from section_cases import SHAPE, WIDTH, Surface, camera, layer_mesh, strip_mesh  # noqa: E402

from idic.correlation.height.cross_section import build_section_reference  # noqa: E402
from idic.correlation import section_motion  # noqa: E402
from idic.correlation.pixels.section_map import build_section_map  # noqa: E402
from idic.measure.dic.section import section_nodes, second_difference  # noqa: E402
from idic.measure import section_field  # noqa: E402
from idic.fe import make_mesh  # noqa: E402

SURFACE, NOISE = Surface(), 0.02  # um; the roughness has 1.1 um


def seen(mesh):
    reference = build_section_reference(build_section_map(mesh, "TOP", camera(), SHAPE), SURFACE.image())
    return reference, camera().project(mesh.nodes * [1.0, 0.0])[:, 0]


def elsewhere(motion, column):
    """The motion, and up to 0.4 px and 3 um beside it."""
    away = motion.copy()
    away[:, 0] += 0.4 * np.cos(column / 40.0)
    away[:, 2] += 2.0 * np.sin(column / 30.0) + 1.0
    return away


def test_the_motion_that_made_the_image_comes_back():
    mesh = strip_mesh(-WIDTH, WIDTH, 9)
    reference, column = seen(mesh)
    true = SURFACE.nodal(mesh, camera())
    found = section_field(reference, SURFACE.deformed(), elsewhere(true, column), column)
    assert found.converged
    moved, wanted = (section_motion(reference.pixel_map, motion) for motion in (found.motion, true))
    # the start was 0.28 px and 2 um off; waves of 24 px keep half, the 250 px of the error all but (24/190)^4 = 3e-4;
    # the rest is the true motion's fourth power, which a quadratic edge does not have (0.02 um, see its tests)
    assert np.sqrt(np.mean((moved.u - wanted.u) ** 2)) < 0.02
    assert np.sqrt(np.mean((moved.h - wanted.h) ** 2)) < 0.04


def test_the_scatter_is_that_of_the_normal_equations():
    """std(d)^2 = sigma^2 A^-1 H A^-1 for noise in the frame alone, mean over the section."""
    mesh = strip_mesh(-WIDTH, WIDTH, 9)
    reference, column = seen(mesh)
    still, rest = SURFACE.image(), np.zeros((mesh.n_nodes, 3))
    rng = np.random.default_rng(5)
    draws = [section_field(reference, still + NOISE * rng.standard_normal(SHAPE), rest, column) for _ in range(40)]
    nodes = section_nodes(reference, column)
    values = np.array([draw.motion[nodes][:, [0, 2]] for draw in draws])
    dofs = (3 * nodes[:, None] + [0, 2]).T.ravel()
    H = reference.equations(still, rest).H.tocsr()[dofs][:, dofs].toarray()
    bend, n = second_difference(column[nodes]), len(nodes)
    P = np.zeros_like(H)
    for part in (slice(0, n), slice(n, 2 * n)):
        P[part, part] = (24.0 / (2 * np.pi)) ** 4 * H[part, part].sum() / np.ptp(column[nodes]) * bend.T @ bend
    inverse = np.linalg.inv(H + P)
    theory = NOISE * np.sqrt(np.diagonal(inverse @ H @ inverse)).reshape(2, n).T
    ratio = np.sqrt((values**2).mean(axis=(0, 1)) / (theory**2).mean(axis=0))
    # 40 draws of about 12 independent places: known to 1/sqrt(2 * 480) = 3 %; the spline smooths the noise of a pixel
    assert ratio == pytest.approx(1.0, abs=0.12)
    n_pixels = reference.pixel_map.n_pixels
    chi2 = np.mean([draw.chi2_dof(NOISE) for draw in draws])  # only the frame is noisy here: half of what is expected
    assert chi2 == pytest.approx(0.5, abs=5.0 / np.sqrt(2.0 * n_pixels * len(draws)) + 0.01)
    assert 8.0 < draws[0].fitted < 2 * n


def test_a_step_in_the_section_does_not_tie_its_two_sides():
    """Two strips side by side, one of which rises by itself: nothing of it reaches the other one."""
    left, right = layer_mesh(np.linspace(-WIDTH, 0.0, 5)), layer_mesh(np.linspace(0.0, WIDTH, 5))
    n, elements = left.n_nodes, sum(block.n_elements for block in left.blocks)
    cells = np.concatenate([left.blocks[0].connectivity, right.blocks[0].connectivity + n])
    sides = np.concatenate([left.edge_sets["TOP"], right.edge_sets["TOP"] + [elements, 0]])
    mesh = make_mesh(np.concatenate([left.nodes, right.nodes]), [("quad8", cells)], edge_sets={"TOP": sides})
    reference, column = seen(mesh)
    rise = np.where(np.arange(SHAPE[1]) < SURFACE.middle, 0.0, 3.0)
    found = section_field(reference, SURFACE.image() + rise.astype(np.float32), np.zeros((mesh.n_nodes, 3)), column)
    nodes = section_nodes(reference, column)
    assert np.abs(found.motion[nodes[nodes < n], 2]).max() < 1e-2
    assert np.abs(found.motion[nodes[nodes >= n], 2] - 3.0).max() < 1e-2


def test_columns_without_heights_are_bridged():
    mesh = strip_mesh(-WIDTH, WIDTH, 9)
    reference, column = seen(mesh)
    true, frame = SURFACE.nodal(mesh, camera()), SURFACE.deformed()
    frame[:, 50:56] = np.nan
    found = section_field(reference, frame, elsewhere(true, column), column)
    moved, wanted = (section_motion(reference.pixel_map, motion) for motion in (found.motion, true))
    assert found.converged
    assert np.sqrt(np.mean((moved.h - wanted.h) ** 2)) < 0.1  # 22 of 118 columns are not seen at all


def test_nothing_to_see_is_said():
    mesh = strip_mesh(-WIDTH, WIDTH, 9)
    reference, column = seen(mesh)
    found = section_field(reference, np.full(SHAPE, np.nan, np.float32), np.zeros((mesh.n_nodes, 3)), column)
    assert not found.converged and not found.residual.valid.any() and found.fitted == 0.0


def test_a_straight_line_is_not_bent():
    x = np.array([0.0, 1.0, 3.5, 4.0, 9.0])
    D = second_difference(x)
    assert np.abs(D @ np.stack([np.ones(5), x], axis=1)).max() < 1e-12
    # int (d'')^2 over the inner spans of a parabola x^2 / 2: their length, each node owning half of its neighbours
    assert np.sum((D @ (0.5 * x**2)) ** 2) == pytest.approx(0.5 * np.sum(x[2:] - x[:-2]))
