"""Blocks of the recording judge causes together, where they do not confirm one of them alone."""

from dataclasses import replace

import pytest
from test_revision import Folder, chosen, sets, world

from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.selection.block_step import BlockJudgement
from idic.diagnose.selection.moves.judged_together import judged_alone, judged_together
from idic.diagnose.selection.state import Doubted

LEFT = sets(((), 5000.0), (("magnification",), 2000.0), (("magnification", "camera_motion"), 0.0))


def blocks(*drops):
    return tuple(BlockJudgement(f"block {k}", 1.0, 1.0, 0.1, drop) for k, drop in enumerate(drops))


@pytest.fixture
def rounds():
    """Two causes; the first one leaves 2000 of chi-square, both leave noise."""
    return chosen(("magnification", "camera_motion"), LEFT)


def test_a_cause_that_blocks_confirm_stays(rounds):
    one = judged_alone(rounds[0], blocks(200.0, -50.0))
    assert one.winner is rounds[0].winner and not one.awaits_others and len(one.blocks) == 2


def test_a_cause_that_leaves_something_awaits_others_and_one_that_leaves_noise_is_withdrawn(rounds):
    worse = blocks(200.0, 200.0, -8280.0, 2750.0)  # a seating, with friction in the force
    waits = judged_alone(rounds[0], worse)
    assert waits.winner is rounds[0].winner and waits.awaits_others and waits.blocks == worse
    gone = judged_alone(rounds[1], worse)
    assert gone.winner is None and gone.passed_over is rounds[1].winner and not gone.awaits_others
    assert judged_alone(rounds[0], worse, formal=True).winner is None


def test_causes_are_confirmed_together_or_the_doubted_one_goes_with_all_that_came_after(rounds):
    worse, better = blocks(-390.0), blocks(3400.0, 3700.0)
    waits = judged_alone(rounds[0], worse)
    before = FittedModel(Folder(), rounds[0].null)
    last = FittedModel(Folder({"magnification": True, "camera_motion": True}), rounds[1].winner.refitted)
    state = replace(world(LEFT)[0], rounds=(waits, rounds[1]), model=last, doubted=Doubted(rounds[0], (), before))
    confirmed = judged_together(state, better)
    assert [one.winner.name for one in confirmed.rounds] == ["magnification", "camera_motion"]
    assert confirmed.model is last and confirmed.rounds[0].blocks == better and confirmed.rounds[1].blocks == ()
    withdrawn = judged_together(state, worse)
    (one,) = withdrawn.rounds
    assert one.winner is None and one.passed_over is rounds[0].winner and withdrawn.model is before
    second = Doubted(rounds[1], (rounds[0],), replace(before, fit=rounds[1].null))
    state = replace(state, rounds=(rounds[0], replace(rounds[1], awaits_others=True)), doubted=second)
    remaining = judged_together(state, worse)
    assert [one.winner is None for one in remaining.rounds] == [False, True]
    assert remaining.model.fit is rounds[1].null
