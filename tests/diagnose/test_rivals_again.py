"""The nearest rivals of a cause are judged anew once bricks or finite strains have joined it."""

from dataclasses import replace

import pytest
from test_revision import chosen, refit, sets, world

from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.selection.moves.rivals_again import (
    NEAR_CHI2, NEAR_SHARE, Foreseen, near_rivals, with_rivals_again,
)
from idic.diagnose.selection.state import Joined, changed_cause

MODULE = "idic.diagnose.selection.moves.rivals_again"
SMALL = {"magnification": 52.0, "thermal_expansion": 71.0, "camera_motion": 400.0}  # chi-square without the errors


def one_round(drops=2400.0):
    left = sets(((), drops), *(((name,), chi2) for name, chi2 in SMALL.items()))
    (one,) = chosen(("magnification",), left, rivals=("thermal_expansion", "camera_motion"))
    return one


@pytest.fixture(autouse=True)
def unforeseen(monkeypatch):
    """Nothing is simulated: every rival is fitted again, unless a test foresees it."""
    monkeypatch.setattr(f"{MODULE}.foreseen", lambda state, model, rival: None)


def again(one, winner_left, rival_left, monkeypatch):
    """The round after errors have joined that leave so much beside its winner and beside a rival."""
    place, asked = world(sets((("thermal_expansion",), rival_left)))
    source = one.source.with_edits({"magnification": True})
    null = replace(refit(("magnification",), winner_left), name="null", label="null")
    monkeypatch.setattr(f"{MODULE}.chi2_of_following", lambda state: 2.0 * winner_left)  # both copies
    joined = Joined(one.winner.refitted, None, tuple(near_rivals(one)))
    state = replace(place, rounds=(one,), model=FittedModel(source, null), joined=joined)
    state = with_rivals_again(changed_cause(state)) or state
    return state.rounds[0], state.model.source, state.model.fit is null, asked


def test_rivals_are_near_by_a_share_or_by_what_bricks_could_bring():
    one = one_round()
    assert [r.name for r in near_rivals(one)] == ["thermal_expansion"]
    assert one.winner.evidence - near_rivals(one)[0].evidence < NEAR_SHARE * one.winner.evidence
    weak = one_round(drops=300.0)  # a twentieth is less than bricks could bring
    assert NEAR_SHARE * weak.winner.evidence < weak.winner.evidence - near_rivals(weak)[0].evidence < NEAR_CHI2


@pytest.mark.parametrize("rival_left, winner, equals", [
    (7.0, "thermal_expansion", ()), (22.0, "magnification", ("thermal_expansion",)), (60.0, "magnification", ())])
def test_the_rival_that_explains_more_beside_the_errors_takes_the_place(rival_left, winner, equals, monkeypatch):
    one, source, stays, asked = again(one_round(), 20.0, rival_left, monkeypatch)
    assert one.winner.name == winner and one.equals == equals
    assert stays is (winner == "magnification") and set(source.edits) == {winner}
    assert one.winner.heldout == pytest.approx(2400.0 - min(20.0, rival_left)) or winner == "magnification"
    assert {r.name: r.refitted.judgement.chi2 for r in one.rivals}["camera_motion"] == 400.0
    assert asked == [frozenset({"thermal_expansion"})]
    assert [r.refitted.name for r in one.rivals] == [r.name for r in one.rivals]


@pytest.mark.parametrize("promised, gain, refitted", [(70.0, 0.0, False), (70.0, 500.0, True), (51.0, 0.0, True)])
def test_a_rival_that_first_order_leaves_behind_is_not_fitted_again(promised, gain, refitted, monkeypatch):
    """21.6 of chi-square are noise, and a fifth of what the parameters gain by following is an error of first order."""
    moves = {"thermal_expansion.size": 0.3}
    left = sets(((), 2400.0), (("magnification",), 20.0), (("thermal_expansion",), 21.0))
    (before,) = chosen(("magnification",), left, rivals=("thermal_expansion",))
    monkeypatch.setattr(f"{MODULE}.foreseen",
                        lambda state, model, rival: Foreseen(model.source, moves, promised, gain))
    one, source, stays, asked = again(replace(before, equals=("thermal_expansion",)), 20.0, 60.0, monkeypatch)
    assert bool(asked) is refitted
    assert one.winner.name == "magnification" and stays and one.equals == ()  # known to be behind either way
    assert one.winner.heldout == pytest.approx(2380.0)


def test_a_rival_that_first_order_sees_worse_than_no_cause_is_fitted_again(monkeypatch):
    """Beside finite strains a drift was foreseen with 29 628 of chi-square, of 13 900 without any cause; its refit was
    as good as the winner."""
    left = sets(((), 2400.0), (("magnification",), 20.0), (("thermal_expansion",), 21.0))
    (before,) = chosen(("magnification",), left, rivals=("thermal_expansion",))
    monkeypatch.setattr(f"{MODULE}.foreseen", lambda state, model, rival: Foreseen(model.source, {}, 9000.0, 4000.0))
    again_judged, *_, asked = again(before, 20.0, 22.0, monkeypatch)
    assert asked == [frozenset({"thermal_expansion"})] and again_judged.equals == ("thermal_expansion",)
