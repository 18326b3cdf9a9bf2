"""A low-pass on a stretched specimen: the reference is compared with the blur that the frame has."""

from dataclasses import replace

import numpy as np
import pytest
from pictures import Texture, make_map, with_middles

from idic.correlation import PixelMap, ReferenceImage, nodal_equations, residual_map
from correlation.pixel_equations import normal_equations
from idic.fe import Block
from idic.images import Camera, dense_speckle, lowpass, lowpass_weights, prefilter
from idic.images import derivative_maps, matching_weights

LOWPASS, SIDE, RIM = 0.6, 160, 30
MIDDLE = np.full(2, (SIDE - 1) / 2)


def stretched(stretch, degrees=0.0, contraction=0.45):
    """Uniaxial stretch along a direction, narrower across."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[c, -s], [s, c]])
    return turn @ np.diag([stretch, stretch**-contraction]) @ turn.T


def squares(side=SIDE, rim=RIM, n=6):
    """A mesh of n x n quads away from the border of a square image."""
    x, y = np.meshgrid(*2 * [np.linspace(rim, side - 1 - rim, n + 1)])
    k = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    conn = np.stack([k[:-1, :-1], k[:-1, 1:], k[1:, 1:], k[1:, :-1]], axis=-1).reshape(-1, 4)
    nodes = np.column_stack([x.ravel(), y.ravel()])
    return PixelMap.of(nodes, [Block("quad4", conn, 0)], Camera.from_table(1.0, axes=("+col", "+row")),
                       (side, side))


def motion(pixel_map, F, middle=MIDDLE):
    return (pixel_map.nodes_px - middle) @ (F - np.eye(2)).T


def unmatched(reference):
    """The reference as it was compared before: with its own blur, whatever the stretch."""
    return replace(reference, image_gv=None)


def seen_by_a_camera(pattern, F, samples=3):
    """The stretched pattern on pixels with an area; without noise."""
    offset = (np.arange(samples) + 0.5) / samples - 0.5
    fine = (np.arange(SIDE)[:, None] + offset).ravel()
    points = np.stack(np.meshgrid(fine, fine), axis=-1).reshape(-1, 2)
    values = pattern.value((points - MIDDLE) @ np.linalg.inv(F).T + MIDDLE)
    return values.reshape(SIDE, samples, SIDE, samples).mean(axis=(1, 3))


def excess(reference, g, F, noise_gv):
    """chi^2 beyond that of the noise, of images without noise."""
    u, spline = motion(reference.pixel_map, F), prefilter(g, reference.degree, reference.lowpass_px)
    light = nodal_equations(reference, spline, u).brightness_fit().coefficients
    return residual_map(reference, spline, u, "frame", light).chi2_dof(noise_gv)


@pytest.mark.parametrize("degrees", [0.0, 35.0])
def test_at_the_true_motion_the_blur_of_a_stretched_frame_leaves_a_few_per_cent_of_chi2(degrees):
    """Speckle of 1.6 px, noise of 1 GV: the figures of docs/error-bars.md, with the defaults."""
    pattern, sigma = dense_speckle(np.random.default_rng(7), 1.6, 30.0, 225.0, extent_px=600.0), 1.0
    reference = ReferenceImage.of(squares(), seen_by_a_camera(pattern, np.eye(2)), 5, lowpass_px=LOWPASS)
    for stretch, allowed, before in ((1.05, 0.03, 0.08), (1.25, 0.03, 1.2), (1.7, 0.05, 6.0)):
        F = stretched(stretch, degrees)
        g = seen_by_a_camera(pattern, F)
        assert excess(reference, g, F, sigma) < allowed
        assert excess(unmatched(reference), g, F, sigma) > before


@pytest.mark.parametrize("F", [stretched(1.25), stretched(1.7, 35.0), stretched(0.8, 20.0),
                               np.array([[1.1, 0.4], [0.0, 1.0]])],
                         ids=["stretch", "large stretch", "compression", "shear"])
def test_the_matched_reference_is_what_the_frame_shows(F):
    """Plane waves: both blurs are known. Left is the sixth order in the wave, k^6 R^3/48 = 3 % of a k of 1.26, R of
    0.7."""
    weights = np.array(lowpass_weights(LOWPASS))
    position = np.arange(len(weights)) - len(weights) // 2
    wave = 2.0 * np.pi / 5.0 * np.column_stack([np.cos(angles := np.arange(0.1, np.pi, 0.25)), np.sin(angles)])

    def blurred(k):
        """What the low-pass leaves of a wave (n, 2)."""
        return (np.cos(k[:, :, None] * position) @ weights).prod(axis=1)

    at = np.arange(60)
    x = np.stack(np.meshgrid(at, at), axis=-1)
    iy, ix = (part[20:40, 20:40].ravel() for part in np.indices(x.shape[:2]))
    inverse = np.linalg.inv(F)
    mix = matching_weights(inverse[None], LOWPASS, 0.0)[0]
    for k, own, frame in zip(wave, blurred(wave), blurred(wave @ inverse), strict=True):  # k' = F^-T k
        image = own * np.cos(x @ k)
        matched = image[iy, ix] + mix @ derivative_maps(image, ix, iy)
        exact = frame * np.cos(x[iy, ix] @ k)
        assert np.abs(matched - exact).max() < 0.03
        assert np.abs(matched - exact).max() < 0.35 * np.abs(image[iy, ix] - exact).max() + 2e-3


@pytest.mark.parametrize("degree", [3, 5])
@pytest.mark.parametrize("kind", ["quad4", "quad8", "mixed"])
@pytest.mark.parametrize("shift", [(0.7, -0.4), (25.0, 3.0)], ids=["inside", "leaving"])
def test_the_image_kernel_agrees_with_the_equation_pixel_by_pixel(degree, kind, shift):
    texture = Texture()
    f, g = lowpass(texture.picture(), LOWPASS), lowpass(texture.picture(gradient=stretched(1.3, 20.0), shift=shift),
                                                        LOWPASS)
    reference = ReferenceImage.of(make_map(kind), texture.picture(), degree, lowpass_px=LOWPASS)
    pm, rng = reference.pixel_map, np.random.default_rng(0)
    u = (pm.nodes_px - 50.0) @ (stretched(1.28, 20.0) - np.eye(2)).T + shift + 0.1 * rng.normal(size=pm.nodes_px.shape)
    phi = rng.normal(size=(pm.n_nodes, 2, 3))
    slow = normal_equations(pm, f.astype(np.float32), g.astype(np.float32), u, phi, degree, LOWPASS)
    share = nodal_equations(reference, prefilter(g, degree), u, "none")
    assert share.n_lost == np.count_nonzero(~slow.valid) and (share.n_lost > 0.1 * pm.n_pixels) == (shift[0] == 25.0)
    gram = share.gram(phi.reshape(2 * pm.n_nodes, -1))
    size = np.linalg.norm(slow.L, axis=0)
    # float32 sums of pixels and maps: 1e-7 each, relative to the norms of the columns and of the residual
    assert (np.abs(gram.rhs - slow.b) / (size * np.linalg.norm(slow.r))).max() < 2e-6
    assert np.abs(gram.matrix - slow.M).max() < 2e-6 * size.max() ** 2
    found = residual_map(reference, prefilter(g, degree), u)
    assert np.abs(found.r - slow.r).max() < 1e-3  # GV of 255 in float32
    assert np.abs(residual_map(unmatched(reference), prefilter(g, degree), u).r - slow.r).max() > 1.0


@pytest.mark.parametrize("stretch", [1.0, 1.7, 0.7])
def test_chi2_of_noise_alone_is_one_at_any_stretch(stretch):
    side, sigma, rng = 500, 2.0, np.random.default_rng(0)
    f, g = sigma * rng.standard_normal((2, side, side))
    F, middle = stretched(stretch), np.full(2, (side - 1) / 2)
    reference = ReferenceImage.of(squares(side, 150), f, 5, lowpass_px=LOWPASS)
    found = residual_map(reference, prefilter(g, 5, LOWPASS), motion(reference.pixel_map, F, middle))
    # 4e4 px whose noise is alike over about 4 px: the mean of squares is known to 1.4 %
    assert found.chi2_dof(sigma) == pytest.approx(1.0, abs=0.05)
    if stretch == 1.7:  # a reference that is sharpened along the stretch has more noise
        assert replace(found, matched_gain=None).chi2_dof(sigma) > 1.07


def test_without_a_low_pass_or_without_stretch_no_bit_changes():
    texture = Texture()
    f, g = texture.picture(), texture.picture(gradient=stretched(1.2), shift=(0.7, -0.4))
    turn = np.array([[np.cos(0.2), -np.sin(0.2)], [np.sin(0.2), np.cos(0.2)]])
    for lowpass_px, F in ((0.0, stretched(1.2)), (LOWPASS, turn @ stretched(1.0003))):
        reference = ReferenceImage.of(make_map(), f, 5, lowpass_px=lowpass_px)
        spline, u = prefilter(g, 5, lowpass_px), motion(reference.pixel_map, F, (50.0, 40.0))
        one, other = (nodal_equations(r, spline, u) for r in (reference, unmatched(reference)))
        assert np.array_equal(one.q, other.q) and one.rr == other.rr
        assert "derivatives" not in vars(reference)  # nothing is made that is not needed


def test_the_weights_change_smoothly_where_they_begin_and_where_they_end():
    """From compression to stretch and beyond the limit, in small steps: no step of a search meets a jump."""
    stretches = np.linspace(0.4, 1.6, 2401)
    weights = matching_weights(np.array([np.linalg.inv(stretched(s, 10.0)) for s in stretches]), LOWPASS)
    slopes = np.abs(np.diff(weights, axis=0)) / np.diff(stretches)[:, None]
    assert slopes.max() < 2.0  # px² and px⁴ per unit of stretch: v (F^-1 F^-T)' at 0.65 is 0.44 * 3.6
    assert not weights[np.abs(stretches - 1.0) < 5e-4].any() and weights[0].any()


def test_an_element_that_a_search_flattens_has_finite_weights():
    inverse = np.array([np.zeros((2, 2)), np.diag([1e300, 1e-300]), np.diag([-1e9, 3.0])])
    assert np.isfinite(matching_weights(inverse, LOWPASS)).all()


def bent(points):
    """A motion whose strain goes from -10 to 10 % across the mesh  # (n, 2) px"""
    return 1e-3 * (points - MIDDLE) ** 2


