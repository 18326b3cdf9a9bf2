"""A plate with a hole that loses stiffness as it flows, by CalculiX: plasticity and damage are told apart."""

import damaged_plate
import pytest
from plate_by_calculix import judged

pytestmark = pytest.mark.slow


def test_plasticity_with_stiffness_loss_is_found_on_a_plate_with_a_hole(ccx, tmp_path):
    """Less the bias of the user's mesh, which `idic systematic` estimates."""
    (tmp_path / "ccx").mkdir()
    truth = damaged_plate.truth_by_calculix(tmp_path / "ccx")
    assert truth[3].max() > 0.2  # the stiffness that is lost matters
    damaged_plate.write_folder(tmp_path / "test", truth)
    found = judged(tmp_path)
    for name, value in damaged_plate.TRUTH.items():
        entry = found[f"sheet.{name}"]
        assert abs(entry["value"] - entry["discretisation_bias"] - value) < 2.0 * entry["std"], name
        if entry["std"] < 0.03 * value:  # determined
            assert abs(entry["value"] - value) < 0.03 * value, name
