"""Images in every accepted format, cut, flipped, and of other kinds: the pixels that were taken, or one message."""

from __future__ import annotations

import numpy as np
import pytest
from base_experiments import base_folder
from commands import campaign, check, copy_of
from hypothesis import strategies as st
from spoil_images import CHECKED, STRANGERS, WAYS, flips, lines_of_xyz, pixels
from spoil_toml import splices

from idic.cli.outcomes import BAD_INPUT, DONE
from idic.experiment_file import load_experiment


def with_images(folder, way: str) -> list:
    """Replaces the images of an experiment; the new paths."""
    for old in (folder / "images").iterdir():
        old.unlink()
    suffix, _, write = WAYS[way]
    paths = [folder / "images" / f"frame_{k:03d}{suffix}" for k in range(4)]
    for k, path in enumerate(paths):
        path.write_bytes(write(k))
    toml = folder / "experiment.toml"
    toml.write_text(toml.read_text().replace("images/*.tif", f"images/*{suffix}"))
    return paths


def assert_the_pixels(folder, way: str) -> None:
    stack = load_experiment(folder).recording.stack
    assert stack.n_frames == 4
    for k in range(4):
        np.testing.assert_array_equal(stack.frame(k), pixels(k, WAYS[way][1]))


@pytest.mark.parametrize("way", WAYS)
def test_whole_images_are_read(way):
    with copy_of(base_folder("warm")) as folder:
        with_images(folder, way)
        answer = check(folder)
        assert answer.code == DONE, answer.said
        assert_the_pixels(folder, way)


def a_cut_image(way, k, part):
    with copy_of(base_folder("warm")) as folder:
        path = with_images(folder, way)[k]
        data = path.read_bytes()
        path.write_bytes(data[: int(part * len(data))])
        if check(folder).code == DONE:
            assert_the_pixels(folder, way)


def a_flipped_image(way, k, flipped):
    with copy_of(base_folder("warm")) as folder:
        path = with_images(folder, way)[k]
        for flip in flipped:
            path.write_bytes(flip(path.read_bytes()))
        if check(folder).code == DONE and way in CHECKED:
            assert_the_pixels(folder, way)


def a_scrambled_image(way, k, spoilt):
    with copy_of(base_folder("warm")) as folder:
        path = with_images(folder, way)[k]
        for splice in spoilt:
            path.write_bytes(splice(path.read_bytes()))
        if check(folder).code == DONE and way in CHECKED:
            assert_the_pixels(folder, way)


def an_irregular_grid(k, spoilt):
    with copy_of(base_folder("warm")) as folder:
        path = with_images(folder, "xyz")[k]
        path.write_bytes(spoilt(path.read_bytes()))
        assert check(folder).code == BAD_INPUT


def a_strange_image(way, k, stranger):
    with copy_of(base_folder("warm")) as folder:
        with_images(folder, way)[k].write_bytes(STRANGERS[stranger])
        assert check(folder).code == BAD_INPUT


ways, frames = st.sampled_from(sorted(WAYS)), st.integers(0, 3)
test_a_cut_image, test_many_cut_images = campaign(
    12, a_cut_image, way=ways, k=frames, part=st.floats(0, 1, exclude_max=True)
)
test_a_flipped_image, test_many_flipped_images = campaign(
    15, a_flipped_image, way=ways, k=frames, flipped=st.lists(flips, min_size=1, max_size=3)
)
test_a_flipped_png, test_many_flipped_pngs = campaign(
    10,
    a_flipped_image,
    share=0.5,
    way=st.sampled_from(CHECKED),
    k=frames,
    flipped=st.lists(flips, min_size=1, max_size=1),
)
test_a_scrambled_image, test_many_scrambled_images = campaign(
    10, a_scrambled_image, share=0.5, way=ways, k=frames, spoilt=st.lists(splices, min_size=1, max_size=2)
)
test_a_strange_image, test_many_strange_images = campaign(
    12,
    a_strange_image,
    share=0.5,
    way=st.sampled_from(["tiff", "tiff 16", "png", "bmp", "xyz"]),
    k=frames,
    stranger=st.sampled_from(sorted(STRANGERS)),
)
test_an_irregular_grid, test_many_irregular_grids = campaign(
    10, an_irregular_grid, share=0.3, k=frames, spoilt=lines_of_xyz
)
