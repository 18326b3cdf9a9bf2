"""A residual in a channel forbids a verdict; the headline, the effects not excluded, and the probability of the named
set."""

from dataclasses import replace

import numpy as np
import pytest
from test_verdicts import LEFT, POWER, left, ranked, rival, round_of, screening

from idic.diagnose import Variant
from idic.diagnose.caution_texts import outline_caution
from idic.diagnose.probability import (P_NONE, P_NONE_UNCONFIRMED, P_OF_STRENGTH, P_UNEXPLAINED, P_WITH_LEFTOVER,
                                       probability)
from idic.diagnose.residual.channel_left import ChannelLeft
from idic.diagnose.residual.excess_left import ExcessLeft
from idic.diagnose.screen.practical import PracticalSize
from idic.diagnose.selection.verdict import conclude
from idic.report.diagnosis.headline import diagnosis_headline, left_over
from idic.report.diagnosis.not_excluded import hidden_shift, larger_models, probe_words
from idic.report.diagnosis.words import is_sure

T = 16


def channel(before, after, noise_share=2e-3):
    """A channel with so many standard deviations in every frame, before and after."""
    return ChannelLeft("force_N", np.full(T, float(before)), np.full(T, float(after)), noise_share)


# channels -----------------------------------------------------------------------------------------
def test_noise_in_a_channel_is_nothing():
    z = np.random.default_rng(0).standard_normal((2000, T))
    found = [ChannelLeft("force_N", one, one, 2e-3) for one in z]
    assert not any(one.is_significant or one.matters for one in found)
    assert np.mean([one.z for one in found]) == pytest.approx(0.0, abs=3.0 / np.sqrt(2000))


@pytest.mark.parametrize(("one", "matters"), [
    (channel(10.0, 3.5), True),  # an eighth of the excess: a formal fit
    (channel(20.0, 3.5), False),  # 3 %: a flaw of the description
    (channel(10.0, 3.5, 1e-4), False),  # 0.03 % of the largest reading: two meshes differ as much
    (channel(1.0, 3.5), True),  # worse than without the candidate
    (channel(10.0, 1.2), False)], ids=["formal fit", "few per cent", "tiny", "worse", "noise"])
def test_a_part_left_in_a_channel_counts_where_it_is_significant_large_and_a_good_share(one, matters):
    assert one.matters == matters


def test_what_is_left_in_a_channel_forbids_single():
    """All motions are explained; the force is not: friction that was told as viscoelasticity."""
    alone = round_of(screening(ranked("viscoelasticity")), [rival("viscoelasticity", 3000.0)])
    before, after = left(300.0), left(0.0)
    excess = [ExcessLeft(before, after, POWER)]
    assert conclude([alone], before, after, True, excess, channels=[channel(10.0, 1.0)]).word == "single"
    assert conclude([alone], before, after, True, excess, channels=[channel(10.0, 5.0)]).word == "outside_library"


def test_a_share_below_seventy_per_cent_forbids_where_anything_significant_is_left_and_noise_does_not():
    """3 % of a channel's excess is a flaw of the description beside a cause that explains the rest; beside one that
    explains less than 70 % it is what the library lacks."""
    alone = round_of(screening(ranked("force_scale")), [rival("force_scale", 3000.0)])
    for after, one, word in ((left(0.0), channel(20.0, 1.0), "single"), (left(0.0), channel(20.0, 3.5), "single"),
                             (left(4.0), channel(20.0, 1.0), "single"), (left(4.0), channel(20.0, 3.5),
                                                                         "outside_library")):
        before = left(5.0)
        found = conclude([alone], before, after, True, [ExcessLeft(before, left(0.0), POWER)], channels=[one])
        assert found.word == word and (found.share < 0.7) == (after.gain.sum() > left(0.0).gain.sum())
        assert found.in_channels == (("force_N",) if word == "outside_library" else ())


