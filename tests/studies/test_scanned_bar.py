"""The bar of `idic example volume` by CalculiX and by idic: two solvers, two yield conditions."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from idic.readers import Log
from idic.virtual_tests import write_example


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")
def test_calculix_and_idic_agree_on_the_bar(tmp_path):
    """The same seed gives both the same noise of the log."""
    folders = [write_example(name, tmp_path / name, reduced=True).parent for name in ("volume", "volume-calculix")]
    force, foreign_force = (np.asarray(Log.read(folder / "loads.csv").column("force_N"), float) for folder in folders)
    assert foreign_force[2] == pytest.approx(force[2], rel=1e-3)  # elastic but for the edge of the hole
    # Cauchy in place of Kirchhoff stress: the elastic dilatation, (1 - 2 nu) sigma / E = 0.6 % at 30 MPa
    assert foreign_force[3:] == pytest.approx(force[3:], rel=0.012)
    assert not np.array_equal(foreign_force[3:], force[3:])
