"""Scans in every accepted format, cut and flipped: a volume of the stated size, or one message."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import pytest
from commands import campaign
from hypothesis import strategies as st
from spoil_images import flips
from spoil_toml import splices

from idic.errors import InputError
from idic.readers import volume_entries
from readers.volume_files import FILES, VOXELS

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")
ALL, FEW = slice(None), slice(0, 2)


def read_or_refused(folder: Path, way: str) -> None:
    try:
        for entry in volume_entries(folder, way):
            part = ALL if max(entry.shape) <= 2 * max(VOXELS.shape) else FEW
            assert entry.block(part, part, part).shape == tuple(len(range(n)[part]) for n in entry.shape)
    except InputError as error:
        assert error.expected and error.found and error.remedy, str(error)


def a_spoilt_scan(way, k, part, changes):
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        FILES[way][0](folder / way)
        files = sorted(path for path in folder.rglob("*") if path.is_file())
        path = files[k % len(files)]
        content = path.read_bytes()
        path.write_bytes(content[:int(part * len(content))])
        read_or_refused(folder, way)
        path.write_bytes(content)
        for change in changes:
            path.write_bytes(change(path.read_bytes()))
        read_or_refused(folder, way)
        shutil.rmtree(folder / way, ignore_errors=True)


test_a_spoilt_scan, test_many_spoilt_scans = campaign(
    40, a_spoilt_scan, way=st.sampled_from(sorted(FILES)), k=st.integers(0, 30),
    part=st.floats(0, 1, exclude_max=True), changes=st.lists(flips | splices, min_size=1, max_size=3))
