"""One small experiment for all tests of batches, and beside it one that cannot be read."""

from __future__ import annotations

import shutil

import pytest

from idic.virtual_tests import examples
from idic.virtual_tests.demo import Size, strip

SMALL = Size(0.2, (60, 110), (3, 3, 4), (2, 2, 1), (3, 4, 2), 1)


@pytest.fixture(scope="session")
def strips(tmp_path_factory):
    """Folders ``strip``, and ``broken`` with a law that does not exist."""
    top = tmp_path_factory.mktemp("strips")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(examples.EXAMPLES, "small", lambda reduced, foreign: strip(SMALL))
        examples.write_example("small", top / "strip")
    shutil.copytree(top / "strip", top / "broken")
    file = top / "broken" / "experiment.toml"
    file.write_text(file.read_text().replace('"j2_linear"', '"j2_liner"'))
    return top
