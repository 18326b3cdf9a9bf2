"""Height images: the nodal route against the pixel-wise one, difference quotients, exact surfaces, gaps, levelling."""

import numpy as np
import pytest
from pictures import SHAPE, Texture, make_map

from idic.correlation.height.gaps import pixels_at_gaps, fill_gaps, height_frame
from correlation.height_pixel_equations import height_normal_equations
from idic.correlation.height.surface import (LEVELLING, build_height_reference, height_residual_map, height_equations,
                                             level_rises)
from idic.errors import InputError

KINDS = ["tri3", "quad4", "tri6", "quad8", "mixed", "mixed orders"]
STRETCH, SHIFT = np.array([[1.03, 0.02], [-0.01, 0.97]]), np.array([2.3, -1.4])
MIDDLE = np.array([60.0, 45.0])


@pytest.fixture
def roughness():
    """A surface in um, waves of 10 to 30 px: finer ones would show the spline's own error."""
    return Texture(shortest_px=10.0, longest_px=30.0, mean=7.0, std=1.5)


def moved(points):
    return MIDDLE + SHIFT + (points - MIDDLE) @ STRETCH.T


def tilt_and_rise(points):
    return 12.0 + 0.15 * (points[:, 0] - 60.0) - 0.08 * (points[:, 1] - 45.0)


def bulge(points):
    return tilt_and_rise(points) - 2e-3 * (points[:, 0] - 60.0) ** 2 + 1e-3 * (points[:, 0] - 60) * points[:, 1]


def surface(roughness, rise, shape=SHAPE):
    """g(x') = f(X) + h(X), x' = STRETCH (X - MIDDLE) + MIDDLE + SHIFT: exact, no interpolation."""
    rows, columns = np.mgrid[:shape[0], :shape[1]]
    x = np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(float)
    back = (x - MIDDLE - SHIFT) @ np.linalg.inv(STRETCH).T + MIDDLE
    return (roughness(back) + rise(back)).reshape(shape)


def motion_of(reference, rise):
    nodes = reference.pixel_map.nodes_px
    return np.column_stack([moved(nodes) - nodes, rise(nodes)])


def case(roughness, kind="quad4", degree=5, seed=0):
    """Reference, frame, a motion that is not the true one, and sensitivity fields."""
    f, g = roughness.picture(), surface(roughness, tilt_and_rise)
    reference = build_height_reference(make_map(kind), f, degree)
    rng = np.random.default_rng(seed)
    motion = motion_of(reference, tilt_and_rise)
    motion += rng.normal(scale=[0.1, 0.1, 0.2], size=motion.shape)
    return f, g, reference, motion, rng.normal(size=(*motion.shape, 4))


@pytest.mark.parametrize(("kind", "rise"), [("tri3", tilt_and_rise), ("quad4", tilt_and_rise), ("tri6", bulge),
                                            ("quad8", bulge)])
def test_the_true_motion_leaves_the_interpolation_error_only(roughness, kind, rise):
    reference = build_height_reference(make_map(kind, jitter=0.0, bend=0.0), roughness.picture(), 5)
    frame = height_frame(surface(roughness, rise), reference.level, 5)
    motion = motion_of(reference, rise)
    found = height_residual_map(reference, frame, motion)
    inner = found.valid & _away_from_the_rim(reference.pixel_map, 8)  # mirrored at the rim of the image
    # quintic spline on waves of 10 px and more: some 1e-4 of their amplitude
    assert np.abs(found.r[inner]).max() < 1e-3 and inner.sum() > 3000
    motion[:, 2] += 1.0
    assert height_residual_map(reference, frame, motion).r[inner].mean() == pytest.approx(1.0, abs=1e-3)


def _away_from_the_rim(pm, margin):
    back = moved(pm.points())
    return ((back > margin) & (back < np.array(SHAPE[::-1]) - 1 - margin)).all(axis=1)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("degree", [3, 5])
