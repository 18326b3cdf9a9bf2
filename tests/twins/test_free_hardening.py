"""A free hardening curve finds laws that it was not told."""

import numpy as np
import pytest
from free_hardening import FORMS, FREE, true_flow_stress, truth_of, write_folder

import idic
from idic.materials.composed.free_curve import basis

pytestmark = pytest.mark.slow
RANGE = 0.12


@pytest.mark.parametrize("form", ["swift", "voce", "ludwik"])
def test_a_free_curve_is_the_true_one_within_one_percent(tmp_path, form):
    truth = truth_of(form)
    material = FREE.replace("KNOTS", '"evidence"').replace("RANGE", str(RANGE))
    write_folder(tmp_path / "test", truth, 0, material)
    result = idic.identify(str(tmp_path / "test"))
    assert result.status == "converged"
    entries = [entry for name, entry in result.content["parameters"].items()
               if name == "sheet.yield_stress" or name.startswith("sheet.hardening_1_s")]
    p = np.linspace(0.0, np.percentile(truth.plastic_strain, 99.0), 60)
    found = basis(p, RANGE, len(entries)) @ np.maximum.accumulate([entry["value"] for entry in entries])
    assert any("by their evidence" in note for note in result.content["notes"])
    expected = np.array([true_flow_stress(*FORMS[form], x)[0] for x in p])
    assert np.abs(found / expected - 1.0).max() < 0.01
