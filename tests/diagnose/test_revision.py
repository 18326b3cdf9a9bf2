"""Selection goes both ways: causes that later ones make idle are removed, and rivals that fit the whole better take
their place. On a world whose answers are known: chi-square that is left by every set of causes.
"""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest
from side_twins import ANY_SIZE

from idic.diagnose import Diagnosis, Fit, Misfit, Ranked, Round, ScoreColumn, Variant, candidate_library
from idic.diagnose.selection.rival import Rival
from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.refits.refit_job import AnnouncedRefits
from idic.diagnose.screen.select import Screening
from idic.diagnose.selection.move import Move, itself, moved
from idic.diagnose.selection.moves.revision import (
    earning_alone, earns_its_place, exchangeable, is_needed, min_further_drop, revised,
)
from idic.diagnose.selection.rival import MIN_FURTHER_SHARE, MIN_HELDOUT_DROP
from idic.diagnose.selection.state import Setting, State, leading, open_round
from idic.errors import NotConverged

T, RANK = 10, 100
KNOWN = {candidate.name: candidate for candidate in candidate_library()}
NAMES = ("magnification", "thermal_expansion", "camera_motion")


@dataclass(frozen=True)
class Folder:
    """Edits alone: what a model holds."""

    edits: dict = field(default_factory=dict)

    def with_edits(self, edits):
        return Folder({**self.edits, **edits})


def fit(chi2):
    return Misfit(np.arange(1, T + 1), np.full(T, RANK + chi2 / T), np.full(T, RANK), np.zeros((T, 0)), 1.0)


def refit(names, left, amplitude=1.0):
    values = {f"{name}.size": amplitude for name in names}
    return Fit("+".join(sorted(names)), sorted(names)[-1] if names else "null", "converged", values,
               dict.fromkeys(values, 0.1), np.zeros((T, 0)), None, fit(left), fit(left))


def ranked(name):
    variant = Variant(name, {name: True}, (f"{name}.size",), {f"{name}.size": 0.0}, {f"{name}.size": 1.0}, direct=True)
    return Ranked(KNOWN[name], 0, variant, name, 10.0, 1e-6, 1.0, 0.1, 1.0, 100.0, 0.05, 0.0, {}, "significant")


def screening(names=NAMES):
    entries = tuple(ranked(name) for name in names)
    trials = tuple(ScoreColumn(r.candidate, r.variant, r.label) for r in entries)
    return Screening(entries, trials, SimpleNamespace(z=np.ones(len(trials))), practical=ANY_SIZE)


def world(left):
    """A state in which every set of causes leaves what the table says; and a log of the sets that were refitted."""
    asked = []

    def refits(jobs):
        answers = []
        for job in jobs:
            names = frozenset({**job.source.edits, **job.edits[0]})
            asked.append(names)
            answers.append(replace(refit(names, left[names]), label=job.labels[-1]))
        return answers

    setting = Setting(refits, lambda model, library: screening([c.name for c in library]), None, 0)
    return State(setting, None, None, None), asked


def revised_rounds(rounds, state):
    """The rounds after removals and exchanges."""
    return revised(replace(state, rounds=tuple(rounds)))


def chosen(order, left, rivals=()):
    """Rounds as they were selected one after the other; rivals : refitted beside the first winner."""
    rounds, source, null = [], Folder(), refit((), left[frozenset()])
    for number, name in enumerate(order):
        found = []
        for other in (name, *(rivals if number == 0 else ())):
            names = frozenset({*source.edits, other})
            answer = replace(refit(names, left[names]), label=other)
            drop = null.choice.chi2 - answer.choice.chi2
            found.append(Rival(ranked(other), answer, drop, drop, drop, practical=ANY_SIZE))
        rounds.append(Round(screening(), null, tuple(found), found[0], source=source))
        source, null = source.with_edits({name: True}), found[0].refitted
    return rounds


def sets(*pairs):
    return {frozenset(names): chi2 for names, chi2 in pairs}


