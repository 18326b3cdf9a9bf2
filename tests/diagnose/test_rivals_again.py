"""The nearest rivals of a cause are judged anew once bricks or finite strains have joined it."""

from dataclasses import replace

import pytest
from test_revision import chosen, refit, sets, world

from idic.diagnose.selection.rivals_again import NEAR_CHI2, NEAR_SHARE, judged_again, near_rivals

SMALL = {"magnification": 52.0, "thermal_expansion": 71.0, "camera_motion": 400.0}  # chi-square without the errors


def one_round(drops=2400.0):
    left = sets(((), drops), *(((name,), chi2) for name, chi2 in SMALL.items()))
    (one,) = chosen(("magnification",), left, rivals=("thermal_expansion", "camera_motion"))
    return one


def again(one, winner_left, rival_left):
    """The round after errors have joined that leave so much beside its winner and beside a rival."""
    place, asked = world(sets((("thermal_expansion",), rival_left)))
    source = one.source.with_edits({"magnification": True})
    null = replace(refit(("magnification",), winner_left), label="null")
    rounds, source, fitted = judged_again([one], near_rivals(one), source, null, False, None, place.refits, None, 0)
    return rounds[0], source, fitted is null, asked


def test_rivals_are_near_by_a_share_or_by_what_bricks_could_bring():
    one = one_round()
    assert [r.name for r in near_rivals(one)] == ["thermal_expansion"]
    assert one.winner.evidence - near_rivals(one)[0].evidence < NEAR_SHARE * one.winner.evidence
    weak = one_round(drops=300.0)  # a twentieth is less than bricks could bring
    assert NEAR_SHARE * weak.winner.evidence < weak.winner.evidence - near_rivals(weak)[0].evidence < NEAR_CHI2


@pytest.mark.parametrize("rival_left, winner, equals", [
    (7.0, "thermal_expansion", ()), (22.0, "magnification", ("thermal_expansion",)), (60.0, "magnification", ())])
def test_the_rival_that_explains_more_beside_the_errors_takes_the_place(rival_left, winner, equals):
    one, source, stays, asked = again(one_round(), 20.0, rival_left)
    assert one.winner.name == winner and one.equals == equals
    assert stays is (winner == "magnification") and set(source.edits) == {winner}
    assert one.winner.heldout == pytest.approx(2400.0 - min(20.0, rival_left)) or winner == "magnification"
    assert {r.name: r.refitted.judgement.chi2 for r in one.rivals}["camera_motion"] == 400.0
    assert asked == [frozenset({"thermal_expansion"})]