def test_of_an_excess_within_noise_no_share_is_told():
    assert ExcessLeft(left(0.05), left(0.9), POWER).share is None
    assert ExcessLeft(left(300.0), left(30.0), POWER).share == pytest.approx(0.1, rel=0.02)


def test_a_channel_that_no_candidate_explains_is_no_none():
    entries = screening(ranked("plasticity", "excluded"))
    told = conclude([round_of(entries)], left(0.0), left(0.0), real=False, excess=LEFT, channels=[channel(5.0, 5.0)])
    assert told.word == "outside_library" and "dead weight" in told.next_experiment


# probability --------------------------------------------------------------------------------------
def verdict_of(heldout, after=0.0):
    alone = round_of(screening(ranked("creep")), [rival("creep", heldout)])
    excess = ExcessLeft(left(300.0), left(after), POWER)
    return conclude([alone], left(300.0), left(after), True, [excess]), [alone], excess


def test_the_probability_grows_with_the_strength_and_falls_with_what_is_left():
    faint, clear = (probability(*verdict_of(heldout), []) for heldout in (40.0, 5000.0))
    assert P_OF_STRENGTH[0] < faint < clear < 1.0
    assert probability(*verdict_of(5000.0, after=28.0), []) == P_WITH_LEFTOVER
    assert probability(*verdict_of(5000.0), [channel(20.0, 3.5)]) == P_WITH_LEFTOVER


def test_the_words_without_a_name_have_probabilities_of_their_own():
    verdict, rounds, excess = verdict_of(5000.0)
    told = {word: probability(replace(verdict, word=word), rounds, excess, [])
            for word in ("blind", "outside_library")}
    assert told == {"blind": None, "outside_library": P_UNEXPLAINED}


def of_none(entry):
    """The probability of `none` where the screening ends with one candidate."""
    verdict, _, excess = verdict_of(5000.0)
    practical = PracticalSize(px=0.004, channel_std=0.3)
    rounds = [round_of(replace(screening(entry), practical=practical))]
    return probability(replace(verdict, word="none"), rounds, excess, [])


def test_nothing_is_as_sure_beside_a_small_effect_as_that_is_small():
    """At 10 standard deviations 0.0006 px are below 0.004 px; 0.0037 px, with their error, in four of five."""
    small = replace(ranked("creep", "small"), statistic=10.0, effect_channel=0.01)
    assert of_none(ranked("creep", "excluded")) == P_NONE
    assert of_none(replace(small, local_px=0.0006)) == pytest.approx(P_NONE)
    assert of_none(replace(small, local_px=0.0037)) == pytest.approx(P_NONE * 0.79, rel=0.01)
    assert of_none(replace(small, local_px=0.0006, effect_channel=0.3)) == pytest.approx(0.5 * P_NONE)  # of a reading
    # the size of a score at 3 standard deviations is hardly known
    assert of_none(replace(small, local_px=0.0037, statistic=3.0)) < of_none(replace(small, local_px=0.0037))


def test_beside_a_score_that_no_refit_confirms_nothing_is_as_sure_as_noise_makes_such_a_score():
    clear, near, nearer = (of_none(replace(ranked("creep"), p_familywise=p)) for p in (1e-6, 2e-3, 9e-3))
    assert clear == P_NONE_UNCONFIRMED < near < nearer < P_NONE


# headline -----------------------------------------------------------------------------------------
CONTENT = {
    "verdict": "single", "named": ["friction"], "indistinguishable": [],
    "rounds": [{"winner": "friction", "form": None, "new": ["channel.force_N.friction_share"], "equals": []}],
    "candidates": [{"name": "friction", "form": None}, {"name": "viscoelasticity", "form": None}],
    "mismatch": {"onset_frame": 0, "visible_frame": 8, "place": None, "side": "force", "located_side": None},
    "model": {"parameters_before": {"BODY.E": {"value": 2544.0, "std": 20.0, "unit": "MPa"}},
              "parameters_after": {"BODY.E": {"value": 2000.0, "std": 4.0, "unit": "MPa"},
                                   "channel.force_N.friction_share": {"value": 0.0199, "std": 0.0018, "unit": ""}}},
    "fit": {"explainable_share_recovered": 0.97}, "left": {"motion_px": 0.0, "motion_z": 0.0, "channels": []}}
