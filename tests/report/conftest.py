"""What several files of tests look at."""

import pytest
from made_up_run import make_record

from idic.report import draw_sections


@pytest.fixture(scope="session")
def sections():
    """Every figure of the made-up run; drawing them takes most of the time of a page."""
    return draw_sections(make_record())
