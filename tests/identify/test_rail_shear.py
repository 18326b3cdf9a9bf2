"""A shear test as a stranger brings it: exported fields whose points end half a facet before the specimen."""

from __future__ import annotations

import json

import pytest
import rail_shear
from rail_shear import FACET, WOVEN, rail, strip, waisted, write_stages
from typer.testing import CliRunner

from idic.cli.app import app
from idic.errors import InputError
from idic.experiment_file import load_experiment
from idic.identification import identify
from idic_studies.cases.case import with_measured_start

LAW = '[material.ALL]\nlaw = "{}"\n{}\n\n'


def run(*arguments: object):
    done = CliRunner().invoke(app, [str(word) for word in arguments])
    assert done.exit_code == 0, done.output
    return done.output


def initialised(folder, ply, free, angle: float | None = 0.0, law: str = "orthotropic") -> str:
    """`idic init`, and thickness and law filled in; free parameters begin 10 % off."""
    run("init", folder)
    file = folder / "experiment.toml"
    text = file.read_text(encoding="utf-8").replace("# thickness_mm = 1.0 ", "thickness_mm = 2.0 ")
    rows = [f"{name} = {{ value = {1.1 * value}, identify = true }}" if name in free else f"{name} = {value}"
            for name, value in ply.items()]
    made = LAW.format(law, "\n".join([*rows, *([] if angle is None else [f"angle = {angle}"])]))
    text = text[:text.index("[material.ALL]")] + made + text[text.index("[[boundary]]"):]
    file.write_text(text, encoding="utf-8")
    return text


@pytest.fixture(scope="module")
def sheared(tmp_path_factory):
    """Folder of the rail shear specimen with the experiment.toml of idic init."""
    folder = tmp_path_factory.mktemp("rail")
    write_stages(folder, rail(), WOVEN, size=1.2)
    initialised(folder, WOVEN, ("G12",))
    return folder


def test_the_edges_that_points_leave_open_are_identified_with_the_shear_modulus(sheared):
    text = (sheared / "experiment.toml").read_text()
    assert "outline_points_mm" in text and text.count("geometry.outline.EDGE") == 4  # the flanks of both notches
    fixed = identify(*with_measured_start(load_experiment(sheared, {"dof": []}))).result["parameters"]["ALL.G12"]
    assert fixed["value"] > 1.04 * WOVEN["G12"]  # an outline that is too narrow, by the force
    found = identify(*with_measured_start(load_experiment(sheared))).result
    own = found["parameters"]["ALL.G12"]
    assert found["status"] == "converged" and own["std"] < 0.01 * WOVEN["G12"]
    # three standard deviations of noise, 1.6 %; the sharp notches in the place of round ones make 0.9 % without noise
    assert abs(own["value"] - WOVEN["G12"]) < 0.025 * WOVEN["G12"]
    assert own["std"] < 1.05 * own["std_noise"]  # nothing is left for a smooth error of the model
    with pytest.raises(InputError, match="no such free edge"):
        load_experiment(sheared, {"dof": [{"name": "geometry.outline.EDGE3"}]})  # an end that moves as measured


@pytest.mark.slow
@pytest.mark.parametrize("open_edges", [True, False])
def test_a_right_law_on_an_outline_of_points_is_blamed_for_nothing(sheared, tmp_path, open_edges):
    """Where the file identifies the edges nothing is missing; where it does not, their motion of 0.0003 px is below the
    practical margin, and the advice is to draw them."""
    folder, out = tmp_path / "rail", tmp_path / "run"
    folder.mkdir()
    (folder / "stages").symlink_to(sheared / "stages")
    text = (sheared / "experiment.toml").read_text()
    (folder / "experiment.toml").write_text(text if open_edges else text[:text.index("[[dof]]")])
    run("identify", folder, "--out", out, "--no-prefect", "--no-report")
    told = run("diagnose", out, "--no-prefect", "--workers", 0)
    found = json.loads((out / "diagnosis.json").read_text())
    assert found["verdict"] == "none" and found["named"] == []
    assert ("draw the outline" in told) != open_edges


@pytest.mark.slow
def test_the_error_bar_of_a_plain_strip_counts_the_margin_that_nobody_has_filled_in(tmp_path, monkeypatch):
    """As `idic init` writes it: its section is 4 % too small, and its fields do not tell where the edges are."""
    monkeypatch.setattr(rail_shear, "PITCH", 1.0)
    E, nu = 65e3, 0.33
    folder = tmp_path / "strip"
    write_stages(folder, strip(), {"E1": E, "E2": E, "nu12": nu, "G12": 0.5 * E / (1.0 + nu)}, seed=21)
    assert 'name = "geometry.outline"\n' in initialised(folder, {"E": E, "nu": nu}, ("E", "nu"), None, "elastic")
    found = identify(*with_measured_start(load_experiment(folder))).result
    assert found["status"] == "converged" and not found["not_identifiable"]
    for name, truth in (("ALL.E", E), ("ALL.nu", nu)):
        own = found["parameters"][name]
        assert abs(own["value"] - truth) < 2.0 * own["std"], name
    # its prior, ± 1 mm on both sides of 24 mm, decides
    assert found["parameters"]["ALL.E"]["std"] == pytest.approx(E / 12.0, rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [5, 11, 12, 13, 14, 15, 16])
def test_a_waisted_specimen_with_a_hole_from_init_to_the_diagnosis(tmp_path, monkeypatch, seed):
    """With the margin of `idic init`, half of the true one: what the edges leave open counts in the error bar of E,
    and so does the noise of the ends, which looks like information on them."""
    monkeypatch.setattr(rail_shear, "PITCH", 1.0)
    E, nu = 65e3, 0.33
    folder, out = tmp_path / "waist", tmp_path / "run"
    write_stages(folder, waisted(), {"E1": E, "E2": E, "nu12": nu, "G12": 0.5 * E / (1.0 + nu)}, seed=seed)
    run("init", folder)
    file = folder / "experiment.toml"
    text = file.read_text(encoding="utf-8")
    assert "geometry.outline.HOLE1" in text and f"outline_points_mm = {0.25 * FACET}," in text
    file.write_text(text.replace("# thickness_mm = 1.0 ", "thickness_mm = 2.0 "), encoding="utf-8")
    told = run("identify", folder, "--out", out, "--no-prefect", "--no-report", "--workers", 0)
    result = json.loads((out / "result.json").read_text())
    assert result["status"] == "converged" and not result["not_identifiable"] and "Not determined" not in told
    for name, truth in (("ALL.E", E), ("ALL.nu", nu)):
        own = result["parameters"][name]
        # three: a corner that no point shows moves E by one (66.6 GPa without noise)
        assert own["std"] < 0.03 * truth and abs(own["value"] - truth) < 3.0 * own["std"], name
    if seed != 5:
        return
    run("diagnose", out, "--no-prefect", "--workers", 0)
    assert json.loads((out / "diagnosis.json").read_text())["verdict"] == "none"
