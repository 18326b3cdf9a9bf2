"""One small experiment for all tests of batches, and beside it one that cannot be read."""

from __future__ import annotations

import shutil

import pytest

from idic.virtual_tests.examples import write_example


@pytest.fixture(scope="session")
def strips(tmp_path_factory):
    """Folders ``strip``, and ``broken`` with a law that does not exist."""
    top = tmp_path_factory.mktemp("strips")
    write_example("demo", top / "strip", reduced=True)
    shutil.copytree(top / "strip", top / "broken")
    file = top / "broken" / "experiment.toml"
    file.write_text(file.read_text().replace('"j2_linear"', '"j2_liner"'))
    return top
