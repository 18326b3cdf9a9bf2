"""The column sums of a cross-section against the pixelwise route, and what must hold of them whatever the numbers."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage
from section_cases import PIXEL, SHAPE, WIDTH, Surface, camera, layer_mesh, pixelwise, strip_mesh

from idic.correlation.height.cross_section import build_section_reference
from idic.correlation.pixels.section_map import RIM_PX, build_section_map
from idic.errors import InputError
from idic.images import Camera
from idic_studies.examples.bulge_mesh import Columns, bulge_mesh

SURFACE = Surface()
INNER = np.zeros(SHAPE, bool)
INNER[:, 13:-13] = True  # no column of it leaves the image


def whole(degree=5, mask=None, **more):
    mesh = strip_mesh(-WIDTH, WIDTH, 9)
    found = build_section_map(mesh, "TOP", camera(), SHAPE, mask, **more)
    return mesh, build_section_reference(found, SURFACE.image(), degree)


def levels(pm, n):
    """The levelling columns at the pixels  # (ny, n_columns, n)"""
    y = (np.arange(SHAPE[0]) - 0.5 * (SHAPE[0] - 1)) / (0.5 * SHAPE[0])
    x = (pm.column - 0.5 * (SHAPE[1] - 1)) / (0.5 * SHAPE[1])
    one = np.ones((SHAPE[0], pm.n_columns))
    return -np.stack([one, one * x, one * y[:, None]], axis=2)[..., :n]


@pytest.mark.parametrize("degree", [3, 5])
@pytest.mark.parametrize("levelling, n", [("none", 0), ("frame", 1), ("tilt", 3)])
def test_column_sums_are_the_sums_over_the_pixels(degree, levelling, n):
    rng = np.random.default_rng(1)
    mask = INNER & (rng.random(SHAPE) > 0.2)
    mesh, reference = whole(degree, mask)
    pm = reference.pixel_map
    motion = SURFACE.nodal(mesh, camera()) + rng.normal(0.0, 0.03, (mesh.n_nodes, 3))
    frame = SURFACE.deformed()
    share = reference.equations(frame, motion, levelling)
    r, L, *_ = pixelwise(pm, SURFACE.image(), frame, motion, degree)
    inside = pm.valid
    r, L, B = r[inside], L[inside], levels(pm, n)[inside]
    assert share.n_valid == inside.sum() and share.n_lost == 0
    for ours, sums in ((share.H.toarray(), L.T @ L), (share.hb.toarray(), L.T @ B), (share.bb, B.T @ B)):
        np.testing.assert_allclose(ours, sums, atol=3e-6 * np.abs(sums).max(initial=1.0))  # float32 slopes
    for ours, columns in ((share.q, L), (share.rb, B)):  # float32 heights and weights: 1e-6 um, alike in a column
        np.testing.assert_allclose(ours, columns.T @ r, atol=1e-6 * np.abs(columns).sum(axis=0).max(initial=1.0))
    assert share.rr == pytest.approx(r @ r, rel=1e-4)
    np.testing.assert_allclose(reference.residual_map(frame, motion).r, r, atol=2e-5)


def test_the_residual_vanishes_at_the_true_motion():
    mesh, reference = whole()
    found = reference.residual_map(SURFACE.deformed(), SURFACE.nodal(mesh, camera()))
    # the nodal motion is quadratic per element, the true one of fourth order: 2e-2 um; the pattern has 1.1 um
    assert np.sqrt(np.mean(found.r[found.valid] ** 2)) < 0.02
    fine = strip_mesh(-WIDTH, WIDTH, 60)
    reference = build_section_reference(build_section_map(fine, "TOP", camera(), SHAPE), SURFACE.image())
    found = reference.residual_map(SURFACE.deformed(), SURFACE.nodal(fine, camera()))
    assert np.sqrt(np.mean(found.r[found.valid] ** 2)) < 2e-4  # the quintic spline's own error


def test_the_derivative_of_the_residual_meets_a_difference_quotient():
    """L is the convected gradient: exact where the frame matches, that is at the true motion."""
    mesh = strip_mesh(-WIDTH, WIDTH, 60)
    reference = build_section_reference(build_section_map(mesh, "TOP", camera(), SHAPE, INNER), SURFACE.image())
    motion, frame = SURFACE.nodal(mesh, camera()), SURFACE.deformed()
    column = camera().project(mesh.nodes * [1.0, 0.0])[:, 0]
    change = np.stack([np.cos(column / 20.0), 0 * column, np.sin(column / 15.0)], axis=1)
    step = 0.02
    ahead, behind = (reference.residual_map(frame, motion + sign * step * change) for sign in (1.0, -1.0))
    pm = reference.pixel_map
    _, L, *_ = pixelwise(pm, SURFACE.image(), frame, motion)
    predicted = -(L @ change.ravel())[pm.valid]
    quotient = (ahead.r - behind.r) / (2 * step)
    assert np.sqrt(np.mean((quotient - predicted) ** 2)) < 2e-3 * np.sqrt(np.mean(predicted**2))  # step^2 and float32


