"""The B-spline against SciPy, its sub-pixel behaviour, and the noise that it passes."""

import numpy as np
import pytest
from scipy import ndimage

from idic.errors import InputError
from idic.images import lowpass_weights, noise_gain, prefilter, weight_polynomials


def random_image(shape=(61, 83), seed=0):
    return np.random.default_rng(seed).integers(0, 256, shape).astype(np.uint8)


def random_points(shape, n=2000, seed=1):
    return np.random.default_rng(seed).uniform(0, 1, (n, 2)) * [shape[1] - 1, shape[0] - 1]


@pytest.mark.parametrize("degree", [3, 5])
@pytest.mark.parametrize("shape", [(61, 83), (9, 12), (17, 200), (130, 64)])
def test_the_spline_is_scipys_mirror_spline(degree, shape):
    image, points = random_image(shape), random_points(shape)
    coefficients = ndimage.spline_filter(image.astype(float), degree, mode="mirror")
    expected = ndimage.map_coordinates(coefficients, points[:, ::-1].T, order=degree, mode="mirror", prefilter=False)
    # float32 coefficients of +-2000 GV: 2e-4 GV for white noise; 1e-3 is 0.04 % of one grey level of noise
    assert np.abs(prefilter(image, degree).evaluate(points) - expected).max() < 1e-3


@pytest.mark.parametrize("degree", [3, 5])
@pytest.mark.parametrize("std_px", [0.3, 0.6, 1.5, 5.0])
@pytest.mark.parametrize("shape", [(61, 83), (9, 12), (130, 64)])
def test_the_spline_of_the_blurred_image_is_scipys(shape, std_px, degree):
    image = random_image(shape).astype(float)
    weights = np.array(lowpass_weights(std_px))
    blurred = ndimage.correlate1d(ndimage.correlate1d(image, weights, 0, mode="mirror"), weights, 1, mode="mirror")
    expected = ndimage.spline_filter(blurred, degree, mode="mirror")
    assert np.abs(prefilter(image, degree, std_px).coefficients[8:-8, 8:-8] - expected).max() < 2e-3  # float32, of 2000


@pytest.mark.parametrize("degree", [3, 5])
def test_the_rim_of_the_coefficients_is_the_mirrored_interior(degree):
    spline = prefilter(random_image(), degree)
    assert np.array_equal(spline.coefficients, np.pad(spline.coefficients[8:-8, 8:-8], 8, mode="reflect"))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64])
def test_the_spline_passes_through_the_grey_values(dtype):
    image = random_image().astype(dtype)
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]]
    values = prefilter(image).evaluate(np.column_stack([columns.ravel(), rows.ravel()]))
    assert np.abs(values - image.ravel()).max() < 1e-3  # float32, see above


@pytest.mark.parametrize("degree", [3, 5])
def test_the_gradient_is_the_derivative_of_the_value(degree):
    image = random_image()
    spline, points, h = prefilter(image, degree), 1 + random_points((59, 81)), 1e-4
    found = spline.gradient(points)
    for axis in range(2):
        step = np.eye(2)[axis] * h
        quotient = (spline.evaluate(points + step) - spline.evaluate(points - step)) / (2 * h)
        # evaluated in float64: h^2 f'''/6 ~ 1e-6 plus the kink of the second derivative within h of a pixel, ~h f''/2
        assert np.abs(found[:, axis] - quotient).max() < 500 * h


@pytest.mark.parametrize("degree", [3, 5])
def test_the_fast_gradient_at_pixels_is_the_gradient(degree):
    spline = prefilter(random_image(), degree)
    iy, ix = (i.ravel().astype(np.int32) for i in np.mgrid[:61, :83])
    fast = np.column_stack(spline.gradient_at_pixels(ix, iy))
    assert np.abs(fast - spline.gradient(np.column_stack([ix, iy]))).max() < 1e-4  # float32 of ~300 GV/px


def test_positions_outside_the_image_are_nan():
    spline = prefilter(random_image((20, 30)))
    values = spline.evaluate(np.array([[29.0, 19.0], [29.001, 3.0], [-1e-9, 3.0], [3.0, 19.5], [np.nan, 1.0]]))
    assert np.isfinite(values[0]) and np.isnan(values[1:]).all()


@pytest.mark.parametrize("degree", [3, 5])
def test_the_tap_weights_are_a_partition_of_unity(degree):
    t = np.linspace(0, 1, 11)
    weights = np.power.outer(t, np.arange(degree + 1)) @ weight_polynomials(degree)
    assert np.abs(weights.sum(axis=1) - 1).max() < 1e-14 and weights.min() > -1e-14  # rounding


def test_there_is_no_staircase_of_a_thirty_second_of_a_pixel():
    """cv2 rounds positions to 1/32 px: the value would stand still within a step. Ours moves at every 1/256."""
    rows, columns = np.mgrid[:20, :40]
    spline = prefilter((5.0 * columns).astype(np.float32))  # a ramp: slope 5 GV/px, no curvature
    x = 15 + np.arange(0, 1, 1 / 256)
    steps = np.diff(spline.evaluate(np.column_stack([x, np.full_like(x, 10.0)])))
    assert np.abs(steps - 5 / 256).max() < 1e-4  # float32 coefficients of 200 GV: 1.5e-5 each


@pytest.mark.parametrize("degree, expected", [(3, 0.764), (5, 0.843)])
def test_the_mean_noise_gain_is_the_known_one(degree, expected):
    fractions = np.linspace(0.0, 1.0, 1001)
    mean = np.trapezoid(noise_gain(fractions, degree=degree), fractions) ** 2  # over both axes
    assert abs(mean - expected) < 5e-4  # three published digits
    assert abs(noise_gain(0.0, degree=degree) - 1) < 1e-12 and abs(noise_gain(1.0, degree=degree) - 1) < 1e-12


@pytest.mark.parametrize("degree", [3, 5])
def test_the_noise_gain_is_the_variance_of_interpolated_white_noise(degree):
    spline = prefilter(np.random.default_rng(0).normal(size=(400, 400)).astype(np.float32), degree)
    rows, columns = np.mgrid[20:380, 20:380]
    for fx, fy in [(0.5, 0.5), (0.2, 0.0), (0.3, 0.7)]:
        values = spline.evaluate(np.column_stack([columns.ravel() + fx, rows.ravel() + fy]))
        # 130 000 correlated samples: relative std of a variance below 1 %
        assert abs(values.var() / noise_gain(fx, fy, degree=degree) - 1) < 0.03


@pytest.mark.parametrize("image, word", [(np.zeros((8, 50)), "usable"), (np.zeros((3, 50, 50)), "usable"),
                                         (np.full((50, 50), np.nan), "finite")])
def test_an_unusable_image_is_an_input_error(image, word):
    with pytest.raises(InputError, match=word):
        prefilter(image)


def test_an_unknown_degree_is_an_input_error():
    with pytest.raises(InputError, match="interpolation"):
        prefilter(np.zeros((50, 50)), 4)
