"""A strip that is warmed while it is pulled, by CalculiX: the temperature dependence of modulus and flow stress is found."""

import pytest
import warm_strip

import idic

pytestmark = pytest.mark.slow
TRUTH = {"E": warm_strip.E, "yield_stress": warm_strip.YIELD, "hardening_1_H": warm_strip.H, "alpha": warm_strip.ALPHA,
         "temperature_1_slope": warm_strip.E_SLOPE, "temperature_2_slope": warm_strip.FLOW_SLOPE}
KIRCHHOFF = 1.5e-3  # (1 - 2 nu) stress / E: CalculiX has the Cauchy stress in the yield condition


def test_modulus_flow_stress_and_expansion_are_found_over_the_temperature(ccx, tmp_path):
    (tmp_path / "ccx").mkdir()
    truth = warm_strip.truth_by_calculix(tmp_path / "ccx")
    warm_strip.write_folder(tmp_path / "test", truth)
    result = idic.identify(str(tmp_path / "test"))
    assert result.status == "converged"
    for name, value in TRUTH.items():
        entry = result.content["parameters"][f"sheet.{name}"]
        assert abs(entry["value"] - value) < 3.0 * entry["std"] + KIRCHHOFF * abs(value), name
        assert entry["std"] < 0.05 * abs(value), name  # determined
