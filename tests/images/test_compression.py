"""Blocks of JPEG in grey values that a lossless file holds."""

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from idic.images import compressed_at


def speckle(noise_gv: float, size: tuple[int, int] = (300, 420)) -> np.ndarray:
    rng = np.random.default_rng(4)
    pattern = gaussian_filter(rng.standard_normal(size), 1.5)
    image = 120.0 + 45.0 * pattern / pattern.std() + noise_gv * rng.standard_normal(size)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def through_jpeg(image: np.ndarray, quality: int) -> np.ndarray:
    return cv2.imdecode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_GRAYSCALE)


@pytest.mark.parametrize("noise_gv", [0.0, 0.5, 2.0, 5.0])
def test_images_of_a_camera_have_no_blocks(noise_gv):
    image = speckle(noise_gv)
    assert compressed_at(image) is None
    assert compressed_at(image.astype(np.uint16) * 16) is None


@pytest.mark.parametrize("quality", [50, 70, 80, 90])
@pytest.mark.parametrize("noise_gv", [0.5, 2.0])
def test_blocks_are_found_where_they_begin_though_the_image_was_cut(quality, noise_gv):
    image = through_jpeg(speckle(noise_gv), quality)
    assert compressed_at(image) == (0, 0)
    assert compressed_at(image[3:, 5:]) == (5, 3)


def test_what_is_no_image_has_no_blocks():
    assert compressed_at(np.zeros((10, 200), dtype=np.uint8)) is None
    assert compressed_at(np.full((64, 64), np.nan)) is None
    assert compressed_at(np.full((64, 64), 7, dtype=np.uint8)) is None
