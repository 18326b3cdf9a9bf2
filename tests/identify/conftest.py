"""What the tests of the identification share."""

import pytest


@pytest.fixture(scope="session")
def clean():
    """Noise-free images and force of the standard twin."""
    from twin_runs import Twin, clean_images

    return clean_images(Twin())


@pytest.fixture(scope="session")
def plain(clean, tmp_path_factory):
    """The standard twin's experiment.toml and its identification  # path, state, result"""
    from twin_runs import ELASTIC, FORCE, GRIPS, Twin, identify, write_folder

    folder = tmp_path_factory.mktemp("plain")
    path = write_folder(folder / "test", Twin(), ELASTIC + GRIPS + FORCE, clean)
    return path, *identify(path, folder / "run")
