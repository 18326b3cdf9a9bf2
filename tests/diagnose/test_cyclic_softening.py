"""Cyclic softening: proposed where the load goes through a cycle of yield, and named when it is concealed."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from cyclic_strip import (
    GRIP, LENGTH, MATERIAL, RADIUS, SHAPE, TIMES, WIDTH, fitted_to_one_element, write_strip,
)
from side_twins import TOML

from idic.diagnose import Situation, candidate_library
from idic.experiment_file import load_experiment, read_toml
from idic.run import diagnose_run, identify_run
from idic.virtual_tests import strip_with_hole, write_images, write_inp, write_loads

by_calculix = pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed (Debian: calculix-ccx)")
ISOTROPIC = MATERIAL.replace("j2_kinematic", "j2_linear").replace("C = {", "hardening_modulus = {").replace(
    "hardening_modulus = 0.0\n", "")
COMPOSED = """law = "elastoplastic"
E = { value = 60e3, unit = "MPa", identify = true }
nu = 0.3
yield_stress = { value = 170, unit = "MPa", identify = true }
hardening = [{ kind = "linear", H = { value = 100, unit = "MPa", identify = true } }]
backstress = [{ kind = "prager", C = { value = 2500, unit = "MPa", identify = true } }]
"""
SWIFT = COMPOSED.replace('kind = "linear", H = { value = 100, unit = "MPa", identify = true }',
                         'kind = "swift", K = { value = 400, identify = true }, eps0 = 0.01, n = 0.2').replace(
    'yield_stress = { value = 170, unit = "MPa", identify = true }\n', "")
VOCE = COMPOSED.replace('kind = "linear", H = {', 'kind = "voce", b = 20, Q = {')
ELASTIC = "law = \"elastic\"\nE = 60e3\nnu = { value = 0.3, identify = true }\n"


def proposals(folder, material, grip, strain=0.02):
    """Path of an experiment with this [material.BODY], and the variants of cyclic softening under this course."""
    (folder / "images").mkdir(parents=True)
    write_images(folder, (np.zeros(SHAPE, np.uint8) for _ in TIMES))
    write_loads(folder, TIMES, {"force_N": 1e4 * grip, "grip_mm": grip})
    write_inp(strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", 2, 2, 1, name="BODY"), folder / "mesh.inp", "twin")
    head, _, rest = TOML.partition("[material.BODY]\n")
    path = folder / "experiment.toml"
    path.write_text(f"{head}[material.BODY]\n{material}\n{rest[rest.index('[[boundary]]'):]}")
    experiment = load_experiment(path)
    u = grip[:, None, None] * np.ones((1, experiment.model.mesh.n_nodes, 2))
    where = Situation(read_toml(path), experiment, experiment.model.parameters.as_values(), {"BODY": np.ones(7)},
                      {"BODY": strain}, u, np.zeros((len(grip), 1)))
    (candidate,) = (c for c in candidate_library() if c.name == "cyclic_softening")
    return path, candidate.variants(where)


@pytest.mark.parametrize(("material", "law", "stem", "sign"), [
    (MATERIAL, "j2_chaboche", "", 0), (ISOTROPIC, "j2_voce", "", 1),
    (COMPOSED, "elastoplastic(linear+voce+prager)", "hardening_2_", 0)], ids=["back stress", "isotropic", "composed"])
def test_a_plastic_law_gets_voces_term_over_all_cycles(tmp_path, material, law, stem, sign):
    """The rates lie between that of a saturation in all of the accumulated plastic strain and in a tenth of it."""
    path, variants = proposals(tmp_path / "test", material, GRIP)
    before = load_experiment(path).model.parameters
    accumulated = 11 * 0.02 - 11 * 170.0 / 60e3  # quarters of a cycle, less the elastic ways: 1 + 2 x 5
    rates = [variant.probe[f"BODY.{stem}b"] * accumulated for variant in variants]
    np.testing.assert_allclose(rates, [1.0, 3.0, 10.0], rtol=0.01)
    for variant in variants:
        model = load_experiment(path, variant.edits).model
        assert model.materials[0].law == law and variant.exact and variant.sign == sign
        assert set(variant.new) == {f"BODY.{stem}Q", f"BODY.{stem}b"} <= set(model.parameters.free)
        assert variant.null[f"BODY.{stem}Q"] == 0.0 and variant.probe[f"BODY.{stem}Q"] == -17.0
        for name in set(before) - set(variant.new):
            assert model.parameters[name].value == pytest.approx(before[name].value)


@pytest.mark.parametrize(("material", "grip", "strain"), [
    (MATERIAL, np.where(np.arange(len(GRIP)) < 5, GRIP, GRIP.max() * (0.95 + 0.05 * np.sign(GRIP))), 0.02),
    (MATERIAL, np.append(GRIP[:10], np.full(20, GRIP[9])), 0.02), (MATERIAL, np.maximum.accumulate(GRIP), 0.02),
    (MATERIAL, GRIP, 0.002), (MATERIAL, 0.0 * GRIP, 0.0), (ELASTIC, GRIP, 0.02), (SWIFT, GRIP, 0.02),
    (VOCE, GRIP, 0.02)],
    ids=["ways back are elastic", "one reversal", "grows", "does not yield", "at rest", "elastic law",
         "no yield stress", "has the term"])
def test_without_a_cycle_of_yield_or_a_law_for_it_nothing_is_proposed(tmp_path, material, grip, strain):
    assert proposals(tmp_path / "test", material, grip, strain)[1] == ()


def diagnosed(folder, Q):
    """Of the experiment with this Q (MPa)."""
    identify_run(write_strip(folder, Q).parent, folder / "run")
    return diagnose_run(folder / "run")


@pytest.mark.slow  # seven minutes of CPU time
@by_calculix
def test_an_elastic_range_that_shrinks_is_named_and_the_parameters_come_back(tmp_path):
    """The force at the turns falls by 5 % over three cycles; a back stress alone has taken most of it."""
    content = diagnosed(tmp_path, -25.0)
    assert "cyclic_softening" in (*content["named"], *content["indistinguishable"])
    assert content["verdict"] in ("single", "set")
    before, after = (content["model"][f"parameters_{when}"] for when in ("before", "after"))
    truth = fitted_to_one_element(tmp_path, -25.0)
    assert before["BODY.yield_stress"]["value"] < truth["yield_stress"] - 10.0
    for name, value in truth.items():
        assert abs(after[f"BODY.{name}"]["value"] - value) < 2.0 * after[f"BODY.{name}"]["std"], name
    assert content["fit"]["explainable_share_recovered"] > 0.95
    assert content["fit"]["heldout_excess_after"] < 0.5 * content["fit"]["heldout_excess_before"]


@pytest.mark.slow  # three minutes of CPU time
@by_calculix
def test_an_elastic_range_that_stays_names_nothing(tmp_path):
    content = diagnosed(tmp_path, 0.0)
    assert (content["verdict"], content["named"]) == ("none", [])
