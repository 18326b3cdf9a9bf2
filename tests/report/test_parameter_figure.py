"""The figure of the parameters before and after a diagnosis."""

from types import SimpleNamespace

import pytest

from idic.report.diagnosis.figures import _percent_of, parameters


@pytest.mark.parametrize("hardening, whole", [(0.0, 1640.0), (1e-3, 1640.0), (500.0, 500.0)])
def test_a_parameter_that_the_cause_made_zero_is_drawn_in_per_cent_of_its_value_before(hardening, whole):
    """A hardening modulus beside a back stress that takes all of it."""
    before = {"PLATE.E": {"value": 59000.0, "std": 22.0}, "PLATE.hardening_modulus": {"value": 1640.0, "std": 2.9}}
    after = {"PLATE.E": {"value": 70000.0, "std": 24.0}, "PLATE.hardening_modulus": {"value": hardening, "std": 9.4}}
    content = {"model": {"parameters_before": before, "parameters_after": after}}
    picture = parameters(SimpleNamespace(content=content))
    assert picture is not None and picture.name == "diagnosis_parameters"
    name = "PLATE.hardening_modulus"
    assert _percent_of(before[name], after[name]) == whole
    assert "100 % is the value before" in picture.caption
