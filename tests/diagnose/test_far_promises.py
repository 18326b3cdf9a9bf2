"""An effect so large that the score test misjudges every candidate: the cause is found among those that promise
less."""

import pytest

import idic
from idic.run import diagnose_run
from idic.virtual_tests import write_example


@pytest.mark.slow
def test_a_strip_far_into_plasticity_is_named_where_poisson_s_ratio_is_held(tmp_path):
    """E is a third of the truth; warmth, a drift of the force, creep, viscosity and damage promise more than
    plasticity."""
    write_example("demo", tmp_path / "strip", reduced=True)
    file = tmp_path / "strip" / "experiment.toml"
    text = file.read_text()
    law, rest = text.index('law = "j2_linear"'), text.index("[[boundary]]")
    elastic = 'law = "elastic"\nE = { value = 55e3, unit = "MPa", identify = true }\nnu = 0.3\n\n'
    file.write_text(text[:law] + elastic + text[rest:])
    idic.identify(tmp_path / "strip", tmp_path / "run")
    content = diagnose_run(tmp_path / "run")
    promised = {entry["name"]: entry["predicted_chi2_drop"] for entry in content["candidates"]}
    assert sum(promise > promised["plasticity"] for promise in promised.values()) >= 5
    assert content["verdict"] == "single" and content["named"] == ["plasticity"]
    truth = {"sheet.E": 70e3, "sheet.yield_stress": 200.0, "sheet.hardening_modulus": 1500.0}
    for name, value in truth.items():
        found = content["model"]["parameters_after"][name]
        assert abs(found["value"] - value) < 4.0 * found["std"], name
