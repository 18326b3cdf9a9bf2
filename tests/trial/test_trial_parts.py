"""Parts of the blind trial: seals, drawn truths, scenes, strengths, evaluation of the answers."""

import json
from dataclasses import replace

import numpy as np
import pytest

from idic.diagnose import Columns
from idic.diagnose.screen.decoys import decoys
from idic.errors import InputError
from idic_studies.trial.evaluation import _onset, evaluated
from idic_studies.trial.plan import GROUPS, SINGLES, Campaign, Truth, draw, scene_of
from idic_studies.trial.scenes.effects import EFFECTS
from idic_studies.trial.scenes.outside import OUTSIDE
from idic_studies.trial.scenes.scene import NULLS, Geometry, plain_scene
from idic_studies.trial.scenes.solve import solve, true_mesh
from idic_studies.trial.scores import confusion, goals
from idic_studies.trial.seal import Folder, opened, seal
from idic_studies.trial.strength import STRENGTHS, Seen, calibrated
from idic_studies.trial.strengths import strengths

TOOL = {"version": "0", "commit": "abc", "changed": False, "thresholds": {"LEVEL": 0.01}}


# seals ----------------------------------------------------------------------------------------------
def test_a_seal_that_was_touched_is_refused(tmp_path):
    folder, campaign = Folder(tmp_path), Campaign("sketch")
    numbers = seal(folder, campaign, campaign.select(["clean/0"]), TOOL)
    number = numbers["clean/0"]
    assert opened(folder, number).key == "clean/0"
    content = json.loads(folder.sealed(number).read_text())
    folder.sealed(number).write_text(json.dumps(content | {"seed": content["seed"] + 1}, indent=1))
    with pytest.raises(InputError, match="not the one that was sealed"):
        opened(folder, number)


def test_the_register_says_nothing_of_the_truths_and_counts_every_run(tmp_path):
    folder, campaign = Folder(tmp_path), Campaign("sketch")
    chosen = campaign.select(["singles/plasticity", "clean"])
    first, second = (seal(folder, campaign, chosen, TOOL) for _ in range(2))
    assert first == second and len(folder.register["runs"]) == 2
    text = (tmp_path / "register.json").read_text()
    assert not any(word in text for word in (*EFFECTS, "clean/", "singles/"))


def test_a_group_has_a_name_of_the_field_and_its_stored_key():
    campaign = Campaign()
    assert campaign.select(["indistinguishable"]) == campaign.select(["twins"])
    assert campaign.select(["indistinguishable/creep"]) == campaign.select(["twins/creep"])
    truth = draw(campaign.select(["twins/creep~viscoelasticity-0"])[0], 1)
    assert truth.content["twin"] == truth.counterpart == "viscoelasticity"  # the key of sealed truths


def test_another_campaign_does_not_go_into_the_same_folder(tmp_path):
    campaign = Campaign("sketch")
    seal(Folder(tmp_path), campaign, campaign.select(["clean/0"]), TOOL)
    other = Campaign("sketch", 2)
    with pytest.raises(InputError, match="another trial"):
        seal(Folder(tmp_path), other, other.select(["clean/0"]), TOOL)


# what is drawn --------------------------------------------------------------------------------------
def test_the_full_campaign_is_as_large_as_it_should_be():
    trials = Campaign().trials
    number = {group: sum(t.group == group for t in trials) for group in GROUPS}
    assert number["clean"] == 100 and number["outside"] == 10 and number["pairs"] == 16 and number["twins"] == 12
    assert len(SINGLES) >= 12 and number["singles"] == 9 * len(SINGLES)
    assert {EFFECTS[name].side for name in SINGLES} == {"bulk", "boundary", "camera", "force"}
    assert sum(EFFECTS[name].calculix for name in SINGLES) >= len(SINGLES) / 2
    assert len({t.key for t in trials}) == len(trials)


def test_a_truth_survives_its_file_and_makes_the_same_scene():
    trial = Campaign().select(["singles/heterogeneity-clear-0"])[0]
    truth = draw(trial, 3)
    again = Truth.read(json.loads(json.dumps(truth.content)))
    points = np.random.default_rng(1).uniform(-3.0, 3.0, (50, 2))
    assert again == truth == draw(trial, 3)
    np.testing.assert_array_equal(scene_of(again).modulus(points), scene_of(truth).modulus(points))


