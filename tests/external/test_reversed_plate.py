"""A plate with a hole under reversal, by CalculiX: isotropic and kinematic hardening are told apart."""

import pytest
import reversed_plate

import idic
from idic.run.systematic import systematic
from idic.workers.runner import SerialRunner

pytestmark = pytest.mark.slow
TRUTH = {"E": reversed_plate.E, "nu": reversed_plate.NU, "yield_stress": reversed_plate.YIELD,
         "hardening_1_H": reversed_plate.H, "backstress_1_C": reversed_plate.C}
KIRCHHOFF = 1.5e-3  # (1 - 2 nu) stress / E: CalculiX has the Cauchy stress in the yield condition
CONVECTED = 6e-3  # its back stress grows by itself per strain, idic's turns: half the strain, 1.2 % where it flows


def test_isotropic_and_kinematic_hardening_are_found_on_a_plate_with_a_hole(ccx, tmp_path):
    """Less the bias of the user's mesh, which `idic systematic` estimates."""
    (tmp_path / "ccx").mkdir()
    reversed_plate.write_folder(tmp_path / "test", reversed_plate.truth_by_calculix(tmp_path / "ccx"))
    result = idic.identify(str(tmp_path / "test"), out=str(tmp_path / "run"))
    assert result.status == "converged"
    found = systematic(tmp_path / "run", SerialRunner(), spread=False)["parameters"]
    for name, value in TRUTH.items():
        entry = found[f"sheet.{name}"]
        assert abs(entry["value"] - value) < 0.03 * value, name
        off = entry["value"] - entry["discretisation_bias"] - value
        different = KIRCHHOFF + (CONVECTED if name == "backstress_1_C" else 0.0)
        assert abs(off) < 2.0 * entry["std"] + different * value, name
        assert entry["std"] < 0.05 * value, name  # determined