TITLES = {"friction": "friction in the load train", "viscoelasticity": "Prony viscoelasticity"}


def test_a_headline_says_cause_time_size_and_what_it_does_to_the_parameters():
    said = diagnosis_headline(CONTENT, TITLES)
    assert said.startswith("Friction in the load train (") and "0.0199 ± 0.0018" in said
    assert "from the start" in said and "explains 97 % of the residual" in said
    assert "(friction share of force_N 0.0199" in said
    assert "without it E came out 27 % too high" in said and "2000.0 ± 4.0 MPa" in said and said.endswith(".")


def test_a_cause_with_a_course_begins_where_its_course_does_and_its_knots_are_one_number():
    after = {f"channel.force_N.drift_knot[{k}]": {"value": v, "std": 0.5, "unit": "N"}
             for k, v in ((8, 8.0), (10, 11.0))}
    drift = CONTENT | {"named": ["force_drift"], "courses": [{"onset_frames": (5, 6)}],
                       "candidates": [{"name": "force_drift"}],
                       "rounds": [{"winner": "force_drift", "form": None, "new": list(after), "equals": []}],
                       "model": {"parameters_before": {}, "parameters_after": after}}
    said = diagnosis_headline(drift, {"force_drift": "force drift"})
    assert "11.00 ± 0.50 N at most, in frame 10" in said and "from frame 6 on" in said and "knot" not in said
    assert "from the start" in diagnosis_headline(drift | {"courses": [{"onset_frames": (0, 1)}]}, TITLES)


def test_a_cause_that_has_a_centre_is_not_told_at_another_place():
    """An inclusion at (27.2, 12.4) mm was also told "around (28.2, 13.7) mm", the centre of its source elements."""
    after = {f"PLATE.inclusion.{name}": {"value": value, "std": std, "unit": "mm"}
             for name, value, std in (("x", 27.24, 0.04), ("y", 12.38, 0.04))}
    spot = CONTENT | {"named": ["heterogeneity"], "mismatch": CONTENT["mismatch"] | {"place": "around (28.2, 13.7) mm"},
                      "rounds": [{"winner": "heterogeneity", "form": "inclusion", "new": list(after), "equals": []}],
                      "model": {"parameters_before": {}, "parameters_after": after}}
    said = diagnosis_headline(spot, {"heterogeneity": "heterogeneous stiffness"})
    assert "x 27.240 ± 0.040 mm" in said and "28.2" not in said
    assert "around (28.2, 13.7) mm" in diagnosis_headline(spot | {"verdict": "outside_library"}, TITLES)
    after["PLATE.inclusion.x"]["std"] = after["PLATE.inclusion.y"]["std"] = None
    assert "around (28.2, 13.7) mm" in diagnosis_headline(spot, TITLES)


def test_indistinguishable_names_are_joined_by_or():
    rounds = [CONTENT["rounds"][0] | {"equals": ["viscoelasticity"]}]
    assert "or Prony viscoelasticity" in diagnosis_headline(CONTENT | {"verdict": "set", "rounds": rounds}, TITLES)


