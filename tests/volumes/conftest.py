"""Virtual tomograms, rendered once per session."""

import pytest
from volumes.tomograms import Tomograms


@pytest.fixture(scope="session")
def bar(tmp_path_factory):
    """An elastic bar of another mesh in four scans, the first two at rest."""
    return Tomograms().write(tmp_path_factory.mktemp("volumes") / "bar")
