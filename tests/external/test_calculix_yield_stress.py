"""Where the built-in J2 law and CalculiX differ at finite strain: the stress of the yield condition, and nothing
else."""

import shutil
import subprocess

import numpy as np
import pytest

from idic.laws import point
from idic.laws import compile as compile_law

E, NU, HARDENING = 70000.0, 0.3, 1500.0
STRAIN, STEPS = 0.03, 20
CUBE = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
pytestmark = pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed (Debian: calculix-ccx)")


def calculix(folder, yield_stress):
    """Force (N) and lateral strain of a cube of 1 mm, pulled in one direction and free in the others."""
    lines = ["*NODE, NSET=ALL", *(f"{i}, {x}, {y}, {z}" for i, (x, y, z) in enumerate(CUBE, 1)),
             "*ELEMENT, TYPE=C3D8, ELSET=BODY", "1, 1, 2, 3, 4, 5, 6, 7, 8", "*NSET, NSET=X0", "1, 4, 5, 8",
             "*NSET, NSET=X1", "2, 3, 6, 7", "*NSET, NSET=Y0", "1, 2, 5, 6", "*NSET, NSET=Z0", "1, 2, 3, 4",
             "*MATERIAL, NAME=M", "*ELASTIC", f"{E}, {NU}", "*PLASTIC", f"{yield_stress}, 0",
             f"{yield_stress + HARDENING}, 1",
             "*SOLID SECTION, ELSET=BODY, MATERIAL=M", "*BOUNDARY", "X0, 1, 1", "Y0, 2, 2", "Z0, 3, 3"]
    for k in range(1, STEPS + 1):
        lines += ["*STEP, NLGEOM, INC=100", "*STATIC, DIRECT", "1., 1.", "*BOUNDARY",
                  f"X1, 1, 1, {STRAIN * k / STEPS:.15g}",
                  "*NODE PRINT, NSET=X1, TOTALS=ONLY", "RF", "*NODE PRINT, NSET=X1", "U", "*END STEP"]
    (folder / "job.inp").write_text("\n".join(lines) + "\n")
    subprocess.run(["ccx", "-i", "job"], cwd=folder, check=True, capture_output=True)
    last = (folder / "job.dat").read_text().split("total force")[-1].splitlines()
    moved = [line.split() for line in last[3:] if len(line.split()) == 4]
    return float(last[2].split()[0]), float(moved[1][2])  # node 3 in y


def built_in(yield_stress, factor):
    """The same of the law, flow stress times a factor."""
    curve = point.uniaxial(compile_law("j2_linear", "finite"), [E, NU, yield_stress * factor, HARDENING * factor],
                           np.linspace(0.0, STRAIN, STEPS + 1))
    return curve.P[-1, 0, 0], curve.F[-1, 1, 1] - 1.0


@pytest.mark.parametrize("yield_stress", [10.0, 200.0])
def test_a_flow_stress_times_the_dilatation_is_that_of_calculix(tmp_path, yield_stress):
    """Kirchhoff stress tau = J sigma, and sigma is the flow stress of CalculiX."""
    force, lateral = calculix(tmp_path, yield_stress)
    dilatation = np.exp((1.0 - 2.0 * NU) * force / (1.0 + lateral) ** 2 / E)
    own, _ = built_in(yield_stress, 1.0)
    assert own / force - 1.0 == pytest.approx(1.0 / dilatation - 1.0, rel=0.05)  # -3.0e-4, -1.34e-3
    own, own_lateral = built_in(yield_stress, dilatation)
    assert own == pytest.approx(force, rel=5e-6)  # J before yielding differs a little from J at the end: 2e-6
    assert own_lateral == pytest.approx(lateral, rel=5e-5)