def test_where_the_strain_has_a_gradient_the_blur_displaces_the_pattern(monkeypatch):
    """Of low-passed images without noise, at the true motion: the translation that they still seem to have."""
    side, corners = np.linspace(RIM, SIDE - 1 - RIM, 9), np.arange(81).reshape(9, 9)
    quads = np.stack([corners[:-1, :-1], corners[:-1, 1:], corners[1:, 1:], corners[1:, :-1]], axis=-1).reshape(-1, 4)
    nodes, cells = with_middles(np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2), quads)
    pm = PixelMap.of(nodes, [Block("quad8", cells, 0)], Camera.from_table(1.0, axes=("+col", "+row")), (SIDE, SIDE))
    offset = (np.arange(3) + 0.5) / 3 - 0.5
    fine = (np.arange(SIDE)[:, None] + offset).ravel()
    points = np.stack(np.meshgrid(fine, fine), axis=-1).reshape(-1, 2)
    material = points.copy()
    for _ in range(40):
        material = points - bent(material)
    left = {}
    for seed in range(4):
        pattern = dense_speckle(np.random.default_rng(seed), 1.6, 30.0, 225.0, extent_px=600.0)
        f, g = (pattern.value(at).reshape(SIDE, 3, SIDE, 3).mean(axis=(1, 3)) for at in (points, material))
        reference, u = ReferenceImage.of(pm, f, 5, lowpass_px=LOWPASS), bent(pm.nodes_px)
        gradient = np.column_stack([reference.fx, reference.fy]).astype(float)
        monkeypatch.undo()
        for name in ("with", "without"):
            if name == "without":
                monkeypatch.setattr(type(reference), "seen_motion", lambda self, motion, inverse: motion)
            r = residual_map(reference, prefilter(g, 5, LOWPASS), u).r
            left.setdefault(name, []).append(np.linalg.solve(gradient.T @ gradient, gradient.T @ r))
    found = {name: np.mean(values, axis=0) for name, values in left.items()}
    assert np.all(found["without"] > 2.5e-4)  # px; half of v times the second derivative is 4.4e-4
    assert np.all(np.abs(found["with"]) < 0.2 * found["without"])


