"""Measured fields in the place of images: points in elements, M and b, averages over subsets, the free motion,
noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

from idic.correlation import build_point_map
from idic.correlation import FieldReference
from idic.measure import dic_stack
from idic.errors import InputError
from idic.fe import make_mesh, raise_order
from idic.images import ArrayStack, Camera, FieldNoise, coloured
from idic.model import Experiment, FieldPoints, Model, Noise, Options, Recording
from idic.parameters import ParameterSet

PITCH = 0.8  # mm


def plate(nx: int, ny: int, triangles: bool, crooked: bool = True):
    """A plate of 16 x 24 mm in quadratic elements; crooked: the nodes inside a little off their places."""
    x, y = np.meshgrid(np.linspace(0, 16, nx + 1), np.linspace(0, 24, ny + 1))
    nodes = np.column_stack([x.ravel(), y.ravel()])
    inner = (nodes > 0.1).all(axis=1) & (nodes < [15.9, 23.9]).all(axis=1)
    nodes[inner] += crooked * np.random.default_rng(4).uniform(-0.3, 0.3, (inner.sum(), 2))
    corner = (np.arange(ny)[:, None] * (nx + 1) + np.arange(nx)).ravel()
    quads = np.stack([corner, corner + 1, corner + nx + 2, corner + nx + 1], axis=1)
    cells = [("tri3", np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))] if triangles else [("quad4", quads)]
    return raise_order(make_mesh(nodes, cells))


def experiment(triangles: bool = False, frames=(), subset_px: float = 0.0, mask=None, crooked=True) -> Experiment:
    """Points 0.8 mm apart, some of them beside the plate; camera: y up, one pitch per px."""
    mesh = plate(4, 6, triangles, crooked)
    x, y = np.meshgrid(np.arange(-1, 23) * PITCH, np.arange(-1, 32) * PITCH)
    points = np.column_stack([x.ravel(), y.ravel()])
    camera = Camera.from_table(PITCH, (1.0, 31.0), ("+col", "-row"))
    grid = FieldPoints(camera.project(points), (33, 24), PITCH, subset_px)
    stack = ArrayStack(np.array([np.zeros((len(points), 2)), *frames], dtype=np.float32))
    model = Model("plane_stress", mesh, 1.0, (), ParameterSet([]), (), (), (), camera, np.arange(1.0 + len(frames)))
    recording = Recording(stack, tuple(map(str, range(1 + len(frames)))), quantity="displacement", points=grid,
                          noise=Noise(1.0), mask=mask)
    return Experiment("", "", recording, model, options=Options(brightness="none", lowpass_px=0.0))


def places(there: Experiment) -> np.ndarray:
    """mm"""
    return there.model.camera.inverse(there.recording.points.positions_px)


def measured(there: Experiment, u_mm: np.ndarray) -> np.ndarray:
    """A displacement of the points (n, 2) mm as a frame, µm along columns and rows."""
    return 1e3 * u_mm * [1.0, -1.0]


@pytest.mark.parametrize("triangles", [False, True])
def test_every_point_on_the_plate_is_found_where_it_is(triangles):
    there = experiment(triangles)
    reference = FieldReference.of(there, there.model.camera)
    at, pm = places(there), reference.pixel_map
    inside = (at >= -1e-9).all(axis=1) & (at <= [16 + 1e-9, 24 + 1e-9]).all(axis=1)
    assert sorted(np.unique(pm.point)) == np.flatnonzero(inside).tolist()
    np.testing.assert_allclose(pm.interpolate(there.model.mesh.nodes), at[pm.point],
                               atol=2e-6)  # places are kept to 1e-7


def test_m_and_b_are_sums_over_the_points(rng=np.random.default_rng(2)):
    frame = rng.normal(0.0, 5.0, (33 * 24, 2))
    frame[::11] = np.nan
    there = experiment(frames=[frame])
    reference = FieldReference.of(there, there.model.camera)
    motion = rng.normal(0.0, 0.01, (there.model.mesh.n_nodes, 2))
    columns = rng.normal(0.0, 1.0, (2 * there.model.mesh.n_nodes, 3))
    found = reference.compare(there, 1, motion)
    gram = found.gram(columns)

    N = reference.pixel_map.shape_matrix().toarray()
    M, b, rr = np.zeros((3, 3)), np.zeros(3), 0.0
    for row, (point, c) in enumerate(zip(reference.pixel_map.point, reference.pixel_map.component, strict=True)):
        value = np.float32(frame[point, c])
        if np.isfinite(value):
            L = 800.0 * N[row] @ columns[c::2]
            r = value - 800.0 * N[row] @ motion[:, c]
            M, b, rr = M + np.outer(L, L), b + L * r, rr + r * r
    np.testing.assert_allclose(gram.matrix, M, rtol=1e-9)
    np.testing.assert_allclose(gram.rhs, b, rtol=1e-9)
    assert found.rr == pytest.approx(rr) and found.n_lost == np.isnan(frame[np.unique(reference.pixel_map.point)]).sum()
    assert found.element_rr.sum() == pytest.approx(rr)


def test_a_mask_leaves_points_out():
    mask = np.ones((33, 24), dtype=bool)
    mask[:16] = False
    there = experiment(mask=mask)
    kept = FieldReference.of(there, there.model.camera).pixel_map
    assert kept.points()[:, 1].min() >= 15.5 and kept.n_pixels > 0


def test_subsets_average_the_motion():
    """Of a quadratic field the mean over a square of width b differs from the middle by b²/24 times the second
    derivatives."""
    width = 2.5
    there = experiment(subset_px=width, crooked=False)  # x² is exact in straight elements
    reference = FieldReference.of(there, there.model.camera)
    x, y = there.model.camera.project(there.model.mesh.nodes).T
    motion = np.column_stack([1e-3 * x * x, 2e-3 * y * y + 1e-3 * x * y])
    found = (reference.matrix @ motion.ravel()) / reference.scale
    pm = reference.pixel_map
    px, py = pm.points().T
    inside = (np.abs(px - 11.0) < 8.5) & (np.abs(py - 16.0) < 13.0)  # subsets that do not reach beyond the plate
    exact = np.where(pm.component == 0, 1e-3 * px * px + 1e-3 * width**2 / 12,
                     2e-3 * py * py + 1e-3 * px * py + 2e-3 * width**2 / 12)
    np.testing.assert_allclose(found[inside], exact[inside], atol=2e-6)  # places are kept to 1e-7
    assert np.abs(reference.matrix @ np.ones(2 * there.model.mesh.n_nodes) / reference.scale - 1.0).max() < 1e-9


@pytest.mark.parametrize("width", [0.7, 2.5])
def test_subsets_that_reach_beyond_the_mesh_see_an_affine_motion_at_their_middle(width):
    """Points lie on the ends of the plate, too: half or three quarters of their subset is beside it. Places are kept to
    1e-7 of single precision."""
    there = experiment(subset_px=width)
    reference = FieldReference.of(there, there.model.camera)
    x, y = there.model.camera.project(there.model.mesh.nodes).T
    motion = np.column_stack([0.3 + 0.01 * x - 0.002 * y, 0.004 * x + 0.02 * y])
    found = (reference.matrix @ motion.ravel()) / reference.scale
    pm = reference.pixel_map
    px, py = pm.points().T
    assert (px == px.min()).any() and (np.abs(px - px.min()) + np.abs(py - py.min()) < 1e-9).any()
    exact = np.where(pm.component == 0, 0.3 + 0.01 * px - 0.002 * py, 0.004 * px + 0.02 * py)
    np.testing.assert_allclose(found, exact, atol=2e-6)


def test_a_mesh_beside_the_points_is_refused():
    there = experiment()
    with pytest.raises(InputError, match="no measured point"):
        build_point_map(there.model.mesh.nodes + 500.0, there.model.mesh.blocks, there.model.camera,
                        there.recording.points.positions_px, (33, 24))


def test_the_free_motion_follows_an_affine_field_and_tells_the_noise():
    rng = np.random.default_rng(8)
    at = places(experiment())
    u = at @ np.array([[0.002, 0.001], [-0.0005, 0.004]]) + [0.3, -0.1]
    frames = [measured(experiment(), k * u) + rng.normal(0.0, 1.0, (len(at), 2)) for k in (1, 2, 3)]
    frames[2][:200] = np.nan
    there = experiment(frames=frames)
    found = dic_stack(there)
    assert found.status == ["ok"] * 4
    moved = there.model.camera.inverse(there.model.camera.project(there.model.mesh.nodes)
                                       + found.u_px[2]) - there.model.mesh.nodes
    exact = 2 * (there.model.mesh.nodes @ np.array([[0.002, 0.001], [-0.0005, 0.004]]) + [0.3, -0.1])
    np.testing.assert_allclose(moved, exact, atol=2e-3)  # mm; a node scatters by some tenths of a µm
    assert np.sqrt(np.mean((moved - exact) ** 2)) < 6e-4
    # the reference of these frames has no noise: chi² counts one for it, so half of the sum is there
    np.testing.assert_allclose(found.chi2_dof[1:], 0.5, atol=0.06)


def test_frames_that_lack_as_many_but_other_points_are_each_followed():
    still = experiment(crooked=False)
    u = places(still) @ np.array([[2e-3, 5e-4], [-1e-3, 1e-3]]).T + [0.01, -0.02]
    frames = [measured(still, u) for _ in range(2)]
    inside = np.unique(FieldReference.of(still, still.model.camera).pixel_map.point)
    frames[0][inside[:40]], frames[1][inside[-40:]] = np.nan, np.nan
    there = experiment(crooked=False, frames=frames)
    found = dic_stack(there, "mechanical")
    assert found.status[1:] == ["ok", "ok"]
    assert np.abs(found.rms_gv[1:]).max() < 1e-3  # µm: an affine motion costs the smoother nothing; float32 frames


@pytest.mark.parametrize("correlated", [False, True])
def test_the_noise_of_a_field_and_its_correlation(correlated):
    """Stages of a motion that grows unevenly, with noise in every stage and in the reference that all of them share."""
    rng = np.random.default_rng(3)
    ny, nx = 40, 50
    column, row = (part.ravel().astype(float) for part in np.meshgrid(np.arange(nx), np.arange(ny)))
    lag = np.arange(-6, 7)
    kernel = np.exp(-0.5 * (lag[:, None] ** 2 + lag[None, :] ** 2) / 1.2**2) if correlated else np.ones((1, 1))

    def noise() -> np.ndarray:
        return 0.4 * np.column_stack([coloured(rng.standard_normal((ny, nx)), kernel).ravel() if correlated
                                      else rng.standard_normal(ny * nx) for _ in range(2)])

    first = noise()
    field = np.column_stack([np.sin(column / 15.0) * row / 10.0, row + 3.0 * np.cos(row / 9.0)])
    stages = [np.zeros_like(first), *((0.3 * k + 0.02 * k * k) * field + noise() - first for k in range(1, 14))]
    found = FieldNoise.of(ArrayStack(np.array(stages, dtype=np.float32)), np.column_stack([column, row]), range(14), 0)
    assert found.std == pytest.approx(0.4, rel=0.05)
    exact = float(np.sqrt(kernel.sum()))  # of independent noise that scatters sums alike, over 0.4
    assert found.sum_std / found.std == pytest.approx(exact, rel=0.12)
    if correlated:
        np.testing.assert_allclose(found.correlation[6, 5:8], kernel[6, 5:8], atol=0.05)


def test_the_noise_of_a_small_field_of_overlapping_subsets_is_not_underestimated():
    """Subsets of five distances on 12 x 18 points: the fit of every stage takes 14 of its 50 independent values."""
    rng, (ny, nx) = np.random.default_rng(5), (18, 12)
    column, row = (part.ravel().astype(float) for part in np.meshgrid(np.arange(nx), np.arange(ny)))
    lag = np.clip(1.0 - np.abs(np.arange(-6, 7)) / 5.0, 0.0, None)
    kernel = np.outer(lag, lag)

    def noise() -> np.ndarray:
        large = (coloured(rng.standard_normal((3 * ny, 3 * nx)), kernel)[:ny, :nx] for _ in range(2))
        return np.column_stack([part.ravel() for part in large])

    found = []
    for _ in range(12):
        first = noise()
        stages = [np.zeros_like(first),
                  *(0.5 * k * np.column_stack([column, row]) + noise() - first for k in range(1, 9))]
        found.append(FieldNoise.of(ArrayStack(np.array(stages, dtype=np.float32)), np.column_stack([column, row]),
                                   range(9), 0))
    assert np.mean([one.std for one in found]) == pytest.approx(1.0, rel=0.05)
    across, along = (np.clip(1.0 - np.abs(np.subtract.outer(np.arange(n), np.arange(n))) / 5.0, 0.0, None)
                     for n in (nx, ny))
    x, y = np.arange(nx) - 0.5 * (nx - 1), np.arange(ny) - 0.5 * (ny - 1)
    strained = [x @ across @ x * along.sum() / (x @ x * ny), across.sum() * (y @ along @ y) / (nx * (y @ y))]
    exact = float(np.sqrt(np.mean(strained)))  # 3.9 of an unbounded field's 5; single estimates scatter by a fifth
    assert np.mean([one.sum_std for one in found]) == pytest.approx(exact, rel=0.12)


def test_too_few_stages_tell_no_noise():
    assert FieldNoise.of(ArrayStack(np.zeros((2, 100, 2), np.float32)), np.zeros((100, 2)), range(2), 0) is None


def test_the_reference_keeps_one_hessian(rng=np.random.default_rng(1)):
    there = experiment(frames=[rng.normal(size=(33 * 24, 2))])
    reference = FieldReference.of(there, there.model.camera)
    assert isinstance(reference, FieldReference)
    found = reference.compare(there, 1, np.zeros((there.model.mesh.n_nodes, 2)))
    assert found.H is reference.hessian and sparse.issparse(found.H) and found.n_brightness == 0


def test_a_rigid_motion_of_the_whole_specimen_is_an_unknown_of_the_frame():
    still = experiment(crooked=False)
    at, u = places(still), places(still) @ np.array([[2e-3, 5e-4], [-1e-3, 1e-3]]).T
    swayed = u + [0.3, -0.2] + 1e-3 * (at - at.mean(axis=0))[:, ::-1] * [-1.0, 1.0]
    there = experiment(crooked=False, frames=[measured(still, swayed)])
    there = replace(there, recording=replace(there.recording, points=replace(there.recording.points, free_rigid=True)))
    reference = FieldReference.of(there, there.model.camera)
    motion = (there.model.mesh.nodes @ np.array([[2e-3, 5e-4], [-1e-3, 1e-3]]).T) / PITCH * [1.0, -1.0]
    equations = reference.compare(there, 1, motion)
    fit = equations.brightness_fit()
    assert equations.n_brightness == 3 and equations.rr > 1e4 and fit.rr < 1e-4 * equations.rr
    left = reference.compare_pixels(there, 1, motion, fit.coefficients)
    assert np.abs(left.r).max() < 0.05  # µm of 300: frames are float32
    step = 1e-3
    moved = reference.compare(there, 1, motion + step)  # by the difference quotient, as q and rb
    np.testing.assert_allclose((equations.rb - moved.rb) / step, np.asarray(equations.hb.sum(axis=0)).ravel(),
                               rtol=1e-6,
                               atol=1e-6 * np.abs(equations.hb.sum(axis=0)).max())
