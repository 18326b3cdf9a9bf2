"""The script that runs a command on Slurm jobs, as far as it goes without Slurm (`deploy/checks` has the rest)."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

SCRIPT = Path(__file__).parents[2] / "deploy" / "slurm_cluster.py"


@pytest.fixture
def script(monkeypatch):
    """Its functions; dask-jobqueue comes with the extra `slurm` and is not needed for them."""
    if importlib.util.find_spec("dask_jobqueue") is None:
        absent = ModuleType("dask_jobqueue")
        absent.SLURMCluster = None
        monkeypatch.setitem(sys.modules, "dask_jobqueue", absent)
    spec = importlib.util.spec_from_file_location("slurm_cluster", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("text, hours", [("240", 4.0), ("90:30", 1.5 + 30.0 / 3600.0), ("04:00:00", 4.0),
                                         ("1-12", 36.0), ("1-12:30", 36.5), ("2-00:00:36", 48.01)])
def test_a_walltime_is_read_as_slurm_reads_it(script, text, hours):
    """`man sbatch`, --time: a number alone is minutes; behind days the hours come first."""
    assert script.seconds(text) == pytest.approx(3600.0 * hours)