def test_a_move_is_tried_where_it_applies_and_taken_where_it_is_accepted():
    said, clock = [], []
    state = world({})[0]
    state = replace(state, setting=replace(state.setting, stage=said.append))

    def counted(state):
        clock.append(state.number)
        return replace(state, number=state.number + 1)

    taken = Move("taken", "a_s", itself, counted, stage=lambda state: f"from {state.number}")
    rejected = replace(taken, accept=lambda state, tried: tried.number < 2)
    idle = Move("idle", "b_s", itself, counted, lambda state: False, stage=lambda state: "never")
    without = replace(taken, subject=open_round, step="d_s")  # no round is under way
    failed = Move("failed", "c_s", itself, lambda state: None)
    after = moved(state, (taken, rejected, idle, without, failed, taken))
    assert after.number == 2 and clock == [0, 1, 1] and said == ["from 0", "from 1", "from 1"]
    assert set(state.setting.clock.seconds) == {"a_s", "c_s"}


def test_a_move_beside_the_verdict_that_fails_is_a_note():
    state = world({})[0]

    def failing(state):
        raise NotConverged("no equilibrium")

    assert moved(state, [Move("end", "a_s", itself, failing, part="the free motion of an end")]) is state
    assert state.setting.notes.texts == ["Without the free motion of an end: no equilibrium. The verdict does not "
                                        "depend on it."]


def test_a_cause_that_a_later_one_makes_idle_is_removed():
    """The second one alone leaves what both leave: the first had stood in for it."""
    left = sets(((), 5000.0), (("magnification",), 1000.0), (("magnification", "camera_motion"), 10.0),
                (("camera_motion",), 15.0))
    place, _ = world(left)
    rounds = chosen(("magnification", "camera_motion"), left)
    rounds[-1] = idle(rounds[-1], "magnification")
    (one,) = revised_rounds(rounds, place)
    assert one.winner.name == "camera_motion" and one.null is rounds[0].null and one.source.edits == {}


def idle(one, name):
    """The whole in which the amplitude of a cause is known to be about zero."""
    winner = one.winner
    values = {**winner.refitted.values, f"{name}.size": 0.1}
    again = replace(winner, refitted=replace(winner.refitted, values=values))
    return replace(one, winner=again, rivals=(again,))


def test_a_cause_that_explains_a_few_per_cent_given_the_others_is_removed_too():
    left = sets(((), 5000.0), (("magnification",), 1000.0), (("magnification", "camera_motion"), 10.0),
                (("camera_motion",), 10.0 + 0.8 * MIN_FURTHER_SHARE * 4990.0))
    rounds = chosen(("magnification", "camera_motion"), left)
    rounds[-1] = idle(rounds[-1], "magnification")
    assert [one.winner.name for one in revised_rounds(rounds, world(left)[0])] == ["camera_motion"]


def test_two_causes_that_are_both_needed_stay_without_a_refit():
    left = sets(((), 5000.0), (("magnification",), 1000.0), (("magnification", "camera_motion"), 10.0))
    rounds = chosen(("magnification", "camera_motion"), left)
    sharp = replace(rounds[-1].winner.refitted, stds=dict.fromkeys(rounds[-1].winner.refitted.values, 1e-3))
    rounds[-1] = replace(rounds[-1], winner=replace(rounds[-1].winner, refitted=sharp))
    place, asked = world(left)
    assert revised_rounds(rounds, place) == rounds and asked == []


def test_a_rival_that_fits_the_whole_better_takes_the_place_of_the_first():
    left = sets(((), 5000.0), (("magnification",), 1000.0), (("thermal_expansion",), 1200.0),
                (("magnification", "camera_motion"), 400.0), (("thermal_expansion", "camera_motion"), 20.0),
                (("camera_motion",), 3000.0))
    rounds = chosen(("magnification", "camera_motion"), left, rivals=("thermal_expansion",))
    found = revised_rounds(rounds, world(left)[0])
    assert [one.winner.name for one in found] == ["thermal_expansion", "camera_motion"]
    assert found[1].source.edits == {"thermal_expansion": True}


def test_a_rival_that_is_better_by_noise_alone_does_not():
    left = sets(((), 5000.0), (("magnification",), 1000.0), (("thermal_expansion",), 1200.0),
                (("magnification", "camera_motion"), 25.0), (("thermal_expansion", "camera_motion"), 20.0),
                (("camera_motion",), 3000.0))
    rounds = chosen(("magnification", "camera_motion"), left, rivals=("thermal_expansion",))
    assert [one.winner.name for one in revised_rounds(rounds, world(left)[0])] == ["magnification", "camera_motion"]


