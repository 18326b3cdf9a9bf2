"""The bar of `idic example volume` by CalculiX and by idic: two solvers, two yield conditions, one motion."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from idic.readers import read_log, volume_entries
from idic.virtual_tests import write_example

ALL = slice(None)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")
def test_calculix_and_idic_agree_on_the_bar(tmp_path):
    """The same seed gives both the same texture, noise and readings but for the motion."""
    folders = [write_example(name, tmp_path / name, reduced=True).parent for name in ("volume", "volume-calculix")]
    force, foreign_force = (np.asarray(read_log(folder / "loads.csv").column("force_N"), float) for folder in folders)
    assert foreign_force[2] == pytest.approx(force[2], rel=1e-3)  # elastic but for the edge of the hole
    # Cauchy in place of Kirchhoff stress: the elastic dilatation, (1 - 2 nu) sigma / E = 0.6 % at 30 MPa
    assert foreign_force[3:] == pytest.approx(force[3:], rel=0.012)
    assert not np.array_equal(foreign_force[3:], force[3:])
    scans = [[entry.block(ALL, ALL, ALL).astype(float) for entry in volume_entries(folder, "scans/*.tif")]
             for folder in folders]
    for own_scan, foreign_scan in zip(*scans, strict=True):  # motions differ by less than 0.015 voxel
        assert np.std(foreign_scan - own_scan) < 0.015 * np.std(np.gradient(own_scan)[0]) + 0.5
