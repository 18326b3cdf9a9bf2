"""Unexplained motion takes contrast from the images: what of it looks like light, and when light has to wait."""

from types import SimpleNamespace

import numpy as np
import pytest

from idic.diagnose.candidates import illumination, plasticity  # noqa: F401  registered
from idic.diagnose import HIDDEN_BY_MOTION, Misfit, Variant
from idic.diagnose.screen.misregistration import lost_contrast_chi2, reason_to_wait
from idic.images import dense_speckle

NOISE_GV = 2.0
LIGHT = (Variant("the light grows with time", {}, (), {}, pixels=("light", np.ones((1, 2)))),)
BODY = (Variant("yields", {}, ("sy",), {"sy": np.inf}),)


@pytest.fixture(scope="module")
def speckle():
    """Texture values at the points of an image and 0.01 px beside them, its mean taken off."""
    texture = dense_speckle(np.random.default_rng(3), 1.6, 30.0, 225.0, extent_px=200.0)
    points = np.stack(np.meshgrid(np.arange(-60.0, 60.0), np.arange(-60.0, 60.0)), axis=-1).reshape(-1, 2)
    return texture, points


def residual_of(f):
    context = SimpleNamespace(weights=SimpleNamespace(image_noise=NOISE_GV))
    cameras = (SimpleNamespace(grey_values=f, context=context),)
    return SimpleNamespace(cameras=cameras, evidence=SimpleNamespace(n_pixels=f.size))


def motions(chi2):
    return Misfit(np.arange(1, 3), np.array([chi2, 0.0]), np.array([0, 0]), np.zeros((2, 0)), 0.0)


@pytest.mark.parametrize("off", [0.2, 0.4])
def test_the_contrast_that_a_shift_takes_is_the_one_of_the_second_order(speckle, off):
    texture, points = speckle
    f, moved = texture.value(points), texture.value(points + [off, 0.0])
    slope = (texture.value(points + [0.01, 0.0]) - texture.value(points - [0.01, 0.0])) / 0.02
    gain = float((moved - f) @ (f - f.mean())) / float(((f - f.mean()) ** 2).sum())
    D = float((off * slope) @ (off * slope)) / NOISE_GV**2
    lost = gain**2 * float(((f - f.mean()) ** 2).sum()) / NOISE_GV**2
    assert gain < 0.0
    # fourth order of a shift of 0.4 px in dots of 1.6 px: a tenth of the gain, a fifth of its square
    assert lost_contrast_chi2(residual_of(f), motions(D)) == pytest.approx(lost, rel=0.3)


def test_light_waits_while_motion_is_left_and_laws_do_not(speckle):
    texture, points = speckle
    residual = residual_of(texture.value(points))
    assert reason_to_wait(LIGHT, residual, motions(1e6)) == HIDDEN_BY_MOTION
    assert not reason_to_wait(LIGHT, residual, motions(1e3)) and not reason_to_wait(BODY, residual, motions(1e6))
