"""One small experiment for all tests of batches, and beside it one that cannot be read."""

from __future__ import annotations

import shutil

import pytest
from virtual_tests.small_strip import write_small_strip


@pytest.fixture(scope="session")
def strips(tmp_path_factory):
    """Folders ``strip``, and ``broken`` with a law that does not exist."""
    top = tmp_path_factory.mktemp("strips")
    write_small_strip(top / "strip")
    shutil.copytree(top / "strip", top / "broken")
    file = top / "broken" / "experiment.toml"
    file.write_text(file.read_text().replace('"j2_linear"', '"j2_liner"'))
    return top