@pytest.mark.parametrize("leaving", [False, True], ids=["inside", "leaving"])
def test_nodal_and_pixelwise_normal_equations_agree(roughness, kind, degree, leaving):
    f, g, reference, motion, phi = case(roughness, kind, degree)
    motion[:, 0] += 25.0 * leaving
    slow = height_normal_equations(reference.pixel_map, f, g, motion, phi, degree)
    share = height_equations(reference, height_frame(g, reference.level, degree), motion)
    assert share.n_lost == np.count_nonzero(~slow.valid) and (share.n_lost > 0) == leaving
    gram = share.gram(phi.reshape(3 * len(motion), -1))
    size = np.linalg.norm(slow.L, axis=0)
    assert np.abs(gram.matrix - slow.M).max() < 1e-6 * size.max() ** 2  # float32 pixel sums: 1e-7 each
    # float32 heights of some 10 um, 2e-6 um each, in a residual of 0.14 um
    assert (np.abs(gram.rhs - slow.b) / (size * np.linalg.norm(slow.r))).max() < 1e-5
    assert abs(share.rr / np.sum(slow.r**2) - 1) < 1e-5
    assert abs(share.H - share.H.T).max() < 1e-12 * abs(share.H).max()  # rounding
    found = height_residual_map(reference, height_frame(g, reference.level, degree), motion)
    assert np.array_equal(found.valid, slow.valid)
    assert np.abs(found.r - slow.r).max() < 2e-4  # um of some 10: float32 coefficients and fractions


@pytest.mark.parametrize("kind", ["tri3", "quad4"])
def test_the_columns_are_the_difference_quotients_of_the_residual(roughness, kind):
    """Near the true motion: sum r dr = q . phi, with the slope of the rise in the gradient."""
    reference = build_height_reference(make_map(kind, jitter=0.0), roughness.picture(), 5)
    frame = height_frame(surface(roughness, lambda X: 5.0 * tilt_and_rise(X)), reference.level, 5)
    motion = motion_of(reference, lambda X: 5.0 * tilt_and_rise(X))
    phi = np.random.default_rng(3).normal(size=(*motion.shape, 3))
    f, g = roughness.picture(), surface(roughness, tilt_and_rise)
    slow = height_normal_equations(reference.pixel_map, f, g, motion, phi, 5)
    step = 1e-2
    for k in range(3):
        ahead, behind = (height_residual_map(reference, frame, motion + s * step * phi[:, :, k]) for s in (1, -1))
        seen = ahead.valid & behind.valid & _away_from_the_rim(reference.pixel_map, 8)
        quotient = (behind.r - ahead.r)[seen].astype(float) / (2 * step)  # L is minus the derivative of r
        # float32 residuals: 1e-5 um / 2e-2; curvature of the surface: step^2
        assert np.abs(quotient - slow.L[seen, k]).max() < 2e-3 * np.abs(slow.L[seen, k]).max()


def test_a_steep_rise_without_its_slope_in_the_gradient_would_be_wrong(roughness):
    """What the previous test would miss on a flat rise: here grad h is as large as grad f."""
    reference = build_height_reference(make_map("quad4", jitter=0.0), roughness.picture(), 5)
    flat, steep = motion_of(reference, lambda X: 0.0 * X[:, 0]), motion_of(reference, tilt_and_rise)
    frame = height_frame(surface(roughness, tilt_and_rise), reference.level, 5)
    along = np.tile([1.0, 0.0, 0.0], len(flat))[:, None]
    with_slope = height_equations(reference, frame, steep).gram(along).matrix[0, 0]
    without = height_equations(reference, frame, flat).gram(along).matrix[0, 0]
    n = reference.pixel_map.n_pixels
    # sum (f_x + h_x)^2 - sum f_x^2, over F_xx^2: the mean of f_x nearly vanishes
    assert with_slope - without == pytest.approx(n * 0.15**2 / 1.03**2, rel=0.3)


@pytest.mark.parametrize("levelling", ["frame", "tilt"])
def test_offset_and_tilt_of_the_instrument_are_found_and_removed(roughness, levelling):
    f, g, reference, _, _ = case(roughness)
    motion = motion_of(reference, tilt_and_rise)
    ny, nx = SHAPE
    rows, columns = np.mgrid[:ny, :nx]
    rest = np.zeros_like(motion)
    tilt = (levelling == "tilt") * (0.02 * (columns - 60.0) - 0.03 * (rows - 45.0))
    frame = height_frame(f + 4.0 + tilt, reference.level, 5)  # a specimen at rest
    share = height_equations(reference, frame, rest, levelling)
    fit = share.brightness_fit()
    assert share.n_brightness == LEVELLING[levelling] and fit.rr < 1e-6 * share.rr  # float32 sums
    found = height_residual_map(reference, frame, rest, levelling, fit.coefficients)
    assert np.abs(found.r).max() < 1e-4  # float32 heights of some um
    middle = reference.tilts[:, 1:] @ fit.coefficients[1:] if levelling == "tilt" else 0.0
    pm = reference.pixel_map
    assert np.mean(pm.interpolate(np.ones(pm.n_nodes) * fit.coefficients[0] + middle)) == pytest.approx(
        4.0 + (tilt[pm.iy, pm.ix]).mean(), rel=1e-4)
    # away from rest the same columns border the Gram matrix
    share = height_equations(reference, height_frame(g, reference.level, 5), motion, levelling)
    phi = np.random.default_rng(0).normal(size=(motion.size, 2))
    rises = level_rises(reference, levelling)
    whole = share.gram(np.hstack([phi, rises])).matrix
    bordered = share.gram(phi).matrix
    nb = len(rises.T)
    assert np.abs(whole[:2 + nb, 2:2 + nb] - bordered[:, 2:]).max() < 1e-9 * np.abs(whole).max()  # rounding


