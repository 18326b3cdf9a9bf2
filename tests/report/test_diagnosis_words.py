"""What a reader is told first of a diagnosis, from the content of diagnosis.json."""

from idic.report.diagnosis_words import sentence, standing_of, strongest

TITLES = {"heterogeneity": "a body that is not the same everywhere"}


def content(verdict="multiple"):
    """A spot, found first, and a gradient on top; the list of candidates keeps the last of the two."""
    stiffness, slope = "BODY.inclusion.stiffness", "BODY.gradient.along_x"
    rounds = [{"winner": "heterogeneity", "form": "inclusion", "new": [stiffness]},
              {"winner": "heterogeneity", "form": "gradient", "new": [slope]}, {"winner": None, "form": None, "new": []}]
    after = {stiffness: {"value": 0.5, "std": 0.1, "unit": ""}, slope: {"value": 0.2, "std": 0.01, "unit": ""}}
    return {"verdict": verdict, "named": ["heterogeneity", "heterogeneity"], "indistinguishable": [], "rounds": rounds,
            "candidates": [{"name": "heterogeneity", "form": "gradient"}], "fit": {"explainable_share_recovered": 0.8},
            "mismatch": {"onset_frame": 0, "visible_frame": 1, "place": None, "side": "bulk"},
            "model": {"parameters_before": {}, "parameters_after": after}, "next_experiment": None}


def test_two_forms_of_one_candidate_are_said_one_by_one_with_their_own_numbers():
    text = sentence(content(), TITLES)
    assert "(inclusion) (inclusion.stiffness 0.50 ± 0.10)" in text
    assert "(gradient) (gradient.along x 0.200 ± 0.010) explain 80 %" in text


def test_what_does_not_explain_enough_is_said_in_its_own_form_too():
    text = sentence(content("outside_library"), TITLES)
    assert "everywhere (inclusion) and a body that is not the same everywhere (gradient), 80 %" in text
    assert "mistrust" in text


def test_where_nothing_is_missing_it_is_said_what_could_not_have_been_seen():
    text = sentence(content("none") | {"excluded": [{}, {}], "cannot_tell": ["creep"]}, TITLES)
    assert "(1 candidates tested, 2 of them excluded with a bound, 1 that this test cannot tell)" in text


def test_what_is_named_or_equals_it_is_shown_however_far_down_it_stands():
    entries = [{"name": n, "named": n == "d"} for n in "abcde"]
    said = {"candidates": entries, "named": ["d"], "indistinguishable": [["d", "e"]]}
    shown = strongest(said, 2)
    assert [c["name"] for c in shown] == ["a", "b", "d", "e"]
    assert [standing_of(said, c, "small") for c in shown] == ["small", "small", "named", "cannot be told from what is named"]