@pytest.mark.parametrize(("drop", "tried"), [(0.2, False), (0.5, True)])
def test_only_rivals_that_come_near_are_tried(drop, tried):
    left = sets(((), 5000.0), (("magnification",), 1000.0), (("thermal_expansion",), 5000.0 - drop * 4000.0))
    (one,) = chosen(("magnification",), left, rivals=("thermal_expansion",))
    assert [r.name for r in exchangeable(one)] == (["thermal_expansion"] if tried else [])


def test_a_further_cause_has_a_bar_of_its_own_and_a_share_of_the_whole():
    (one,) = chosen(("magnification",), sets(((), 5000.0), (("magnification",), 1000.0)))
    assert min_further_drop(one.winner, 100.0) == MIN_HELDOUT_DROP + 1
    assert min_further_drop(one.winner, 1e5) == MIN_FURTHER_SHARE * 1e5


@pytest.mark.parametrize(("name", "left", "free", "stays"), [
    ("friction", 0.1, False, True), ("friction", 0.5, False, False), ("friction", 0.1, True, False),
    ("magnification", 0.1, False, False)])
def test_a_cause_of_readings_that_explains_the_force_needs_no_share_of_the_whole(name, left, free, stays):
    """26 readings that are 4 standard deviations off are a hundredth of what the images show of another cause; left :
    of their excess."""
    def of_force(chi2, size):
        return replace(fit(chi2), channels=size * np.ones((26, 1)))

    (one,) = chosen((name,), sets(((), 5000.0), ((name,), 1000.0)))
    variant = replace(one.winner.ranked.variant, free_course=free)
    rival = replace(one.winner, ranked=replace(one.winner.ranked, variant=variant))
    first, without, together = of_force(4e4, 5.0), of_force(100.0, 4.0), of_force(100.0, np.sqrt(1.0 + 15.0 * left))
    assert without.chi2 - together.chi2 < min_further_drop(rival, 4e4)
    assert earns_its_place(rival, first, without, together) is stays
    assert not earns_its_place(rival, of_force(4e4, 15.0), without, together)  # a tenth of the excess is no finding


@pytest.mark.parametrize(("amplitude", "joins"), [(0.25, True), (10.0, False)])
def test_a_further_cause_has_a_size_that_such_causes_have(amplitude, joins):
    """In probes of 2 % of the force: half of all load cells are off by less than a quarter of one."""
    left = sets(((), 5000.0), (("magnification",), 1000.0), (("magnification", "load_cell_curvature"), 10.0))
    first, further = chosen(("magnification", "load_cell_curvature"), left)
    refitted = replace(further.winner.refitted, values={"load_cell_curvature.size": amplitude})
    rival = replace(further.winner, refitted=refitted)
    model = FittedModel(Folder({"magnification": True}), first.winner.refitted)
    state = replace(world(left)[0], rounds=(first,), model=model,
                    round=replace(further, rivals=(rival,), winner=rival))
    passed_over = earning_alone(leading(state))
    assert (passed_over is None) is joins
    assert joins or (passed_over.round.winner is None and passed_over.round.passed_over is rival)


def test_side_and_onset_are_those_of_a_cause_and_not_of_finite_strains_beside_it():
    left = sets(((), 5000.0), (("geometric_nonlinearity",), 1000.0), (("geometric_nonlinearity", "grip_slip"), 10.0))
    rounds = chosen(("geometric_nonlinearity", "grip_slip"), left)
    known = SimpleNamespace(rounds=rounds)
    assert Diagnosis.first_cause.fget(known) is rounds[1]
    known.rounds = rounds[:1]
    assert Diagnosis.first_cause.fget(known) is rounds[0]
    known.rounds = [replace(rounds[0], winner=None)]
    assert Diagnosis.first_cause.fget(known) is None


def test_a_parameter_far_from_its_null_needs_no_refit_to_be_kept():
    whole = refit(("magnification",), 0.0)
    assert is_needed(ranked("magnification"), whole, 40.0)  # ten standard deviations: 100 of chi-square
    assert not is_needed(ranked("magnification"), whole, 60.0)
    assert not is_needed(ranked("magnification"), replace(whole, stds={"magnification.size": None}), 1.0)


# progress -----------------------------------------------------------------------------------------
def test_every_wave_of_refits_is_told_with_its_number_and_the_time_that_is_left():
    said = []
    jobs = [SimpleNamespace(name=name) for name in NAMES]
    told = AnnouncedRefits(lambda asked: [None] * len(asked), said.append, planned=3)
    told(jobs[:1])
    told.seconds = 90.0
    told(jobs[1:])
    assert told([]) == []
    assert said[0] == "refit 1 of 3: magnification"
    assert said[1] == "refit 2 to 3 of 3, at most about 3 min: thermal expansion, camera motion"


