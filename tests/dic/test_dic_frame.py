"""One frame: motion, noise, brightness and gaps, against pictures whose nodes moved by known amounts."""

from __future__ import annotations

import numpy as np
import pytest
from dic_cases import grid, pictures, rest, set_up, wavy

from idic.measure import Regularisation, dic_frame
from idic.images import prefilter

SHAPE = (150, 190)
FRAME = (15, 15, 175, 135, 20)
BIAS = 0.012  # px: cubic spline on this speckle (0.003), amplified at nodes on the rim, which few pixels see


def measure(reference, smoother, image, start=None, **settings):
    start = np.zeros((reference.pixel_map.n_nodes, 2)) if start is None else start
    return dic_frame(reference, prefilter(image), start, smoother, **settings)


@pytest.mark.parametrize("cell", ["quad4", "tri3", "quad8"])
def test_the_motion_of_the_nodes_is_measured_to_the_bias_of_the_interpolation(cell):
    frame = (15, 15, 175, 135, 20 if cell != "quad8" else 40, cell)
    mesh = grid(*frame)
    u = wavy(mesh.nodes)
    f, g = pictures(frame, [rest, wavy], SHAPE)
    reference, smoother = set_up(mesh, f)
    found = measure(reference, smoother, g)
    assert found.converged and found.iterations <= 8
    assert np.sqrt(np.mean((found.u_px - u) ** 2)) < BIAS


def test_noise_moves_the_nodes_by_as_much_as_the_covariance_says_and_in_proportion():
    mesh = grid(*FRAME)
    f0, g0 = pictures(FRAME, [rest, wavy], SHAPE)
    rng = np.random.default_rng(3)
    scatter = {}
    for noise in (2.0, 6.0):
        errors = []
        for _ in range(12):
            f, g = (image + noise * rng.standard_normal(SHAPE).astype(np.float32) for image in (f0, g0))
            reference, smoother = set_up(mesh, f, Regularisation("mechanical", 40.0))
            found = measure(reference, smoother, g)
            errors.append(found.u_px)
        scatter[noise] = np.std(errors, axis=0, ddof=1)
        predicted = found.node_std(reference, noise)
        ratio = np.sqrt(np.mean(scatter[noise] ** 2) / np.mean(predicted**2))
        assert abs(ratio - 1) < 0.15  # 12 draws x 126 correlated values: 4 %; the noise of f in H lowers the prediction
    assert np.sqrt(np.mean(scatter[6.0] ** 2) / np.mean(scatter[2.0] ** 2)) == pytest.approx(3.0, rel=0.15)


@pytest.mark.parametrize("brightness", ["frame", "patch"])
def test_gain_and_offset_change_neither_motion_nor_residual(brightness):
    mesh = grid(*FRAME)
    f, g = pictures(FRAME, [rest, wavy], SHAPE)
    reference, smoother = set_up(mesh, f)
    plain = measure(reference, smoother, g, brightness=brightness)
    lit = measure(reference, smoother, 0.8 * g - 10.0, brightness=brightness)
    assert lit.converged
    assert np.abs(lit.u_px - plain.u_px).max() < 2e-3  # the stopping tolerance is 5e-4 rms
    assert lit.brightness[0] == pytest.approx((1 + plain.brightness[0]) * 0.8 - 1, abs=1e-3)
    assert lit.rms_gv == pytest.approx(0.8 * plain.rms_gv, rel=0.02)


def test_nodes_that_no_pixel_reaches_are_nan_and_their_neighbours_are_carried_on():
    mesh = grid(*FRAME)
    u = 0.01 * mesh.nodes - 0.5  # affine: passes any regularisation
    f, g = pictures(FRAME, [rest, lambda x: 0.01 * x - 0.5], SHAPE)
    mask = np.zeros(SHAPE, dtype=bool)
    mask[:, :96] = True
    reference, smoother = set_up(mesh, f, Regularisation("none"), mask)
    found = measure(reference, smoother, g)
    seen = np.isfinite(found.u_px).all(axis=1)
    assert not seen[mesh.nodes[:, 0] > 140].any() and seen[mesh.nodes[:, 0] < 96].all()
    carried = seen & (mesh.nodes[:, 0] > 100)  # one element beyond the last pixel
    assert carried.any()
    assert np.abs(found.u_px - u)[carried].max() < 10 * BIAS  # bias of the strain x 20 px, twice
    assert np.isfinite(found.u_full_px).all()


def test_a_region_that_left_the_image_is_left_out_and_the_rest_is_right():
    mesh = grid(*FRAME)
    u = np.tile([0.0, -62.5], (mesh.n_nodes, 1))
    f, g = pictures(FRAME, [rest, lambda x: np.tile([0.0, -62.5], (len(x), 1))], SHAPE)
    reference, smoother = set_up(mesh, f)
    found = measure(reference, smoother, g, start=u + 0.4)
    assert found.n_lost == np.count_nonzero(reference.pixel_map.iy < 63)
    assert found.converged
    visible = mesh.nodes[:, 1] > 75
    assert np.abs(found.u_px - u)[visible].max() < BIAS
    assert np.isnan(found.u_px[mesh.nodes[:, 1] < 20]).all()  # two elements beyond what is seen


def test_excluded_pixels_do_not_count():
    mesh = grid(*FRAME)
    u = wavy(mesh.nodes)
    f, g = pictures(FRAME, [rest, wavy], SHAPE)
    reference, smoother = set_up(mesh, f, Regularisation("mechanical", 40.0))
    out = np.flatnonzero((reference.pixel_map.ix > 79) & (reference.pixel_map.ix < 102))
    spoilt = g.copy()
    spoilt[:, 82:99] = 255.0
    found = measure(reference, smoother, spoilt, exclude=out)
    assert found.converged and len(out) == found.n_lost
    assert np.nanmax(np.abs(found.u_px - u)) < 0.15  # a third of the wave's amplitude, bridged over 22 px
