"""The bar of `idic example volume` by CalculiX and by idic: two solvers, two yield conditions, one motion."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from idic_studies.examples.scanned_bar import calculix_tension

from idic.virtual_tests.volume_bar import ELONGATION_MM, REDUCED, TRUTH, bar, tension


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")
def test_calculix_and_idic_agree_on_the_bar():
    mesh = bar("quad8", *REDUCED.true)
    u, force = tension(mesh, ELONGATION_MM, TRUTH)
    foreign_u, foreign_force = calculix_tension(mesh, ELONGATION_MM, TRUTH)
    assert np.abs(foreign_u - u).max() < 0.006 * ELONGATION_MM.max()
    assert foreign_force[2] == pytest.approx(force[2], rel=1e-3)  # elastic but for the edge of the hole
    # Cauchy in place of Kirchhoff stress: the elastic dilatation, (1 - 2 nu) sigma / E = 0.6 % at 30 MPa
    assert foreign_force[3:] == pytest.approx(force[3:], rel=0.012)
