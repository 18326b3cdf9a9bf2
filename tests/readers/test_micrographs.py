"""Images of electron microscopes: the size of a pixel is read from their tags, the data bar is left out."""

import numpy as np
import pytest
import tifffile
from PIL import Image

from idic.readers import open_stack

RNG = np.random.default_rng(8)
PATTERN = RNG.integers(20, 230, (200, 256)).astype(np.uint8)
BAR = np.full((24, 256), 255, np.uint8)
BAR[[0, -1]] = 0
BAR[8:14, 20:90:3] = 0  # text
FEI = ("[User]\r\nDate=11/30/2026\r\n[Scan]\r\nPixelWidth={pixel}\r\nPixelHeight={pixel}\r\n[Image]\r\n"
       "ResolutionX=256\r\nResolutionY={rows}\r\n[PrivateFei]\r\nDatabarHeight={bar}\r\n")
ZEISS = "\r\n".join(["0", "0", "0", "{screen}", "0", "AP_PIXEL_SIZE", "Pixel Size = {named}"]) + "\r\n"


def write_tagged(path, image, code, text):
    tifffile.imwrite(path, image, extratags=[(code, 2, 0, text, True)], metadata=None)


def opened(path):
    stack = open_stack([path])
    return stack, stack.frame(0)


def test_an_fei_image_has_its_pixel_size_and_no_bar(tmp_path):
    write_tagged(tmp_path / "a.tif", np.vstack([PATTERN, BAR]), 34682, FEI.format(pixel=2.5e-9, rows=200, bar=24))
    stack, image = opened(tmp_path / "a.tif")
    np.testing.assert_array_equal(image, PATTERN)
    np.testing.assert_allclose(stack.grid.pitch_mm, 2.5e-6)
    assert "24 rows" in stack.notes()[0]


def test_an_fei_image_without_a_bar_is_whole(tmp_path):
    write_tagged(tmp_path / "a.tif", PATTERN, 34682, FEI.format(pixel=2.5e-9, rows=200, bar=0))
    stack, image = opened(tmp_path / "a.tif")
    np.testing.assert_array_equal(image, PATTERN)
    assert stack.notes() == []


@pytest.mark.parametrize("width", [256, 2048])
def test_the_pixel_of_a_zeiss_image_is_that_of_the_file_and_not_of_the_screen(width, tmp_path):
    image = np.tile(np.vstack([PATTERN, BAR, PATTERN[:1]]), (1, width // 256))  # Zeiss leaves a row below the bar
    write_tagged(tmp_path / "a.tif", image, 34118, ZEISS.format(screen=24.65e-9, named="24.65 nm"))
    stack, read = opened(tmp_path / "a.tif")
    np.testing.assert_allclose(stack.grid.pitch_mm, 24.65e-6 * 1024 / width)
    np.testing.assert_array_equal(read, image[:200])


def test_a_jeol_image_takes_scale_and_rows_from_the_text_beside_it(tmp_path):
    Image.fromarray(np.vstack([PATTERN, BAR])).save(tmp_path / "a.bmp")
    (tmp_path / "a.txt").write_text("$CM_FORMAT JEOL\r\n$CM_FULL_SIZE 256 200\r\n$$SM_MICRON_BAR 50\r\n"
                                    "$$SM_MICRON_MARKER 10um\r\n")
    stack, image = opened(tmp_path / "a.bmp")
    np.testing.assert_array_equal(image, PATTERN)
    np.testing.assert_allclose(stack.grid.pitch_mm, 10e-3 / 50)


def test_other_images_with_a_dark_edge_are_whole(tmp_path):
    image = np.vstack([PATTERN, np.zeros((24, 256), np.uint8)])
    tifffile.imwrite(tmp_path / "a.tif", image)
    (tmp_path / "a.txt").write_text("notes on the test\n")
    stack, read = opened(tmp_path / "a.tif")
    np.testing.assert_array_equal(read, image)
    assert stack.grid is None


def test_a_palette_with_colours_among_its_greys_gives_the_greys(tmp_path):
    palette = np.repeat(np.arange(256, dtype=np.uint16)[None], 3, axis=0) * 257
    palette[:, 9::9] = np.array([[65535], [0], [0]])
    image = PATTERN - (PATTERN % 9 == 0)
    image[3, 4] = 18
    tifffile.imwrite(tmp_path / "a.tif", image, photometric="palette", colormap=palette)
    stack, read = opened(tmp_path / "a.tif")
    np.testing.assert_array_equal(read, image)
    assert "overlay" in stack.notes()[0]
