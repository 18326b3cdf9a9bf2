"""Frames that are declared still, and are not."""

import numpy as np
import pytest
from scipy import ndimage

from idic.images import drift_note, shifts


def drifting(step, noise=2.0, shape=(160, 200)):
    """Three images of a speckle of 3 px, each shifted by `step` (row, column) from the one before, in falling light."""
    rng = np.random.default_rng(4)
    speckle = ndimage.gaussian_filter(rng.normal(size=shape), 3.0)
    speckle = 128.0 + 40.0 * speckle / speckle.std()
    return [ndimage.shift(speckle, np.array(step) * k, order=5, mode="mirror") * (1 - 0.01 * k)
            + rng.normal(scale=noise, size=shape) for k in range(3)]


def test_a_drift_of_a_sixth_of_a_pixel_is_measured_and_told():
    images = drifting((0.05, -0.07))
    # central differences of a 3 px speckle, with noise: a tenth at most
    np.testing.assert_allclose(shifts(images)[2], [-0.14, 0.10], atol=0.017)
    note = drift_note(images, ("a.tif", "b.tif", "c.tif"))
    assert "c.tif has moved by 0.17 px" in note and "against a.tif" in note


@pytest.mark.parametrize("step", [(0.0, 0.0), (0.01, 0.01)])
def test_nothing_is_said_of_frames_at_rest(step):
    assert drift_note(drifting(step), ("a", "b", "c")) == ""


def test_only_the_specimen_counts():
    images, mask = drifting((0.0, 0.0)), np.zeros((160, 200), dtype=bool)
    mask[:, :100] = True
    moving = drifting((0.0, 0.3))
    mixed = [np.where(mask, still, other) for still, other in zip(images, moving, strict=True)]
    assert drift_note(mixed, "abc", mask) == "" and drift_note(mixed, "abc", ~mask) != ""
