"""What a reader is told first of a diagnosis, from the content of diagnosis.json."""

from types import SimpleNamespace

import pytest

from idic.report.diagnosis.headline import moves
from idic.report.diagnosis.page import chain_rows, odds_words
from idic.report.diagnosis.headline import diagnosis_headline
from idic.report.diagnosis.words import sentence, standing_of, strongest

TITLES = {"heterogeneity": "heterogeneous stiffness"}


def content(verdict="multiple"):
    """A spot, found first, and a gradient on top; the list of candidates keeps the last of the two."""
    stiffness, slope = "BODY.inclusion.stiffness", "BODY.gradient.along_x"
    rounds = [{"winner": "heterogeneity", "form": "inclusion", "new": [stiffness]},
              {"winner": "heterogeneity", "form": "gradient", "new": [slope]},
              {"winner": None, "form": None, "new": []}]
    after = {stiffness: {"value": 0.5, "std": 0.1, "unit": ""}, slope: {"value": 0.2, "std": 0.01, "unit": ""}}
    return {"verdict": verdict, "named": ["heterogeneity", "heterogeneity"], "indistinguishable": [], "rounds": rounds,
            "candidates": [{"name": "heterogeneity", "form": "gradient"}], "fit": {"explainable_share_recovered": 0.8},
            "mismatch": {"onset_frame": 0, "visible_frame": 1, "place": None, "side": "bulk"},
            "model": {"parameters_before": {}, "parameters_after": after}, "next_experiment": None}


def test_two_forms_of_one_candidate_are_reported_separately_with_their_numbers():
    text = sentence(content(), TITLES)
    assert "(inclusion; stiffness 0.50 ± 0.10)" in text
    assert "(gradient; along x 0.200 ± 0.010) explain 80 %" in text


def test_a_camera_that_moves_is_told_in_a_line_and_not_frame_by_frame():
    """Screened in two of its four frames, refitted in all of them."""
    shifts = {"col": (0.03, -0.05, 0.01, 0.01), "row": (0.0, 0.02, 0.0, 0.0)}  # rms 0.03 and 0.01
    after = {f"camera.{axis}_at[{k}]": {"value": value, "std": 0.002, "unit": "px"}
             for axis, values in shifts.items() for k, value in enumerate(values, start=1)}
    after |= {f"camera.turn_at[{k}]": {"value": 0.0, "std": None, "unit": "deg"} for k in range(1, 5)}
    said = content("single") | {"named": ["camera_motion"],
                                "model": {"parameters_before": {}, "parameters_after": after},
                                "rounds": [{"winner": "camera_motion", "form": None, "new": [
                                    f"camera.{axis}_at[{k}]" for k in (1, 4) for axis in ("col", "row", "turn")]}]}
    text = sentence(said, {"camera_motion": "camera motion"})
    assert ("camera motion (camera col 0.0300 px rms, -0.0500 px at most in frame 2, camera row 0.0100 px rms, "
            "0.0200 px at most in frame 2, camera turn not determined) explains 80 %") in text


def test_candidates_that_do_not_explain_enough_are_reported_in_their_forms_too():
    text = sentence(content("outside_library"), TITLES)
    assert "stiffness (inclusion) and heterogeneous stiffness (gradient), 80 %" in text
    assert "Do not trust" in text


def test_the_side_of_unexplained_motion_is_a_guess_and_both_guesses_are_told():
    said = content("outside_library")
    assert "unexplained by the library, probably from the specimen (nearest candidate: " in sentence(said, TITLES)
    said["mismatch"] = said["mismatch"] | {"located_side": "camera"}
    assert "probably from the specimen or the camera (nearest candidate: " in sentence(said, TITLES)


def test_a_complete_model_gets_a_list_of_effects_that_the_test_cannot_show():
    text = sentence(content("none") | {"excluded": [{"name": "grip_slip"}, {"name": "drift"}, {"name": "creep"}],
                                      "cannot_tell": ["creep"]}, TITLES)
    assert "(1 candidates tested, 2 of them excluded with a bound, 1 that this test cannot see)" in text


def test_a_candidate_that_its_refit_does_not_confirm_is_not_called_significant_under_a_verdict_of_none():
    entry = {"name": "placement", "form": None, "named": False, "standing": "significant"}
    said = content("none") | {"excluded": [], "cannot_tell": [], "named": [], "candidates": [entry]}
    assert "(1 candidates tested, 1 significant by the score but not by the refit)" in sentence(said, TITLES)
    assert standing_of(said, entry, "significant") == "significant by score only"
    assert standing_of(said | {"verdict": "single"}, entry, "significant") == "significant"


def test_a_cause_below_the_practical_margin_is_told():
    entry = {"name": "placement", "form": None, "named": False, "standing": "small"}
    said = content("none") | {"excluded": [], "cannot_tell": [], "named": [], "candidates": [entry]}
    assert sentence(said, TITLES).startswith("No candidate matters: ")
    assert "(1 candidates tested, 1 significant but below the practical margin)" in sentence(said, TITLES)


def test_many_causes_below_the_margin_are_counted():
    entries = [{"name": name, "form": None, "named": False, "standing": "small"} for name in "abcdef"]
    said = content("none") | {"excluded": [], "cannot_tell": [], "named": [], "candidates": entries, "rounds": []}
    assert "; 6 candidates are seen, a most, but below the practical margin" in diagnosis_headline(said, {})
    few = said | {"candidates": entries[:3]}
    assert "; a, b, and c are seen, but below the practical margin" in diagnosis_headline(few, {})