def test_finite_strains_beside_a_cause_belong_to_the_description_and_alone_they_are_the_finding():
    titles = TITLES | {"geometric_nonlinearity": "geometric nonlinearity"}
    finite = {"winner": "geometric_nonlinearity", "form": None, "new": [], "equals": []}
    for rounds in ([*CONTENT["rounds"], finite], [finite, *CONTENT["rounds"]]):
        both = CONTENT | {"verdict": "multiple", "named": [one["winner"] for one in rounds], "rounds": rounds}
        said = diagnosis_headline(both, titles)
        assert said.startswith("Friction in the load train (") and "explains 97 %" in said
        assert said.endswith("; geometric nonlinearity belongs to the description.")
    blur = {"winner": "defocus", "form": None, "new": [], "equals": []}
    grew = {"name": "defocus", "form": None, "expected_change": {"blur grows with time, place 1 of 1": 0.02},
            "expected_change_std": 0.001}
    said = diagnosis_headline(CONTENT | {"verdict": "multiple", "named": [CONTENT["rounds"][0]["winner"], "defocus"],
                               "rounds": [*CONTENT["rounds"], blur], "candidates": [grew]}, titles)
    assert "and defocus (blur grows with time: 0.0200 ± 0.0010 px²)" in said and "belongs" not in said
    alone = diagnosis_headline(CONTENT | {"named": ["geometric_nonlinearity"], "rounds": [finite]}, titles)
    assert alone.startswith("Geometric nonlinearity") and "explains" in alone and "belongs" not in alone


def test_good_news_is_a_probable_cause_that_leaves_nothing():
    sure = CONTENT | {"probability": 0.95, "left_over": None}
    assert is_sure(sure) and diagnosis_headline(sure, TITLES).startswith("Friction in the load train (")
    for doubt in ({"probability": 0.72}, {"left_over": "Remaining residual: 0.01 px of motion."}, {"verdict": "set"}):
        assert not is_sure(sure | doubt)
    assert diagnosis_headline(sure | {"probability": 0.72},
    TITLES).startswith("Probably (72 %) friction in the load train (")
    assert is_sure({"verdict": "none", "probability": P_NONE}) and is_sure({"verdict": "single"})


@pytest.mark.parametrize("share", [0.97, 0.3])
def test_a_formal_fit_is_no_cause_and_not_in_the_headline(share):
    """Force drift and layers that left a part were told as causes of a sheared laminate, beside "side: force"."""
    content = CONTENT | {"verdict": "outside_library", "fit": {"explainable_share_recovered": share},
                         "unexplained": ["motion", "force_N"],
                         "mismatch": CONTENT["mismatch"] | {"place": "around (1, 2) mm"},
                         "left": {"motion_px": 0.021, "motion_z": 40.0, "motion_share": 0.3, "channels": [
                             {"column": "force_N", "z": 9.0, "share": 0.5, "reading_share": 0.004, "significant": True,
                              "matters": True}]}}
    said = diagnosis_headline(content, TITLES)
    assert "riction" not in said and "do not trust" in said
    assert said.index("around (1, 2) mm") < said.index("probably from") < said.index("0.021 px of motion (rms)")
    assert "0.4 % of force_N" in said
    assert "a formal fit, not the cause: friction in the load train" in left_over(content, TITLES)


def test_a_size_that_no_such_cause_has_is_told_without_its_name():
    said = diagnosis_headline(CONTENT | {"verdict": "outside_library", "beyond_plausible": ["friction"]}, TITLES)
    assert "a size that no such cause has" in said and "riction" not in said


def test_what_is_left_is_said_with_its_size():
    force = {"column": "force_N", "z": 9.0, "share": 0.03, "reading_share": 0.004, "significant": True,
             "matters": False}
    left_of = {"motion_px": 0.02, "motion_z": 40.0, "motion_share": 0.29, "channels": [force]}
    said = left_over(CONTENT | {"left": left_of, "camera_floor_px": 0.019})
    assert "0.02 px of motion that images at rest show too and 0.4 %" in said  # no share: 97 % explained leave it out
    assert "0.02 px of motion (29 % of the excess before)" in left_over(CONTENT | {"left": left_of})
    assert "0.4 % of force_N (3 % of the excess before)" in said
    assert said.endswith("; no further candidate is significant.")
    assert left_over(CONTENT) is None
    near = CONTENT | {"left": left_of | {"motion_px": 0.002, "place": "around (1, 2) mm", "nearest": ["placement"]},
                      "margin": {"px": 0.004}}
    said = left_over(near, {"placement": "wrong place of the mesh"})
    assert "0.002 px of motion, largest around (1, 2) mm (29 % of the excess before)" in said
    assert "below the practical margin of 0.004 px" in said
    assert said.endswith("; nearest further candidates, not selected: wrong place of the mesh.")
    assert "explains nearly all of the residual" in diagnosis_headline(
        near | {"fit": {"explainable_share_recovered": 0.999}}, TITLES)