def test_every_effect_has_strengths_that_grow():
    for name in SINGLES:
        table = strengths()[name]
        sizes = [abs(table[strength]["amplitude"]) for strength in STRENGTHS]
        assert sizes == sorted(sizes) and table["faint"]["seen"] == pytest.approx(8.0, rel=0.25), name
        assert table["concealed"]["rise"] < 0.02, name  # of the images' residual: what a look at it would show
    assert set(OUTSIDE) <= set(strengths())


# scenes ---------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def plain():
    return plain_scene("elastic", Geometry(), NULLS["elastic"].truth)


@pytest.fixture(scope="module")
def at_rest(plain):
    return solve(plain)


def test_the_right_end_moves_as_the_programme_says(plain, at_rest):
    right = at_rest.mesh.node_sets["RIGHT"]
    np.testing.assert_allclose(at_rest.u[:, right, 0], np.tile(plain.grip[:, None], (1, len(right))), atol=1e-12)


def test_a_slit_opens_and_costs_stiffness(plain, at_rest):
    scene = replace(plain, slit=1.0)
    mesh, opened_up = true_mesh(scene), solve(scene)
    twice = np.array([i for i in range(at_rest.mesh.n_nodes, mesh.n_nodes)])
    partner = [int(np.argmin(np.linalg.norm(mesh.nodes[:at_rest.mesh.n_nodes] - mesh.nodes[i], axis=1))) for i in twice]
    gap = opened_up.u[-1, twice, 0] - opened_up.u[-1, partner, 0]
    assert (gap > 1e-3).all() and opened_up.force[-1] < 0.99 * at_rest.force[-1]


def test_a_softer_spot_lowers_the_force_and_a_stiffer_one_raises_it(plain, at_rest):
    rng = np.random.default_rng
    soft, stiff = (solve(EFFECTS["heterogeneity"].change(plain, a, rng(2))).force[-1] for a in (0.5, -0.5))
    assert soft < at_rest.force[-1] < stiff


def test_a_slip_begins_after_the_start(plain, at_rest):
    scene = EFFECTS["grip_slip"].change(plain, 1.0, np.random.default_rng(4))
    behind = at_rest.u[:, at_rest.mesh.node_sets["RIGHT"], 0] - solve(scene).u[:, at_rest.mesh.node_sets["RIGHT"], 0]
    assert np.abs(behind[:3]).max() == 0.0 and (behind[-1] > 0.04).all()


# strength -------------------------------------------------------------------------------------------
@pytest.mark.parametrize("power", [1.0, 2.0, 0.6])
def test_an_amplitude_is_found_whatever_power_it_acts_with(power):
    a, seen = calibrated(lambda a: Seen(500.0 * a**power, 0.9, 5.0, 0.0), "concealed", 1.0, 0.1)
    assert seen.seen == pytest.approx(30.0, rel=0.1) and a == pytest.approx((30.0 / 500.0) ** (1.0 / power), rel=0.2)


def test_an_effect_that_cannot_be_so_strong_stays_at_its_largest():
    assert calibrated(lambda a: Seen(10.0 * a, 0.9, 5.0, 0.0), "clear", 1.0, 0.1)[0] == 1.0


# decoys ---------------------------------------------------------------------------------------------
def test_decoys_are_as_smooth_as_their_originals():
    x, t = np.linspace(0.0, 1.0, 200), np.linspace(0.0, 1.0, 12)
    waves = np.stack([np.sin(2.0 * np.pi * k * x) for k in (1, 2, 3)], axis=1)
    columns = Columns(("a", "b", "c"), t[:, None, None] * waves[None], np.ones((12, 1, 3)))
    fields = decoys(columns, np.random.default_rng(0), 20).fields
    spectrum = np.abs(np.fft.rfft(fields[-1], axis=0)) ** 2
    assert spectrum[6:].sum() < 0.02 * spectrum.sum()  # three waves at most, the ends do not fit exactly
    np.testing.assert_allclose((fields**2).sum(axis=(0, 1)), 1.0)


