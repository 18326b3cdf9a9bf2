"""One small experiment, and the result of the run that nothing disturbed."""

from __future__ import annotations

import os
from types import SimpleNamespace

import pytest
from fault_runs import finish, outcome, plain_run, stored_system

from idic.virtual_tests import write_example


@pytest.fixture(scope="session", autouse=True)
def script_folder(tmp_path_factory):
    os.environ["IDIC_TEST_SCRIPTS"] = str(tmp_path_factory.mktemp("scripts"))
    yield
    del os.environ["IDIC_TEST_SCRIPTS"]


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory, script_folder):
    """The demonstration, whose search takes several evaluations: experiment, run, and its result and M, b."""
    folder = tmp_path_factory.mktemp("undisturbed")
    write_example("demo", folder / "experiment", reduced=True)
    code, said = finish(plain_run(folder / "experiment", folder / "run", 0))
    assert code == 0, said
    return SimpleNamespace(experiment=folder / "experiment", run=folder / "run", result=outcome(folder / "run"),
                           system=stored_system(folder / "run"))


@pytest.fixture(scope="module")
def small(gallery):
    """Of 11 small frames that start near the truth: experiment, run, result, M and b."""
    strip = gallery("strip")
    return SimpleNamespace(experiment=strip.experiment, run=strip.run, result=outcome(strip.run),
                           system=stored_system(strip.run))
