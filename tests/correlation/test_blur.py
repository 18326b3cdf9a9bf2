"""The column of a blur: what a Gaussian takes off an image, and what noise makes of it."""

import numpy as np
import pytest
from scipy import ndimage

from idic.correlation import GreyReference, PixelMap, ReferenceImage, nodal_equations
from idic.correlation.image_equations.grey import blur_of_noise, with_blur
from idic.correlation.image_equations.system import solve_positive
from idic.fe import make_mesh
from idic.images import Camera, blur_column, lowpass, prefilter
from idic.model import Noise


def test_a_gaussian_of_small_variance_takes_off_its_variance_times_the_column():
    y, x = np.mgrid[:64, :80]
    k, m = 2.0 * np.pi * 6 / 80, 2.0 * np.pi * 5 / 64
    image = np.cos(k * x) * np.cos(m * y)
    variance = 0.02
    blurred = np.exp(-0.5 * variance * (k**2 + m**2)) * image
    inner = (slice(4, -4), slice(4, -4))  # the mirror at the edge is no wave
    # fourth order at 13 px per wave: (k^4 / 90) of the whole; the exponential's curvature: variance k^2 / 4
    assert image[inner] - blurred[inner] == pytest.approx(variance * blur_column(image)[inner], abs=0.01 * variance)


@pytest.mark.parametrize("lowpass_px", [0.0, 0.6, 1.0])
def test_the_product_of_noise_with_its_own_column_has_the_expected_mean(lowpass_px):
    noise = np.random.default_rng(0).standard_normal((600, 600))
    seen = lowpass(noise, lowpass_px).astype(float)
    product = (seen * blur_column(seen))[5:-5, 5:-5]
    spread = 5.0 * product.std() / np.sqrt(product.size)  # neighbours are correlated: wider than 3 of the mean
    assert product.mean() == pytest.approx(blur_of_noise(lowpass_px), abs=spread)


@pytest.mark.parametrize("lowpass_px", [0.0, 0.6])
def test_so_has_noise_that_neighbours_share(lowpass_px):
    noise = lowpass(np.random.default_rng(1).standard_normal((600, 600)), 0.5).astype(float)
    noise /= noise.std()
    correlation = np.array([[np.mean(noise * np.roll(noise, (i, j), (0, 1))) for j in range(-4, 5)]
                            for i in range(-4, 5)])
    seen = lowpass(noise, lowpass_px).astype(float)
    product = (seen * blur_column(seen))[5:-5, 5:-5]
    spread = 5.0 * product.std() / np.sqrt(product.size)
    assert product.mean() == pytest.approx(blur_of_noise(lowpass_px, correlation), abs=spread)
    assert abs(product.mean() - blur_of_noise(lowpass_px)) > 3.0 * spread  # independent noise has another one


@pytest.mark.parametrize("brightness", ["frame", "patch"])
def test_the_blur_of_a_frame_that_shows_a_part_of_the_specimen_is_that_of_the_whole(brightness):
    """A strip leaves the view by up to 70 of 140 px under a blur of 0.055 px² and a gain of 0.9."""
    rng = np.random.default_rng(0)
    far = ndimage.gaussian_filter(rng.standard_normal((90, 360)), 1.6)
    far = 128.0 + 40.0 * far / far.std()
    x, y = np.meshgrid(np.linspace(10.0, 150.0, 9), np.linspace(10.0, 80.0, 5))
    corner = np.arange(45).reshape(5, 9)
    quads = np.stack([corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]], axis=2).reshape(-1, 4)
    mesh = make_mesh(np.column_stack([x.ravel(), y.ravel()]), [("quad4", quads)])
    pixel_map = PixelMap.of(mesh.nodes, mesh.blocks, Camera.from_matrix(np.eye(2)), (90, 160))
    reference = GreyReference(**vars(ReferenceImage.of(pixel_map, far[:, :160], 3, 40.0, 0.6, 4, None)))
    found = []
    for shift in (0, 20, 70):
        frame = ndimage.gaussian_filter(np.roll(far, shift, axis=1)[:, :160], np.sqrt(0.15))
        spline = prefilter((128.0 + 0.9 * (frame - 128.0)).astype(np.float32), 3, 0.6)
        u = np.tile([float(shift), 0.0], (mesh.n_nodes, 1))
        equations = with_blur(reference, nodal_equations(reference, spline, u, brightness), spline, brightness,
                              Noise(None))
        x = solve_positive(equations.bb, equations.rb)
        found.append(x[-1])
        left = equations.rr - 2.0 * x @ equations.rb + x @ equations.bb @ x
        assert 0.0 <= left < 0.02 * equations.rr
    np.testing.assert_allclose(found, found[0], atol=0.003)
