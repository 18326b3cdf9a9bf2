"""What the tests of the identification share."""

import pytest


@pytest.fixture(scope="session")
def clean():
    """Noise-free images and force of the standard twin."""
    from twin_runs import Twin, clean_images

    return clean_images(Twin())


@pytest.fixture(scope="module")
def plain(gallery):
    """The standard twin's experiment.toml and its identification  # path, state, result"""
    twin = gallery("twin")
    return twin.experiment / "experiment.toml", twin.state, twin.result
