"""Plasticity with stiffness loss from images, on a bar whose truth is a closed form."""

import pytest
from damaged_bar import COURSE, TRUTH, damage, fitted_to_the_law, write_folder

import idic

pytestmark = pytest.mark.slow


def test_plasticity_and_stiffness_loss_are_told_apart_by_unloading(tmp_path):
    assert damage(COURSE[-1][0]) > 0.1  # the stiffness that is lost matters
    write_folder(tmp_path / "test")
    result = idic.identify(str(tmp_path / "test"), out=str(tmp_path / "run"))
    assert result.status == "converged"
    owed = fitted_to_the_law()
    for name, true in TRUTH.items():
        entry = result.parameters[f"sheet.{name}"]
        error, std, own = entry.value / true - 1.0, entry.std / true, owed[name] / true - 1.0
        print(f"{name} {100 * error:+.2f} %, std {100 * std:.2f} %, of the law's flow {100 * own:+.2f} %")
        assert abs(error - own) < 2.0 * std, name
        assert std > 0.03 or abs(error) < 0.03, name