def monomials(a, b):
    """Those that a field of an element is a sum of (docs/method.md, equation 3.6)  # (n,), (n,) -> (n, 8)"""
    return np.column_stack([a**0, a, b, a * b, a**2, b**2, a**2 * b, a * b**2])


def monomial_slopes(a, b):
    """By complex steps  # (n,), (n,) -> (n, 8, 2)"""
    return np.stack([monomials(a + 1e-20j, b).imag, monomials(a, b + 1e-20j).imag], axis=-1) / 1e-20


@pytest.mark.parametrize("kind", ["tri3", "quad4", "tri6", "quad8"])
def test_the_curvature_of_a_motion_is_that_of_difference_quotients(kind):
    pm, rng, h = make_map(kind), np.random.default_rng(0), 1e-3
    u = 0.5 * rng.normal(size=pm.nodes_px.shape)
    place, motion = (pm.element_coefficients(values) for values in (pm.nodes_px, u))
    inverse = np.linalg.inv(pm.deformation_gradient(u))
    at = np.einsum("eck,ek->ec", place, monomials(*pm.centre.T))

    def moved(offset):
        """The motion at the centres and some px beside, (n_elements, 2)."""
        a, b = pm.centre.T.copy()
        for _ in range(20):
            gap = at + offset - np.einsum("eck,ek->ec", place, monomials(a, b))
            slopes = np.einsum("eck,ekd->ecd", place, monomial_slopes(a, b))
            a, b = (np.column_stack([a, b]) + np.linalg.solve(slopes, gap[:, :, None])[:, :, 0]).T
        return np.einsum("eck,ek->ec", motion, monomials(a, b))

    quotient, along = np.empty((pm.n_elements, 2, 2, 2)), h * inverse  # its columns are the axes of the frame
    for i, j in np.ndindex(2, 2):
        one, two = along[:, :, i], along[:, :, j]
        both = moved(one + two) - moved(one - two) - moved(two - one) + moved(-one - two)
        quotient[:, :, i, j] = both / (4.0 * h**2)
    assert np.abs(pm.element_curvature(motion, inverse) - quotient).max() < 1e-5 + 1e-4 * np.abs(quotient).max()
    assert (np.abs(quotient).max() > 1e-3) == (kind != "tri3")
