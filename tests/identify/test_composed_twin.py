"""Twins of an older law are identified with the composed law, declared as a list of terms in experiment.toml."""

import pytest
from twin_runs import FORCE, GRIPS, Twin, solved, write_folder

pytestmark = pytest.mark.slow

STEEL = """
[material.BODY]
law = "elastoplastic"
E = { value = 1900, unit = "MPa", identify = true }
nu = 0.35
yield_stress = { value = 17, unit = "MPa", identify = true }
"""
LINEAR = 'hardening = [{ kind = "linear", H = { value = 150, unit = "MPa", identify = true } }]\n'
KINEMATIC = '''hardening = [{ kind = "linear", H = 60 }]
backstress = [{ kind="armstrong_frederick", C.value = 500, C.identify = true, gamma.value = 30, gamma.identify = true }]
'''
PLASTIC = {"E": 2000.0, "nu": 0.35, "yield_stress": 15.0}
THERE_AND_BACK = (0.0, 0.03, 0.06, 0.09, 0.12, 0.09, 0.05, 0.01, -0.03, -0.06)


def identified(tmp_path, law, truth, terms, grip):
    twin = Twin(law=law, truth=PLASTIC | truth, grip=grip, times=tuple(float(k) for k in range(len(grip))), noise=1.0,
                increments=16)
    path = write_folder(tmp_path / "twin", twin, STEEL + terms + GRIPS + FORCE)
    _, result = solved(path)
    assert result["status"] == "converged"
    return result["parameters"]


def check(found, truth):
    for name, value in truth.items():
        entry = found[f"BODY.{name}"]
        # 4 standard deviations of noise, and 1 % for a mesh half as fine as that of the truth
        assert abs(entry["value"] - value) < 4.0 * entry["std"] + 0.01 * value, name


def test_linear_hardening_is_found_by_a_list_of_one_term(tmp_path):
    found = identified(tmp_path, "j2_linear", {"hardening_modulus": 200.0}, LINEAR, THERE_AND_BACK[:6])
    check(found, {"E": 2000.0, "yield_stress": 15.0, "hardening_1_H": 200.0})


def test_a_back_stress_is_found_by_reversing_the_load(tmp_path):
    found = identified(tmp_path, "j2_kinematic", {"hardening_modulus": 60.0, "C": 700.0, "gamma": 50.0}, KINEMATIC,
                       THERE_AND_BACK)
    check(found, {"E": 2000.0, "yield_stress": 15.0, "backstress_1_C": 700.0, "backstress_1_gamma": 50.0})