def test_an_unknown_levelling_is_an_input_error(roughness):
    _, g, reference, motion, _ = case(roughness)
    with pytest.raises(InputError, match="brightness"):
        height_equations(reference, height_frame(g, reference.level, 5), motion, "patch")


# gaps -------------------------------------------------------------------------------------------------------
def gappy(image, seed=1, share=0.004):
    rng = np.random.default_rng(seed)
    gaps = rng.random(image.shape) < share
    gaps[30:36, 50:58] = True  # a shadow
    return np.where(gaps, np.nan, image), gaps


@pytest.mark.parametrize("degree", [3, 5])
def test_pixels_near_gaps_are_in_no_sum_and_the_others_are_as_before(roughness, degree):
    f, g, reference, motion, phi = case(roughness, "quad4", degree)
    holed, gaps = gappy(g)
    frame = height_frame(holed, reference.level, degree)
    slow = height_normal_equations(reference.pixel_map, f, np.where(gaps, fill_gaps(g, gaps), g), motion, phi, degree,
                                   gaps)
    share = height_equations(reference, frame, motion)
    assert share.n_lost == np.count_nonzero(~slow.valid) > 100
    gram = share.gram(phi.reshape(3 * len(motion), -1))
    assert np.abs(gram.matrix - slow.M).max() < 1e-6 * np.abs(slow.M).max()
    assert np.abs(gram.rhs - slow.b).max() < 1e-5 * np.abs(slow.b).max()
    whole = height_residual_map(reference, height_frame(g, reference.level, degree), motion)
    found = height_residual_map(reference, frame, motion)
    # what a filled gap still does beyond the taps: some per cent of the filling's error, which is a good part of the
    # roughness (1.5 um) in the middle of the shadow; on the whole less than a fifth of a noise of 1 %
    assert np.abs(found.r - whole.r)[found.valid].max() < 0.05 * 1.5
    assert np.sqrt(np.mean((found.r - whole.r)[found.valid] ** 2)) < 0.2 * 0.015


def test_gaps_of_the_reference_are_left_out_of_the_pixel_map(roughness):
    holed, gaps = gappy(roughness.picture())
    blind = pixels_at_gaps(height_frame(holed, 0.0, 5))
    assert blind[gaps].all() and blind.sum() < 36 * gaps.sum()
    reference = build_height_reference(make_map(mask=~blind), holed, 5)
    assert np.isfinite(reference.f).all() and np.isfinite(reference.fx).all()
    frame = height_frame(roughness.picture(), reference.level, 5)
    rest = np.zeros((reference.pixel_map.n_nodes, 3))
    assert height_equations(reference, frame, rest).rr < 1e-6 * reference.pixel_map.n_pixels  # nothing moved


def test_a_plane_is_filled_exactly_and_extends_beyond_its_edge():
    rows, columns = np.mgrid[:60, :80]
    plane = 3.0 + 0.2 * columns - 0.1 * rows
    gaps = np.random.default_rng(0).random(plane.shape) < 0.1
    gaps[:, 70:] = True
    filled = fill_gaps(np.where(gaps, np.nan, plane), gaps)
    inner = np.where(columns < 70, np.abs(filled - plane), 0.0)
    assert inner.max() < 0.03  # the small weight that keeps a one-sided neighbourhood solvable, times the slope
    with pytest.raises(InputError, match="single value"):
        fill_gaps(plane, np.ones(plane.shape, bool))


def test_a_flat_reference_is_an_input_error():
    with pytest.raises(InputError, match="flat"):
        build_height_reference(make_map(), np.full(SHAPE, 2.0))


def test_a_large_offset_of_all_images_costs_no_digits(roughness):
    f, g, reference, motion, _ = case(roughness)
    lifted = build_height_reference(reference.pixel_map, f + 1e4, 5)
    near = height_equations(reference, height_frame(g, reference.level, 5), motion).rr
    far = height_equations(lifted, height_frame(g + 1e4, lifted.level, 5), motion).rr
    assert far == pytest.approx(near, rel=1e-6)  # counted from the level in double precision