def test_a_blind_test_is_explained_by_its_parameters_or_its_noise():
    hidden, seen = ({"name": "creep", "form": None, "visibility": v} for v in (0.01, 0.9))
    said = content("blind") | {"excluded": [{"name": "drift"}], "cannot_tell": ["creep"],
                               "next_experiment": "load it 3 times as far"}
    assert "parameters imitate the effect of every candidate" in sentence(said | {"candidates": [hidden]}, TITLES)
    text = sentence(said | {"candidates": [hidden, seen]}, TITLES)
    assert "would hide a candidate of plausible size" in text and text.endswith("Next: load it 3 times as far.")
    assert "2 candidates tested, 1 of them excluded with a bound, 1 that this test cannot see" in text


def test_selected_and_indistinguishable_candidates_are_shown_however_far_down_they_stand():
    entries = [{"name": n, "named": n == "d", "standing": "excluded"} for n in "abcde"]
    said = {"verdict": "set", "candidates": entries, "named": ["d"], "indistinguishable": [["d", "e"]]}
    shown = strongest(said, 2)
    assert [c["name"] for c in shown] == ["a", "b", "d", "e"]
    assert [standing_of(said, c, "small") for c in shown] == ["small", "small", "selected",
                                                             "indistinguishable from the selected"]
    seen = [{"name": n, "named": False, "standing": s} for n, s in (("a", "significant"), ("b", "significant"),
                                                                    ("c", "excluded"), ("f", "significant"))]
    last = said | {"excluded": [{"name": "a"}, {"name": "c"}], "cannot_tell": ["b"]}
    assert [standing_of(last, c, c["standing"]) for c in seen] == [
        "excluded beside the selected cause", "not visible beside the selected cause", "excluded", "significant"]
    nearest = said | {"verdict": "outside_library", "indistinguishable": []}
    assert standing_of(nearest, entries[3], "small") == "nearest, not the cause"


def test_the_course_of_a_warmth_is_told_with_the_expansion_that_was_supposed():
    """The data give the product of both alone."""
    knots = {f"temperature_knot[{k}]": {"value": value, "std": 3.5, "unit": "K"} for k, value in ((4, 12.0), (8, 37.7))}
    said = content("single") | {
        "named": ["thermal_expansion"], "rounds": [{"winner": "thermal_expansion", "form": None, "new": list(knots)}],
        "candidates": [{"name": "thermal_expansion", "form": None}]}
    said["model"] = said["model"] | {"parameters_after": knots}
    assert ("(temperature 37.7 ± 3.5 K at most, in frame 8, for an expansion of 1e-05 per K)"
            in sentence(said, {"thermal_expansion": "thermal expansion"}))


@pytest.mark.parametrize("before, said", [(1.08, "8 % too high"), (0.5, "50 % too low"), (9.04, "9 times as high")])
def test_a_value_that_was_several_times_too_high_is_told_so(before, said):
    one = {"value": 1.0, "std": 0.01, "unit": "MPa"}
    content = {"model": {"parameters_before": {"BODY.H": one | {"value": before}}, "parameters_after": {"BODY.H": one}}}
    (text,) = moves(content)
    assert text.startswith(f"H came out {said} (")


@pytest.mark.parametrize("before, said", [(24539.0, "(24.539 for 69.74 ± 0.17 GPa)"),
                                          (900.0, "(900 MPa for 69.74 ± 0.17 GPa)")])
def test_a_unit_stands_once_where_both_values_have_it(before, said):
    values = [{"BODY.E": {"value": value, "std": 170.0, "unit": "MPa"}} for value in (before, 69740.0)]
    (text,) = moves({"model": dict(zip(("parameters_before", "parameters_after"), values, strict=True))})
    assert text.endswith(said)


def test_many_indistinguishable_causes_are_a_list_with_one_or():
    said = content("set") | {
        "named": ["friction"], "probability": 0.75, "candidates": [{"name": "friction", "form": None}],
        "rounds": [{"winner": "friction", "form": None, "new": [], "equals": ["force_offset", "creep", "creep"]}]}
    assert diagnosis_headline(said, {}).startswith("Probably (75 %) friction, force offset or creep")


ODDS = [[{"name": "nonlinear_elasticity", "share_without": 0.5, "share_with": 0.99, "times_plausible": None,
          "plausible": None, "source": None},
         {"name": "load_cell_curvature", "share_without": 0.5, "share_with": 0.01, "times_plausible": 12.0,
          "plausible": "0.5 % of the force", "source": "class 0.5"}]]


def test_a_set_is_told_whole_with_the_odds_of_its_members_with_and_without_their_sizes():
    said = content("set") | {"named": ["nonlinear_elasticity"], "probability": 0.95, "odds": ODDS, "rounds": [
        {"winner": "nonlinear_elasticity", "form": None, "new": [], "equals": ["load_cell_curvature"]}]}
    headline = diagnosis_headline(said, {})
    assert "onlinear elasticity or load cell curvature (99 % to 1 % by plausible size, even by the rec" in headline
    even = [[member | {"share_with": 0.5} for member in ODDS[0]]]
    assert "plausible size" not in diagnosis_headline(said | {"odds": even}, {})


def test_the_page_shows_every_step_of_the_evidence_with_its_threshold():
    link = {"what": "creep: motion where it acts", "number": 0.0006, "threshold": 0.004, "unit": "px", "sense": ">",
            "holds": False}
    assert chain_rows({"chain": [link, link | {"number": None}]}) == [
        {"what": link["what"], "number": "0.0006 px", "threshold": "> 0.004 px", "holds": "no"},
        {"what": link["what"], "number": "nan px", "threshold": "> 0.004 px", "holds": "no"}]
    (line,) = odds_words(SimpleNamespace(content={"odds": ODDS}, titles={}))
    assert "(50 % each)" in line and "nonlinear elasticity 99 % (any size)" in line
    assert "load cell curvature 1 % (12 times 0.5 % of the force: class 0.5)" in line
