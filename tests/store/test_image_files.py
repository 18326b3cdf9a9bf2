"""Images are compared with what was ingested, wherever in a file they change."""

from __future__ import annotations

import os

import numpy as np
import pytest
import tifffile

from idic.errors import InputError
from idic.readers import open_stack
from idic.run.store.image_files import describe, refuse_changed
from idic.run import RunStore, ZarrStack

SHAPE = (400, 500)  # more than the identity of an experiment looks at


@pytest.fixture
def ingested(tmp_path):
    """Three image files, and the stack that they left in a RUN."""
    rng = np.random.default_rng(0)
    paths = [tmp_path / f"{k}.tif" for k in range(3)]
    for path in paths:
        tifffile.imwrite(path, rng.integers(0, 255, SHAPE, dtype=np.uint8))
    store = RunStore(tmp_path / "run")
    with store.claim("identity"):
        return paths, ZarrStack.of(store, open_stack(paths))


def change_the_middle(path, keep_time=False):
    status, content = path.stat(), bytearray(path.read_bytes())
    content[len(content) // 2] ^= 8
    path.write_bytes(content)
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns + (0 if keep_time else 1)))


def test_a_change_in_the_middle_of_an_image_is_told(ingested):
    paths, stack = ingested
    assert [file["name"] for file in stack.files] == ["0.tif", "1.tif", "2.tif"]
    refuse_changed(open_stack(paths), stack.files)
    change_the_middle(paths[1])
    with pytest.raises(InputError, match="has changed") as refused:
        refuse_changed(open_stack(paths), stack.files)
    assert refused.value.file == paths[1] and refused.value.remedy


def test_a_copy_with_another_time_is_the_same_image(ingested):
    paths, stack = ingested
    os.utime(paths[0], ns=(1, 1))
    refuse_changed(open_stack(paths), stack.files)


def test_an_image_is_only_read_where_size_or_time_have_changed(ingested, monkeypatch):
    paths, stack = ingested
    change_the_middle(paths[1], keep_time=True)
    refuse_changed(open_stack(paths), stack.files)  # what a file system says is believed: a resume costs no reading


def test_pages_of_one_file_are_described_once(tmp_path):
    path = tmp_path / "pages.tif"
    tifffile.imwrite(path, np.zeros((4, *SHAPE), np.uint8), photometric="minisblack")
    store = RunStore(tmp_path / "run")
    with store.claim("identity"):
        stack = ZarrStack.of(store, open_stack([path]))
    assert stack.n_frames == 4 and list(stack.files) == [describe(path)]


def test_a_description_survives_a_missing_chunk(ingested):
    """Then images are ingested anew, which must be the same ones."""
    _, stack = ingested
    chunk = next(file for file in (stack.group / "frames" / "c").rglob("*") if file.is_file())
    chunk.unlink()
    store = RunStore(stack.group.parents[1])
    assert store.finished("images") is None and ZarrStack(store.described("images")).files == stack.files
