"""Still frames and averaged reference images: what is no exposure of the specimen at rest is refused or told."""

from __future__ import annotations

import numpy as np
import pytest
import tifffile
from scipy.ndimage import gaussian_filter, shift

from experiment_file.small_experiment import change, load, write_experiment
from idic.errors import InputError

NOISE_GV = 2.0
STILL = 'still_frames = "still/*.tif"\nkind ='


@pytest.fixture
def folder(tmp_path):
    folder = write_experiment(tmp_path / "test")
    change(folder, "experiment.toml", "noise_std_gv = 2.0", "")
    (folder / "still").mkdir()
    return folder


def exposure(number, moved=(0.0, 0.0)):
    """The specimen at rest, or moved by so many rows and columns  # (50, 60) float"""
    pattern = gaussian_filter(np.random.default_rng(3).standard_normal((70, 80)), 1.5)
    seen = shift(128.0 + 40.0 * pattern / pattern.std(), moved, order=3, mode="reflect")[10:60, 10:70]
    return seen + NOISE_GV * np.random.default_rng(100 + number).standard_normal(seen.shape)


def write(path, image, depth=np.uint8):
    tifffile.imwrite(path, np.clip(np.rint(image), 0, np.iinfo(depth).max).astype(depth))


def test_the_noise_of_still_frames_of_another_depth_is_refused(folder):
    """16 bit has 256 grey values to one of 8 bit: a noise of 2 was taken for 512."""
    for k in range(3):
        write(folder / "still" / f"s{k}.tif", 256.0 * exposure(k), np.uint16)
    with pytest.raises(InputError, match="still frames differ in depth") as caught:
        load(folder, "kind =", STILL)
    assert caught.value.expected.startswith("uint8") and caught.value.found == "uint16"


@pytest.mark.parametrize("spoiled, found", [
    (lambda path: write(path, np.full((50, 60), 3.0)), "s2.tif, with"),
    (lambda path: path.write_bytes((path.parent / "s1.tif").read_bytes()), "s2.tif repeats s1.tif")])
def test_a_closed_shutter_and_a_repeated_image_do_not_make_the_noise_too_small(folder, spoiled, found):
    """The gain between an image and a black one takes all of the difference; a repeated image has none: both count as
    noise of 0."""
    for k in range(5):
        write(folder / "still" / f"s{k}.tif", exposure(k))
    assert load(folder, "kind =", STILL).recording.noise.std_gv == pytest.approx(np.hypot(NOISE_GV, 12**-0.5), rel=0.05)
    spoiled(folder / "still" / "s2.tif")
    with pytest.raises(InputError, match=f"still_frames(.|\n)*{found}"):
        load(folder, "title", "title")


@pytest.mark.parametrize("moved, words", [
    ((0.0, 0.0), None), ((0.0, 0.2), "frame_001.tif has moved by 0.2"),
    ((9.0, 7.0), "frame_001.tif has moved by a speckle or more")])
def test_reference_images_that_are_not_at_rest_are_told(folder, moved, words):
    for k in range(4):
        write(folder / "images" / f"frame_{k:03d}.tif", exposure(k, moved if k == 1 else (0.0, 0.0)))
    notes = [note for note in load(folder, "kind =", "reference = [0, 1]\nkind =").notes if "at rest" in note]
    assert len(notes) == (words is not None) and (words is None or words in notes[0]), notes


def test_a_black_reference_image_is_refused(folder):
    for k in range(4):
        write(folder / "images" / f"frame_{k:03d}.tif", 0.0 * exposure(k) if k == 1 else exposure(k))
    with pytest.raises(InputError, match="experiment.reference: an image at rest shows no pattern"):
        load(folder, "kind =", "reference = [0, 1, 2]\nkind =")
