"""Errors of setup, machine and camera get their own name and not another one's, over several seeds."""

import pytest
from confusion_scenes import CONFUSIONS, write_confusion
from course_scenes import SCENES, write_scene
from uniform_strip import write_strip

from idic_studies.trial.tool_run import run_tool

VISIBLE = [name for name in CONFUSIONS if name != "load cell bent by 2 %"]
SEEDS = (1, 2)


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """The answer of the whole tool on a scene, made once."""
    made = {}

    def answer(name, seed):
        if (name, seed) not in made:
            folder = tmp_path_factory.mktemp("confusion")
            scene = write_confusion(folder, name, seed)
            made[name, seed] = scene, run_tool(folder).content
        return made[name, seed]

    return answer


@pytest.mark.slow
def test_friction_is_not_told_as_viscoelasticity_and_the_modulus_is_repaired(told):
    scene, content = told("friction of 2 %", 1)
    assert content["named"] == ["friction"] and content["verdict"] == "single"
    E = content["model"]["parameters_after"]["BODY.E"]
    assert abs(E["value"] - scene.values["E"]) < 4.0 * E["std"]


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", VISIBLE)
def test_every_error_is_in_the_reported_set_and_its_former_name_does_not_come_first(name, seed, told):
    scene, content = told(name, seed)
    reported = {*content["named"], *(one for group in content["indistinguishable"] for one in group)}
    right = CONFUSIONS[name]
    assert right.name in reported, (content["verdict"], content["named"])
    assert content["named"][0] != right.was and content["verdict"] != "outside_library"
    for key in ("E", "nu"):
        entry = content["model"]["parameters_after"][f"BODY.{key}"]
        assert abs(entry["value"] - scene.values[key]) < 5.0 * entry["std"], key


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_an_error_that_does_not_show_is_told_with_the_shift_of_the_modulus_that_it_would_cause(seed, told):
    """A load cell that is bent by 2 % stands out by four standard deviations and moves E by a dozen."""
    scene, content = told("load cell bent by 2 %", seed)
    if content["verdict"] == "none":
        (entry,) = [one for one in content["not_excluded"] if one["name"] == "load_cell_curvature"]
        assert "would move E by" in entry["why"] or "would move BODY.E by" in entry["why"]
    else:
        assert "load_cell_curvature" in {*content["named"],
                                         *(n for group in content["indistinguishable"] for n in group)}


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_a_cause_that_goes_to_and_fro_is_named_alone_with_a_course_of_its_own(name, tmp_path):
    """E within 1 %: knots every other frame do not follow the wandering load cell exactly."""
    scene = write_scene(tmp_path, name, 1)
    content = run_tool(tmp_path).content
    assert content["named"] == [SCENES[name].name] and content["verdict"] == "single"
    assert [one["free"] for one in content["courses"]] == [True]
    assert abs(content["model"]["parameters_after"]["BODY.E"]["value"] / scene.values["E"] - 1.0) < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_of_a_uniform_strip_the_law_and_the_load_cell_are_one_set_and_the_headline_has_both(seed, tmp_path):
    """In tension alone nothing separates them; a cell that is 5.8 % off is told as the less plausible of the two."""
    content = run_tool(write_strip(tmp_path, seed)).content
    assert content["verdict"] == "set" and content["named"] == ["nonlinear_elasticity"]
    (group,) = content["indistinguishable"]
    assert {"nonlinear_elasticity", "load_cell_curvature"} <= set(group)
    assert "onlinear elasticity" in content["headline"] and "nonlinear load cell" in content["headline"]
    (members,) = content["odds"]
    shares = {member["name"]: (member["share_without"], member["share_with"]) for member in members}
    assert shares["load_cell_curvature"][1] < 0.05 < shares["load_cell_curvature"][0]
    assert any(link["what"].endswith("nonlinear load cell, drop of chi-square") and not link["holds"]
               for link in content["chain"])
