"""A free hardening curve finds laws that it was not told."""

import numpy as np
import pytest
from free_hardening import FORMS, FREE, true_flow_stress, truth_of, write_folder

import idic
from idic.materials.composed.free_curve import basis, level_names

pytestmark = pytest.mark.slow
KNOTS, RANGE = 12, 0.12


@pytest.mark.parametrize("form", ["swift", "voce"])
def test_a_free_curve_is_the_true_one_within_one_percent(tmp_path, form):
    truth = truth_of(form)
    material = FREE.replace("KNOTS", str(KNOTS)).replace("RANGE", str(RANGE))
    write_folder(tmp_path / "test", truth, 0, material)
    result = idic.identify(str(tmp_path / "test"))
    assert result.status == "converged"
    entries = [result.content["parameters"][name] for name in level_names(f"elastoplastic(free{KNOTS})", "sheet")]
    p = np.linspace(0.0, np.percentile(truth.plastic_strain, 99.0), 60)
    found = basis(p, RANGE, KNOTS) @ np.maximum.accumulate([entry["value"] for entry in entries])
    expected = np.array([true_flow_stress(*FORMS[form], x)[0] for x in p])
    assert np.abs(found / expected - 1.0).max() < 0.01
