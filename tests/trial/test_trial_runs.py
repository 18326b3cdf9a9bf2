"""Two trials from seal to evaluation: a fixed small part of the blind trial. The whole is ``idic trial``."""

import json
import shutil

import numpy as np
import pytest

from idic_studies.trial.plan import Campaign, scene_of
from idic_studies.trial.scenes.calculix import solve_with_calculix
from idic_studies.trial.scenes.effects import EFFECTS
from idic_studies.trial.scenes.scene import NULLS, Geometry, plain_scene
from idic_studies.trial.scenes.solve import solve
from idic_studies.trial.seal import Folder, answered, opened, seal, tool_state
from idic_studies.trial.trial import TrialJob, run_trial
from idic_studies.trial.trial_page import write_trial_page

KEYS = ("clean/1", "singles/grip_rotation-concealed-0")
SEED = 900  # not one of the seeds that scores are reported for


@pytest.fixture(scope="module")
def ended(tmp_path_factory):
    """Both trials run: folder, {key: ID}, {key: answer}."""
    folder, campaign = Folder(tmp_path_factory.mktemp("trial")), Campaign("full", SEED)
    keys = KEYS if shutil.which("ccx") else KEYS[:1]
    numbers = seal(folder, campaign, campaign.select(keys), tool_state())
    for number in numbers.values():
        run_trial(TrialJob(str(folder.out), number))
    return folder, numbers, {key: answered(folder)[number] for key, number in numbers.items()}


@pytest.mark.slow  # shares these trials
def test_a_clean_recording_is_not_accused(ended):
    answer = ended[2]["clean/1"]
    assert answer["verdict"] == "none" and answer["named"] == []
    drawn = answer["ablations"]["decoys"]
    assert abs(drawn["mean"]) < 1.0 and drawn["std"] < 2.0 and drawn["largest"] < 5.0  # decoys resemble each other


@pytest.mark.slow  # 35 s of CPU time for both trials; their parts: test_trial_parts.py
def test_a_turning_grip_is_named_and_scored_as_right(ended):
    folder, numbers, answers = ended
    if len(numbers) == 1:
        pytest.skip("CalculiX is not installed")
    page = write_trial_page(folder)
    assert answers[KEYS[1]]["named"][0] == "grip_rotation"
    assert opened(folder, numbers[KEYS[1]]).solver == "calculix"
    text = page.read_text(encoding="utf-8")
    assert "false alarms on clean recordings" in text
    got = {goal["what"]: goal for goal in json.loads((folder.out / "scores.json").read_text())["scores"]}
    alarms = next(goal for what, goal in got.items() if what.startswith("false alarms"))
    first = next(goal for what, goal in got.items() if what.startswith("right family first"))
    assert alarms["got"] == "0 of 1 (0 %)" and first["got"] == "1 of 1 (100 %)"


@pytest.mark.slow  # shares these trials
def test_finished_trials_are_not_repeated(ended, tmp_path):
    folder, numbers, _ = ended
    folder = Folder(shutil.copytree(folder.out, tmp_path / "copy"))
    assert folder.unanswered(numbers.values()) == []
    folder.answer(numbers["clean/1"]).unlink()
    assert folder.unanswered(numbers.values()) == [numbers["clean/1"]]


@pytest.mark.parametrize("name", ["thermal_expansion", pytest.param("orthotropy", marks=pytest.mark.slow),
                                  pytest.param("heterogeneity", marks=pytest.mark.slow),
                                  pytest.param("grip_slip", marks=pytest.mark.slow)])
def test_calculix_and_the_built_in_solver_agree_on_linear_scenes(name):
    """What differs is the thickness at the clamps' corners (`tests/external/test_calculix.py`): 2.3e-4 mm at most."""
    if shutil.which("ccx") is None:
        pytest.skip("CalculiX is not installed (Debian: apt install calculix-ccx)")
    scene = EFFECTS[name].change(plain_scene("elastic", Geometry(), NULLS["elastic"].truth), 0.2,
                                 np.random.default_rng(1))
    theirs, ours = solve_with_calculix(scene), solve(scene)
    assert np.abs(theirs.u - ours.u).max() < 4e-4 and np.sqrt(np.mean((theirs.u - ours.u) ** 2)) < 2e-5  # mm
    np.testing.assert_allclose(theirs.force[1:], ours.force[1:], rtol=2e-3, atol=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["plasticity", "kinematic_hardening", "hardening_curvature", "creep",
                                  "second_invariant"])
def test_calculix_and_the_built_in_solver_agree_on_laws(name):
    """Fewer increments and other integrations in time: a third of a per cent of the largest motion."""
    if shutil.which("ccx") is None:
        pytest.skip("CalculiX is not installed (Debian: apt install calculix-ccx)")
    effect = EFFECTS[name]
    scene = effect.change(plain_scene(effect.null, Geometry(), NULLS[effect.null].truth), 0.4, np.random.default_rng(1))
    theirs, ours = solve_with_calculix(scene), solve(scene)
    largest = np.abs(ours.u).max()
    assert np.sqrt(np.mean((theirs.u - ours.u) ** 2)) < 3.5e-3 * largest
    np.testing.assert_allclose(theirs.force, ours.force, atol=1.5e-2 * np.abs(ours.force).max())


@pytest.mark.slow
@pytest.mark.parametrize("key", ["singles/plasticity-clear-0", "singles/machine_compliance-concealed-0",
                                 "singles/lens_distortion-concealed-0", "singles/force_offset-concealed-0"])
def test_one_effect_of_every_side_is_named(tmp_path, key):
    folder, campaign = Folder(tmp_path), Campaign("full", SEED)
    (number,) = seal(folder, campaign, campaign.select([key]), tool_state()).values()
    run_trial(TrialJob(str(tmp_path), number))
    truth, answer = opened(folder, number), answered(folder)[number]
    assert truth.names[0] in [*answer["named"], *sum(answer["indistinguishable"], [])], answer["sentence"]
    assert scene_of(truth).null == truth.null
