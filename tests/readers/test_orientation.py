"""The orientation tag of TIFF and EXIF turns an image as Pillow turns it, and a note says so."""

from __future__ import annotations

import numpy as np
import pytest
import tifffile
from PIL import Image, ImageOps

from idic.readers import open_stack, read_image

STORED = np.random.default_rng(3).integers(0, 2**16, (5, 7)).astype(np.uint16)


def write(folder, orientation: int, dtype, suffix: str):
    """The stored image with the tag, and the image that Pillow shows."""
    pixels, path = STORED.astype(dtype), folder / f"frame_{orientation}{suffix}"
    exif = Image.Exif()
    exif[274] = orientation
    Image.fromarray(pixels).save(folder / "shown.png", exif=exif)
    if suffix == ".tif":
        tifffile.imwrite(path, pixels, extratags=[(274, 3, 1, orientation, True)])
    else:
        path.write_bytes((folder / "shown.png").read_bytes())
    with Image.open(folder / "shown.png") as image:
        return path, np.asarray(ImageOps.exif_transpose(image))


@pytest.mark.parametrize("suffix", [".tif", ".png"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("orientation", range(10))  # 0 and 9 state nothing
def test_an_image_is_read_as_it_is_to_be_seen(tmp_path, orientation, dtype, suffix):
    path, shown = write(tmp_path, orientation, dtype, suffix)
    stack = open_stack([path])
    assert stack.shape == shown.shape and stack.frame(0).flags.c_contiguous
    np.testing.assert_array_equal(stack.frame(0), shown)
    np.testing.assert_array_equal(read_image(path), shown)  # a mask
    assert any(f"274 = {orientation}" in note for note in stack.notes()) == (orientation in range(2, 9))


def test_images_of_different_orientation_are_named(tmp_path):
    paths = [write(tmp_path, orientation, np.uint8, ".tif")[0] for orientation in (1, 3)]
    (note,) = open_stack(paths).notes()
    assert note.startswith("1 of 2 images (first frame_3.tif) are turned by 180°") and "camera" in note
