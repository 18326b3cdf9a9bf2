"""A pattern finer than the pixels can show looks blurred between the pixels, by as much as its own image predicts."""

import numpy as np
import pytest

from idic.images import blur_column, dense_speckle, lowpass, prefilter, subpixel_blur

SHAPE = (90, 120)  # px
RIM = 8  # px, where splines mirror the image
SAMPLES = 3  # of a pixel, along both axes


def pixels_of(surface, shift=(0.0, 0.0)):
    """An image of a surface moved by so many px; a pixel is the mean of its area."""
    inside = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    y, x = ((np.arange(n)[:, None] + inside).ravel() - by for n, by in zip(SHAPE, shift[::-1], strict=True))
    return surface(x, y).reshape(SHAPE[0], SAMPLES, SHAPE[1], SAMPLES).mean(axis=(1, 3))


def blur_seen(value, shift, lowpass_px, degree=5):
    """Blur of a moved image that least squares find beside a gain and an offset, px²."""
    still = lowpass(pixels_of(value).astype(np.float32), lowpass_px)
    moved = prefilter(pixels_of(value, shift), degree, lowpass_px)
    rows, columns = (part[RIM:-RIM, RIM:-RIM].ravel() for part in np.indices(SHAPE))
    left = still[rows, columns] - moved.evaluate(np.column_stack([columns + shift[0], rows + shift[1]]))
    base = np.column_stack([blur_column(still)[rows, columns], still[rows, columns], np.ones(len(left))])
    return np.linalg.lstsq(base, left, rcond=None)[0][0]


def dots(rng, size):
    """A painted surface  # columns (nx,), rows (ny,) -> (ny, nx)"""
    painted = dense_speckle(rng, size, 30.0, 225.0, extent_px=260.0)
    return lambda x, y: painted.value(np.array([part.ravel() for part in np.meshgrid(x, y)]).T).reshape(len(y), len(x))


def waves(rng, decay, n=400):
    """A surface of plane waves of up to one period per pixel, whose power falls by exp(-decay k)."""
    k, turn = rng.uniform(0.02, 1.0, n), rng.uniform(0.0, 2.0 * np.pi, n)
    size = 300.0 / np.sqrt(n) * np.exp(-0.5 * decay * k) * np.sqrt(k) * np.exp(2j * np.pi * rng.uniform(size=n))
    by_column, by_row = 2.0 * np.pi * k * np.cos(turn), 2.0 * np.pi * k * np.sin(turn)
    return lambda x, y: ((np.exp(1j * np.outer(y, by_row)) * size) @ np.exp(1j * np.outer(by_column, x))).real


@pytest.mark.parametrize(("surface", "lowpass_px", "degree"), [
    ("dots of 0.7 px", 0.6, 5), ("dots of 1 px", 0.6, 5), ("dots of 1 px", 0.0, 3), ("waves", 0.6, 5)])
def test_the_image_predicts_how_blurred_it_looks_between_the_pixels(surface, lowpass_px, degree):
    """Within half: what is beyond the pixels is extrapolated."""
    rng, noise = np.random.default_rng(1), 1.5
    value = waves(rng, 8.0) if surface == "waves" else dots(rng, float(surface.split()[2]))
    image = pixels_of(value) + noise * rng.standard_normal(SHAPE)
    region = np.ones(SHAPE, dtype=bool)
    region[30:55, 50:75] = False  # a hole, whose edge is no detail of the pattern
    found = subpixel_blur(np.where(region, image, 0.0), region, degree, lowpass_px, noise**2)
    for axis, shift in enumerate(((0.5, 0.0), (0.0, 0.5))):
        seen = blur_seen(value, shift, lowpass_px, degree)
        assert seen > 0.0015
        assert found[axis] == pytest.approx(seen, rel=0.5)


def test_it_grows_with_the_square_of_the_sine_of_pi_times_the_motion():
    value = dots(np.random.default_rng(1), 0.7)
    half, quarter, both = (blur_seen(value, shift, 0.6) for shift in ((0.5, 0.0), (0.25, 0.0), (1.75, 0.5)))
    assert quarter == pytest.approx(0.5 * half, rel=0.1)
    assert both == pytest.approx(quarter + blur_seen(value, (0.0, 0.5), 0.6), rel=0.1)


@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_a_pattern_of_whole_pixels_does_not(noise):
    rng = np.random.default_rng(2)
    image = pixels_of(dots(rng, 2.5)) + noise * rng.standard_normal(SHAPE)
    assert (subpixel_blur(image, np.ones(SHAPE, dtype=bool), 5, 0.6, noise**2) < 0.002).all()


def test_correlated_noise_is_no_pattern():
    """Of neighbours alike by 0.5: its waves near two pixels are weak, and all of them are noise."""
    rng = np.random.default_rng(3)
    white = rng.standard_normal((SHAPE[0] + 1, SHAPE[1] + 1))
    noise = 1.5 * (white[1:, 1:] + white[1:, :-1] + white[:-1, 1:] + white[:-1, :-1])
    value = dots(rng, 1.0)
    region, row = np.ones(SHAPE, dtype=bool), np.array([0.5, 1.0, 0.5])
    plain = subpixel_blur(pixels_of(value), region, 5, 0.6)
    noisy = subpixel_blur(pixels_of(value) + noise, region, 5, 0.6, 9.0, np.outer(row, row))
    assert noisy == pytest.approx(plain, rel=0.3)