# not excluded -------------------------------------------------------------------------------------
def test_an_effect_that_does_not_show_is_named_with_the_shift_that_it_would_cause():
    """A load cell that is bent by 2 % moves E by 28 MPa, twelve standard deviations, and shows by four."""
    bent = replace(ranked("load_cell_curvature", "cannot_tell", direct=True), moves={"BODY.E": -1400.0},
                   variant=Variant("force_N is bent", {}, ("c",), {"c": 0.0}, {"c": 0.02}, direct=True))
    name, shift, in_std = hidden_shift(bent, {"BODY.E": 2.3})
    assert (name, shift) == ("BODY.E", 28.0) and in_std == pytest.approx(12.2, abs=0.1)
    assert hidden_shift(bent, {"BODY.E": 20.0}) is None
    assert probe_words(bent.variant) == "force_N is bent (c 0.02)"
    larger = Variant("another pixel size", {}, ("camera.pixel_size",), {"camera.pixel_size": 0.05},
                     {"camera.pixel_size": 0.051}, direct=True)
    assert probe_words(larger) == "another pixel size (pixel size +2 %)"


def test_a_finding_on_an_outline_of_points_may_be_the_outline():
    (said,) = outline_caution(0.052, "multiple")
    assert "5.2 %" in said and "outline_mm" in said
    assert outline_caution(0.052, "none") == [] and outline_caution(None, "multiple") == []


def test_a_headline_of_nothing_tells_what_is_below_the_margin_and_what_a_refit_does_not_confirm():
    entries = [{"name": name, "form": None, "named": False, "standing": standing}
               for name, standing in (("defocus", "small"), ("creep", "significant"), ("damage", "excluded"))]
    said = {"verdict": "none", "named": [], "indistinguishable": [], "cannot_tell": [], "candidates": entries,
            "fit": {"explainable_share_recovered": None}, "model": {"parameters_before": {}}}
    text = diagnosis_headline(said, {})
    assert "defocus is seen, but below the practical margin; creep is suspected" in text and "damage" not in text
    entries[:2] = []
    assert diagnosis_headline(said,
    {}) == "No missing physics is significant: the residual of images and channels is noise."


@pytest.mark.parametrize(("left_px2", "told"), [(30.0, ["layers"]), (0.0, [])])
def test_a_larger_model_that_waits_for_its_limit_is_not_excluded_where_a_part_remains(left_px2, told):
    """Layers promise a tenth more than orthotropy, and are not refitted."""
    layers = replace(ranked("layers"), gain=1.1 * ranked("orthotropy").gain)
    one = round_of(screening(ranked("orthotropy"), layers), [rival("orthotropy", 3000.0)])
    before, after = left(300.0), left(left_px2)
    found = list(larger_models([one], conclude([one], before, after, True, [ExcessLeft(before, after, POWER)])))
    assert [entry["name"] for entry in found] == told
    assert all("has orthotropic elasticity as a special case; its score promised 110 %" in entry["why"]
               for entry in found)


def test_a_faint_misfit_of_readings_is_small_by_its_size_and_not_by_its_significance():
    """At 3 standard deviations, of readings with a noise of 1 % or 0.01 % of the largest one."""
    z = np.full(20, 1.4)
    coarse, fine = (ChannelLeft("force_N", z, z, noise) for noise in (1e-2, 1e-4))
    assert not coarse.was_off and coarse.was_beyond_discretisation
    assert not fine.was_beyond_discretisation
    strong = ChannelLeft("force_N", 5.0 * z, z, 1e-4)  # 7 standard deviations of each reading, 0.07 % of the largest
    assert strong.before.min() > 5.0 and not strong.was_off
