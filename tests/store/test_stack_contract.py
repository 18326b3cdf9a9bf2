"""Every store of images keeps one contract: in memory, in files, in the RUN, and what is seen through another stack."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import tifffile

from idic.images import ArrayStack, LeadingFrames, NoisyStack, Stack
from idic.readers import open_stack
from idic.run import RunStore, ZarrStack

IMAGES = np.random.default_rng(1).integers(0, 256, (20, 11, 13), dtype=np.uint8)


def in_files(folder):
    for k, image in enumerate(IMAGES):
        tifffile.imwrite(folder / f"{k:02d}.tif", image)
    return open_stack(sorted(folder.glob("*.tif")))


def in_a_run(folder):
    store = RunStore(folder / "run")
    with store.claim("identity"):
        ZarrStack.of(store, ArrayStack(IMAGES))
    return ZarrStack(store.group("images"))


STACKS = {"memory": lambda folder: ArrayStack(IMAGES), "files": in_files, "run": in_a_run,
          "leading frames": lambda folder: LeadingFrames(ArrayStack(np.concatenate([IMAGES, IMAGES])), len(IMAGES)),
          "without noise": lambda folder: NoisyStack(ArrayStack(IMAGES), 0.0, 1)}


@pytest.fixture(params=STACKS)
def stack(request, tmp_path):
    return STACKS[request.param](tmp_path)


def test_a_stack_gives_the_frames_that_it_was_given(stack):
    assert isinstance(stack, Stack) and stack.n_frames == len(IMAGES) and stack.shape == IMAGES.shape[1:]
    for k, image in enumerate(IMAGES):
        np.testing.assert_array_equal(stack.frame(k), image)
        assert stack.frame(k).dtype in (np.uint8, np.uint16, np.float32)


def test_a_frame_beyond_the_last_is_an_index_error(stack):
    with pytest.raises(IndexError):
        stack.frame(len(IMAGES))


def test_threads_read_the_same_frames(stack):
    """In an order that no cache of the last frame likes."""
    order = np.random.default_rng(2).integers(0, len(IMAGES), 60).tolist()
    with ThreadPoolExecutor(4) as threads:
        for k, frame in zip(order, threads.map(stack.frame, order), strict=True):
            np.testing.assert_array_equal(frame, IMAGES[k])
