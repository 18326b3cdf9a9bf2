"""What the tests of external solvers share."""

import shutil
import sys

import pytest

from idic.fe import PERMISSION


@pytest.fixture(autouse=True)
def python_may_be_started(monkeypatch):
    monkeypatch.setenv(PERMISSION, sys.executable)


@pytest.fixture(scope="session")
def ccx():
    """The program CalculiX, or a skip."""
    if shutil.which("ccx") is None:
        pytest.skip("CalculiX is not installed (Debian: apt install calculix-ccx)")
    return "ccx"