def test_half_a_symmetric_section_gives_the_sums_of_the_whole():
    x = WIDTH * np.linspace(0.0, 1.0, 6) ** 1.2
    half, both = layer_mesh(x, 0.03), layer_mesh(np.concatenate([-x[:0:-1], x]), 0.03)
    seen = camera(shift=0.3)
    shares, motions = [], []
    for mesh, symmetric in ((half, True), (both, False)):
        found = build_section_map(mesh, "TOP", seen, SHAPE, symmetric=symmetric)
        reference = build_section_reference(found, SURFACE.image())
        r = np.abs(mesh.nodes[:, 0]) / PIXEL
        motion = np.stack([np.sign(mesh.nodes[:, 0]) * 0.02 * r, 0 * r, 40.0 - 0.002 * r**2], axis=1)
        shares.append(reference.equations(SURFACE.deformed(), motion))
        motions.append(motion)
    partner = np.array([np.argmin(np.hypot(*(half.nodes - point).T)) for point in np.abs(both.nodes)])
    fold = np.zeros((3 * both.n_nodes, 3 * half.n_nodes))
    for i, node in enumerate(partner):
        fold[3 * i + 2, 3 * node + 2] = 1.0
        fold[3 * i, 3 * node] = 1.0 if both.nodes[i, 0] >= 0 else -1.0
    scale = np.abs(shares[0].q).max()
    axis = np.flatnonzero(half.nodes[:, 0] == 0.0)
    free = np.setdiff1d(np.arange(3 * half.n_nodes), 3 * axis)  # the axis does not move sideways
    np.testing.assert_allclose(shares[0].q[free], (fold.T @ shares[1].q)[free], atol=1e-5 * scale)
    assert shares[0].n_valid == shares[1].n_valid
    assert shares[0].rr == pytest.approx(shares[1].rr, rel=1e-5)
    H = fold.T @ shares[1].H.toarray() @ fold
    np.testing.assert_allclose(shares[0].H.toarray()[np.ix_(free, free)], H[np.ix_(free, free)],
                               atol=1e-6 * np.abs(H).max())


def test_the_shared_noise_of_the_reference_is_summed_pixel_by_pixel():
    mesh, reference = whole(mask=np.random.default_rng(4).random(SHAPE) > 0.1)
    pm, rng = reference.pixel_map, np.random.default_rng(5)
    shared, S = 0.0, 0.0
    for size in (0.5, 1.0):
        surface = Surface(size=size)
        motion, columns = surface.nodal(mesh, camera()), rng.normal(size=(3 * mesh.n_nodes, 4))
        equations = reference.equations(surface.deformed(), motion, "tilt")
        shared = shared + reference.shared_columns(equations, columns, 3)
        _, L, *_ = pixelwise(pm, SURFACE.image(), surface.deformed(), motion)
        S = S + np.concatenate([L @ columns, levels(pm, 3)], axis=2)
    S = S[pm.valid]
    np.testing.assert_allclose(reference.gram_of(shared), S.T @ S, rtol=1e-5, atol=1e-5 * np.abs(S.T @ S).max())


def test_columns_that_leave_the_image_are_lost_and_in_no_sum():
    mesh, reference = whole()
    motion = SURFACE.nodal(mesh, camera())
    motion[:, 0] += 7.0
    share = reference.equations(SURFACE.deformed(), motion)
    pm = reference.pixel_map
    position = pm.column + pm.at_columns(motion[:, 0])
    lost = (position < RIM_PX) | (position > SHAPE[1] - 1 - RIM_PX)
    assert lost.any() and share.n_lost == lost.sum() * SHAPE[0] == share.lost.sum() == len(share.lost_pixels)
    found = reference.residual_map(SURFACE.deformed(), motion)
    assert found.valid.sum() == share.n_valid
    assert float((found.r.astype(float) ** 2).sum()) == pytest.approx(share.rr, rel=1e-5)


def test_missing_heights_and_spline_values_next_to_them_are_left_out():
    mesh, reference = whole(mask=INNER)
    motion, frame = SURFACE.nodal(mesh, camera()), SURFACE.deformed()
    full = reference.residual_map(frame, motion)
    frame[10, 50:53] = np.nan
    share, found = reference.equations(frame, motion), reference.residual_map(frame, motion)
    assert 3 < share.n_lost < 30 and found.valid.sum() == share.n_valid
    np.testing.assert_allclose(found.r[found.valid], full.r[found.valid], atol=2e-4)  # quintic: 0.43^9 of the gap
    _, masked = whole(mask=reference.pixel_map.to_image(found.valid.astype(float)) == 1.0)
    again = masked.equations(SURFACE.deformed(), motion)
    np.testing.assert_allclose(share.H.toarray(), again.H.toarray(), rtol=1e-6, atol=1e-3)
    np.testing.assert_allclose(share.q, again.q, atol=1e-4 * np.abs(again.q).max() + 1e-2)


