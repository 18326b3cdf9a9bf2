"""The free law, the last candidate: it is a law that the experiment file knows, and it is told as no cause.

The proof is a rubber that stiffens, simulated by CalculiX (`stiffening_strip.py`).
"""

import shutil

import numpy as np
import pytest
from side_twins import Side, write_folder
from stiffening_strip import C30, slope, write_rubber
from test_channels_and_headline import CONTENT, TITLES

import idic
from idic.diagnose import candidate_library
from idic.diagnose.free_form import NEXT_TEST, free_laws
from idic.diagnose import Situation
from idic.experiment_file import load_experiment, read_toml, with_overrides
from idic.report.diagnosis.headline import diagnosis_headline
from idic.run import diagnose_run

FEW = ("second_invariant", "viscoelasticity", "heterogeneity", "orthotropy", "grip_rotation", "lens_distortion",
       "force_offset", "force_scale")
LIBRARY = tuple(c for c in candidate_library() if c.name in FEW)
by_calculix = pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed (Debian: calculix-ccx)")
ELASTIC = {"E": {"value": 2000.0, "unit": "MPa", "identify": True}, "nu": 0.35}
LAWS = {
    "elastic": {"law": "elastic", **ELASTIC},
    "j2_voce": {"law": "j2_voce", "yield_stress": {"value": 30.0, "unit": "MPa"}, "hardening_modulus": 200.0, "Q": 5.0,
                "b": 50.0, **ELASTIC},
    "mooney_rivlin": {"law": "mooney_rivlin", "C10": {"value": 0.5, "unit": "MPa", "identify": True}, "C01": 0.1,
                      "kappa": 50.0},
    "maxwell": {"law": "maxwell", "g_1": {"value": 0.2, "identify": True}, "tau_1": 3.0, "g_2": 0.0, "tau_2": 0.0,
                "g_3": 0.0, "tau_3": 0.0, **ELASTIC},
    "orthotropic": {"law": "orthotropic", "E1": 2000.0, "E2": 1000.0, "nu12": 0.3, "G12": 500.0, "angle": 0.0}}


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return write_folder(tmp_path_factory.mktemp("clean") / "test", Side())


def looked_at(path, law):
    """The folder with a law in the place of its own, as candidates see it; 3 % of strain, 40 MPa."""
    edits = {"material.BODY": LAWS[law]}
    experiment = load_experiment(path, edits)
    values = experiment.model.parameters.as_values()
    return edits, Situation(with_overrides(read_toml(path), edits), experiment, values,
                            {"BODY": np.linspace(20.0, 40.0, 7)}, {"BODY": 0.03}, np.zeros(0), np.zeros(0))


@pytest.mark.parametrize("law, free", [("elastic", "elastoplastic(free8)"), ("j2_voce", "elastoplastic(free8)"),
                                       ("mooney_rivlin", "free_rubber(8+5)"), ("maxwell", "free_relaxation(8)")])
def test_a_law_has_the_free_one_of_its_class_and_the_file_takes_it(path, law, free):
    edits, seen = looked_at(path, law)
    (found,) = free_laws(seen)
    loaded = load_experiment(path, edits | dict(found.edits))
    assert loaded.model.material_of("BODY").law == found.law == free and found.kind in NEXT_TEST
    assert set(found.names) <= set(loaded.model.parameters.free) and len(found.names) == len(found.at)
    assert (np.diff(found.at) > 0.0).all()


def test_a_law_without_a_free_one_of_its_class_gets_none(path):
    assert not list(free_laws(looked_at(path, "orthotropic")[1]))


def test_the_headline_says_whether_a_curve_describes_what_no_name_does():
    outside = CONTENT | {"verdict": "outside_library"}
    entry = {"title": "free hardening curve", "material": "BODY", "share": 0.93, "describes": True}
    said = diagnosis_headline(outside | {"free_form": entry}, TITLES)
    assert "a free hardening curve of BODY describes 93 % of the residual on held-out data" in said
    assert "No named physics fits;" in said and "do not trust the parameters." in said
    assert said.startswith(diagnosis_headline(outside, TITLES))
    most = diagnosis_headline(outside | {"free_form": entry | {"describes": False}}, TITLES)
    assert most.endswith("on held-out data, but not all.")
    none = diagnosis_headline(outside | {"free_form": entry | {"describes": False, "share": 0.1}}, TITLES)
    assert "nor does a free hardening curve of BODY (10 % of the residual on held-out data)" in none
    assert "free" not in diagnosis_headline(outside | {"free_form": None}, TITLES)


@pytest.mark.slow
@by_calculix
def test_rubber_that_stiffens_has_no_name_and_is_described_by_a_free_curve(tmp_path, monkeypatch):
    idic.identify(write_rubber(tmp_path, monkeypatch), tmp_path / "run")
    content = diagnose_run(tmp_path / "run", library=LIBRARY)
    curve = content["free_form"]
    assert content["verdict"] == "outside_library" and curve["describes"] and curve["share"] > 0.9
    at, value, std = (np.array(curve[key], dtype=float) for key in ("at", "value", "std"))
    chord = 6.0 * C30 * np.gradient(at) ** 2 / 8.0  # largest distance of the parabola from its chord between two knots
    assert (np.abs(value - slope(at)) < 3.0 * std + chord).all()
    assert content["next_experiment"] == NEXT_TEST["rubber"] and content["notes"] == []
    assert (tmp_path / "run/figures/diagnosis_free_form.png").stat().st_size > 10_000
    assert "a free rubber energy of BODY describes" in (tmp_path / "run/diagnosis.html").read_text(encoding="utf-8")