@pytest.mark.parametrize("loss, stays", [(5.0, False), (60.0, True)])
def test_a_course_of_its_own_is_given_back_where_a_later_cause_makes_it_idle(loss, stays):
    """With the course of the screening and the later cause the whole is as good: the freed course had stood in for
    it."""
    left = sets(((), 5000.0), (("magnification",), 1000.0), (("magnification", "camera_motion"), 10.0 + loss),
                (("camera_motion",), 3000.0))
    rounds = chosen(("magnification", "camera_motion"), left)
    plain = rounds[0].winner
    variant = replace(plain.ranked.variant, new=("m_knot[1]", "m_knot[2]"))
    freed = replace(plain, ranked=replace(plain.ranked, variant=variant))
    rounds[0] = replace(rounds[0], winner=freed, rivals=(freed,), plain=plain)
    last = rounds[1].winner
    rounds[1] = replace(rounds[1], winner=replace(last, refitted=refit(("magnification", "camera_motion"), 10.0)))
    assert (revised_rounds(rounds, world(left)[0])[0].winner is freed) is stays


def test_the_former_course_starts_at_its_own_values_where_both_share_a_name():
    """An expansion per kelvin is stated where the temperature of every frame is found, and found where it goes with
    time: started at the stated value, the latter never arrived."""
    left = sets(((), 5000.0), (("magnification",), 1000.0), (("magnification", "camera_motion"), 10.0),
                (("camera_motion",), 3000.0))
    rounds = chosen(("magnification", "camera_motion"), left)
    plain = rounds[0].winner
    plain = replace(plain, refitted=replace(plain.refitted, values={"magnification.size": 3.0}))
    freed = replace(plain, ranked=replace(plain.ranked, variant=replace(plain.ranked.variant, new=("m_knot[1]",))))
    rounds[0] = replace(rounds[0], winner=freed, rivals=(freed,), plain=plain)
    last = rounds[1].winner
    whole = {"magnification.size": 1e-5, "m_knot[1]": 40.0, "camera_motion.size": 2.0}
    rounds[1] = replace(rounds[1], winner=replace(last, refitted=replace(last.refitted, values=whole)))
    place, _ = world(left)
    begun = []

    def refits(jobs):
        begun.extend(job.values[0] for job in jobs if "magnification" in job.source.edits)
        return place.setting.refits(jobs)

    revised_rounds(rounds, replace(place, setting=replace(place.setting, refits=refits)))
    assert (begun[0]["magnification.size"], begun[0]["camera_motion.size"]) == (3.0, 2.0)


def test_a_later_slip_keeps_its_jumps_in_a_revised_set(monkeypatch):
    """Rebuilt as a ramp it fits worse, and the better set of causes lost: inclusion, friction and a slip in a jump."""
    left = sets(((), 5000.0), (("magnification",), 1000.0), (("thermal_expansion",), 900.0),
                (("magnification", "camera_motion"), 300.0), (("thermal_expansion", "camera_motion"), 290.0),
                (("camera_motion",), 4000.0))
    place, _ = world(left)
    rounds = chosen(("magnification", "camera_motion"), left, rivals=("thermal_expansion",))
    last = rounds[-1].winner
    name = "boundary.RIGHT.x.slip_jump[10]"
    variant = replace(last.ranked.variant, new=(name,))
    jumping = replace(last, ranked=replace(last.ranked, variant=variant))
    rounds[-1] = replace(rounds[-1], winner=jumping, rivals=(jumping,))
    asked = []

    def in_jumps(state):
        asked.append(frozenset(state.model.source.edits))
        if "thermal_expansion" not in state.model.source.edits:
            return None
        winner = replace(state.winner, refitted=replace(state.winner.refitted, judgement=fit(20.0)))
        return replace(state, round=replace(state.round, winner=winner))

    jumps = Move("few jumps", "refits_s", itself, in_jumps)
    monkeypatch.setattr("idic.diagnose.selection.moves.revision.FEW_JUMPS", jumps)
    revision = revised_rounds(rounds, place)
    assert frozenset({"thermal_expansion"}) in asked
    assert [one.winner.name for one in revision] == ["thermal_expansion", "camera_motion"]