def test_the_order_of_the_rows_does_not_matter():
    mesh, reference = whole()
    motion, frame = SURFACE.nodal(mesh, camera()), SURFACE.deformed()
    order = np.random.default_rng(0).permutation(SHAPE[0])
    turned = build_section_reference(reference.pixel_map, SURFACE.image()[order])
    a, b = reference.equations(frame, motion), turned.equations(frame[order], motion)
    np.testing.assert_allclose(a.q, b.q, rtol=1e-4, atol=1e-4 * np.abs(a.q).max())
    assert a.rr == pytest.approx(b.rr, rel=1e-5)


def test_chi2_is_one_for_mere_noise():
    mesh, reference = whole()
    rng, sigma = np.random.default_rng(3), 0.05
    image = SURFACE.image() + sigma * rng.standard_normal(SHAPE).astype(np.float32)
    noisy = build_section_reference(reference.pixel_map, image)
    frame = SURFACE.deformed() + sigma * rng.standard_normal(SHAPE).astype(np.float32)
    fine = SURFACE.nodal(mesh, camera())
    still = reference.residual_map(SURFACE.deformed(), fine).r.astype(float)  # what the mesh cannot follow
    found = noisy.residual_map(frame, fine)
    clean = replace(found, r=found.r - still.astype(np.float32))
    assert clean.chi2_dof(sigma) == pytest.approx(1.0, abs=0.06)  # 4000 correlated pixels: 3 standard deviations


def test_a_section_must_lie_along_the_image_rows():
    mesh = strip_mesh(-WIDTH, WIDTH, 9)
    with pytest.raises(InputError, match="along the image rows"):
        build_section_map(mesh, "TOP", Camera.from_table(PIXEL, (60, 20), rotation_deg=2.0), SHAPE)
    bent = Camera.from_table(PIXEL, (60, 20), k1=1e-7)
    with pytest.raises(InputError, match="along the image rows|distorting"):
        build_section_map(mesh, "TOP", bent, SHAPE, symmetric=True)


def test_every_column_has_one_edge_and_shape_functions_that_find_its_place():
    mesh = strip_mesh(-0.9 * WIDTH, 0.8 * WIDTH, 7)
    found = build_section_map(mesh, "TOP", camera(), SHAPE)
    assert len(np.unique(found.column)) == found.n_columns
    places = camera().project(mesh.nodes * [1.0, 0.0])[:, 0]
    np.testing.assert_allclose(found.at_columns(places), found.column, atol=1e-9)
    np.testing.assert_allclose(found.slope_at_columns(places), 1.0, atol=1e-9)
    narrower = build_section_map(mesh, "TOP", camera(), SHAPE, margin_px=3)
    assert found.n_columns - narrower.n_columns in (2, 3, 4, 5, 6)


@pytest.mark.parametrize("lowpass_px", [0.6, 3.0])
@pytest.mark.parametrize("gaps", ["holes", "row"])
def test_a_low_pass_carries_no_filled_height_into_a_pixel_that_counts(gaps, lowpass_px):
    """A low-pass smooths across rows: what it reaches from a gap is lost above and below it, too."""
    rng = np.random.default_rng(0)
    shape = (140, 192)
    rough = 50.0 + 10.0 * ndimage.gaussian_filter(rng.standard_normal(shape), 2.0)
    section = build_section_map(bulge_mesh(2e-3, Columns(6, 5, 10)), "TOP",
                                Camera.from_table(pixel_size=0.004, origin=(95.5, 69.5)), shape, None, True, 1)
    reference = build_section_reference(section, rough.astype(np.float32), 5, lowpass_px)
    frame = (rough + 0.01 * rng.standard_normal(shape)).astype(np.float32)
    whole = reference.residual_map(frame, np.zeros((section.n_nodes, 3)))
    if gaps == "row":
        frame[70] = np.nan
    else:
        for row, column in zip(rng.integers(5, 130, 12), rng.integers(10, 180, 12), strict=True):
            frame[row:row + 5, column:column + 5] = np.nan
    found = reference.residual_map(frame, np.zeros((section.n_nodes, 3)))
    assert 0.1 < found.valid.mean() < whole.valid.mean()
    assert found.chi2_dof(0.01) == pytest.approx(whole.chi2_dof(0.01), rel=0.1)
    assert np.abs(found.r[found.valid]).max() < 0.06