# evaluation -----------------------------------------------------------------------------------------
def _answer(**more):
    families = {"poisson_ratio": "elastic_form", "orthotropy": "elastic_form", "force_offset": "force"}
    return {"verdict": "single", "named": ["poisson_ratio"], "indistinguishable": [], "mismatch": {
        "side": "bulk", "onset_frame": 3, "elements": []}, "candidates": [
            {"name": n, "family": f, "predicted_chi2_drop": 100.0, "achieved_chi2_drop": 90.0}
            for n, f in families.items()],
        "fit": {"heldout_excess_before": 1.0, "heldout_excess_after": 0.1},
        "identified": {"parameters": {"BODY.E": {"value": 2100.0, "std": 10.0}}},
        "model": {"parameters_after": {"BODY.E": {"value": 2010.0}}}, "cost": {"cpu_s": 12.0}} | more


@pytest.fixture
def truth():
    trial = Campaign().select(["singles/force_offset-clear-0"])[0]
    return replace(draw(trial, 1), key="singles/poisson_ratio-clear-0", effects=(("poisson_ratio", "clear"),),
                   null="held", parameters={"E": 2000.0, "nu": 0.3})


def test_a_right_answer_scores_in_every_figure(tmp_path, truth):
    record = evaluated(Folder(tmp_path), "0", truth, _answer())
    assert record.family_first and record.inside and record.side_right and record.alarm
    assert record.onset_error == 3.0 and record.excess_ratio == 0.1 and record.drop_ratio == 0.9
    assert record.bias_before == pytest.approx(10.0) and record.bias_ratio == pytest.approx(0.1)


@pytest.mark.slow  # 9 s of CPU time
def test_a_back_stress_begins_where_the_load_is_reversed_and_a_bend_where_points_yield():
    """Whoever solved the recording: what two solvers differ by is as large as a fiftieth of either effect."""
    onsets = {}
    for name in ("kinematic_hardening", "hardening_curvature"):
        truth = draw(Campaign().select([f"singles/{name}-concealed-0"])[0], 11)
        assert truth.solver == "calculix"
        onsets[name] = _onset(scene_of(truth), scene_of(truth, False))
    assert onsets == {"kinematic_hardening": 13, "hardening_curvature": 2}


def test_another_member_of_the_family_is_first_but_not_inside(tmp_path, truth):
    record = evaluated(Folder(tmp_path), "0", truth, _answer(named=["orthotropy"]))
    assert record.family_first and not record.inside
    record = evaluated(Folder(tmp_path), "0", truth, _answer(named=["force_offset"],
                                                          indistinguishable=[["force_offset", "poisson_ratio"]]))
    assert not record.family_first and record.inside


def test_a_spot_that_was_left_out_is_no_material_cause(tmp_path, truth):
    """Dust is named, and is no candidate: the table of 43 answers ended in a KeyError."""
    record = evaluated(Folder(tmp_path), "0", replace(truth, world={}), _answer(named=["dust", "poisson_ratio"]))
    assert record.inside and not record.false_physics


def test_a_name_on_a_clean_recording_is_a_false_alarm_and_the_matrix_shows_it(tmp_path, truth):
    clean = replace(truth, key="clean/0", effects=(), amplitudes=())
    records = [evaluated(Folder(tmp_path), "0", clean, _answer()), evaluated(Folder(tmp_path), "1", clean, _answer(
        verdict="none", named=[]))]
    assert [r.alarm for r in records] == [True, False]
    rows, columns, counts = confusion(records)
    assert rows == ("clean",) and dict(zip(columns, counts[0], strict=True)) == {"poisson_ratio": 1, "none": 1}
    goal = next(g for g in goals(records) if g.what.startswith("false alarms"))
    assert goal.got == "1 of 2 (50 %)" and not goal.met


def test_a_tool_that_broke_down_has_answered_wrongly(tmp_path, truth):
    record = evaluated(Folder(tmp_path), "0", truth, {"verdict": "failed", "problem": "x"})
    assert record.alarm and not record.family_first and record.onset_error is None
