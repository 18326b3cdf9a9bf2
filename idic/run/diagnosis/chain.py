"""The chain of a diagnosis on a RUN: copies, screening, refits side by side, judgement, the next round.

The coordinator marches and screens; every refit is a task of its own (paths and numbers in, one `Refit` out).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from idic.diagnose.locate.active_elements import ACTIVE_STATES, Activity, activity
from idic.diagnose.locate.mismatch import Mismatch, locate
from idic.diagnose.next_test import unloads
from idic.diagnose.refit import Refit, refit_residual, identification_at
from idic.diagnose.residual.evidence import Columns
from idic.diagnose.residual.excess import power
from idic.diagnose.residual.heldout import Fit, fit, grid_of
from idic.diagnose.residual.residual_evidence import ResidualEvidence, residual_evidence
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.residual.thinning import CHOICE, COPY_VARIANCE_FACTOR, thinned
from idic.diagnose.screen.candidate import Candidate, candidates
from idic.diagnose.screen.local_residual import local_residual_tests
from idic.diagnose.screen.select import Screening, screen
from idic.diagnose.screen.situation import situation
from idic.diagnose.screen.score_columns import ScoreColumn, score_columns
from idic.diagnose.screen.time_course import time_course_test
from idic.diagnose.verdict import (
    FLOW_FAMILIES,
    ExcessLeft,
    Round,
    Verdict,
    conclude,
    effect,
    judge,
)
from idic.errors import NotConverged
from idic.identify.in_memory import Identification
from idic.run.diagnosis.next_test import next_experiment
from idic.run.diagnosis.refit_job import RefitMemory, RefitJob, run_refits
from idic.run.diagnosis.rivals import Refits, edits_of, judged_on_both, refitted, undecided
from idic.run.diagnosis.source import Source, open_source
from idic.run.diagnosis.store import RefitStore
from idic.workers.runner import TaskRunner

MAX_ROUNDS = 3
SEED = 20260
Watch = Callable[[ResidualEvidence, Sequence[ScoreColumn], Columns], None]


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """All that was found, for files and figures.

    found : the identification under diagnosis; mismatch : side, onset and place (None where a law found no answer along
    the path); rounds : additions, the last one without a winner unless the limit was
    reached; whole_before : fit of the identified model on the recording as it is; effect_px : motion (rms) that
    nothing in the model explains; final : the enriched model on it (None where
    nothing was added); source : experiment with everything that was added; cost : seconds per step; active : where and
    since when what was named first acts in the enriched model, None where it is no law of yielding, flow or damage;
    left : of motions where spots that were named are, and of those that follow what was named
    """

    found: Identification
    mismatch: Mismatch | None
    rounds: tuple[Round, ...]
    verdict: Verdict
    residual: ResidualEvidence
    residual_after: ResidualEvidence | None
    final: Refit | None
    source: Source
    whole_before: Fit
    effect_px: float
    grid: Grid
    cost: Mapping[str, float]
    active: Activity | None = None
    left: tuple[ExcessLeft, ...] = ()

    @property
    def side(self) -> str | None:
        """Of what was named first, None where nothing was."""
        winner = self.rounds[0].winner
        return None if winner is None else winner.ranked.candidate.side

    @property
    def acts(self) -> int | None:
        """Frame in which what was named begins to act in the enriched model, where there is one."""
        return None if self.active is None else self.active.first_frame

    @property
    def bent(self) -> bool:
        """Whether what was named first bends a law of yielding, flow or damage that the model has without it."""
        winner = self.rounds[0].winner
        return self.active is not None and not winner.ranked.candidate.turns and yields(self.found, ACTIVE_STATES)

    @property
    def always(self) -> bool | None:
        """Whether what was named first, or cannot be told from it, is there from the start; None: nothing was named."""
        first = self.rounds[0]
        if first.winner is None:
            return None
        return not any(rival.ranked.candidate.begins for rival in first.rivals
                       if rival is first.winner or rival.name in first.equals)


@dataclass
class Clock:
    """Seconds spent on every step."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def step(self, name: str):
        began = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - began


def diagnose(run: str | Path, runner: TaskRunner, stage: Callable[[str], None] = lambda text: None,
             seed: int = SEED, library: Sequence[Candidate] | None = None, resume: bool = False) -> Diagnosis:
    """Locate, name, refit and prove what the identified model of a RUN leaves out.

    Parameters
    ----------
    resume : refits that an interrupted diagnosis of this RUN has finished are taken from there
    stage : called with what is being done
    seed : of the noise that makes two copies of the recording
    library : candidates to try, all of them without it

    Raises
    ------
    InputError
        If the RUN holds no finished identification.
    NotConverged
        If its model finds no answer on one of two copies of the recording.
    """
    return diagnose_found(*open_source(run), runner, stage, seed, library, RefitStore(run, resume))


def diagnose_found(source: Source, found: Identification, runner: TaskRunner,
                   stage: Callable[[str], None] = lambda text: None, seed: int = SEED,
                   library: Sequence[Candidate] | None = None, kept: RefitMemory | None = None,
                   watch: Watch = lambda *seen: None) -> Diagnosis:
    """The same for an identification in hand.

    Parameters
    ----------
    source : where its experiment comes from: anything with `document`, `load` and `with_edits` as `Source` has them
    kept : where refits are remembered, None for nowhere
    watch : called with what every screening rests on: gathered residual, trials, their columns

    Raises
    ------
    NotConverged
        If the identified model finds no answer on one of the copies.
    """
    clock = Clock()
    stage("measuring what the model leaves")
    with clock.step("gather_s"):
        residual = residual_evidence(found, light=False)
        grid = grid_of(residual)
        whole = fit(residual, grid)
    stage("locating what does not fit")
    with clock.step("locate_s"):
        mismatch = located(found, residual)
    stage("fitting the model to one of two copies of the recording")
    with clock.step("null_s"):
        (null,) = run_refits(runner, kept, [RefitJob("null", source, ("null",), ({},),
                                                     (found.parameters.as_values(),), found.local, grid, np.inf,
                                                     seed)])
    if not null.usable:
        raise NotConverged("the identified model, fitted again to a copy of the recording, finds no answer, and without "
                           f"it no candidate can be compared with anything ({null.problem})")
    first, rounds, advice = null, [], None
    for number in range(1, MAX_ROUNDS + 1):
        stage(f"screening the library, round {number}")
        with clock.step("screening_s"):
            screening = screened(source, null, seed, candidates() if library is None else library, watch)
        shortlist = ", ".join(r.called for r in screening.shortlist)
        stage(f"refitting {shortlist}" if shortlist else "nothing is worth a refit")
        with clock.step("refits_s"):
            rivals = refitted(source, null, screening, partial(run_refits, runner, kept), grid, seed,
                              bends=not rounds and yields(found))
        winner, equals = judge(rivals, screening)
        crossed_judgement = None
        if not rounds and (near := undecided(rivals)):
            stage(f"judging {', '.join(r.ranked.called for r in near)} on both copies")
            with clock.step("refits_s"):
                rivals, crossed_judgement = judged_on_both(source, null, rivals, screening, partial(run_refits, runner, kept),
                                                 grid, seed)
            winner, equals = judge(rivals, screening)
        rounds.append(Round(screening, null, rivals, winner, equals, crossed_judgement))
        if winner is None:
            break
        members = [(source.with_edits(edits_of(r, screening)), r.refitted) for r in rivals
                   if r is winner or r.name in equals]
        if advice is None and equals:
            stage("simulating what would tell " + " and ".join(r.name for _, r in members) + " apart")
            with clock.step("next_s"):
                advice = next_experiment(members)
        source, null = source.with_edits(edits_of(winner, screening)), winner.refitted
    final, after, active = None, None, None
    if null is not first:
        stage("fitting the enriched model to the whole recording")
        with clock.step("final_s"):
            final, after = enriched(source, null, partial(run_refits, runner, kept), grid, seed)
            if after is not None and acts_as_a_law(rounds[0]):
                active = activity(identification_at(source.load(), final.values, final.local, final.steps))
    seen = float(power(residual.evidence).sum())
    remains, own = [ExcessLeft(first.judgement, null.judgement, seen / COPY_VARIANCE_FACTOR)], []
    if after is not None:
        own = [*local_residual_tests(residual, after, grid, final.values), time_course_test(residual, after, grid)]
        remains = [ExcessLeft(whole, fit(after, grid), seen), *own, *remains]
        if remains[-1].matters and not any(one.matters for one in remains[:-1]) and null.status == "max_iterations":
            stage("fitting the enriched model to its end on one copy")
            with clock.step("final_s"):
                remains[-1] = ended(remains[-1], source, null, partial(run_refits, runner, kept), grid, seed)
    alone = rounds[0].winner is not None and null is rounds[0].winner.refitted
    heldout = rounds[0].heldout_fits(rounds[0].winner) if alone else (first.judgement, null.judgement)
    verdict = conclude(rounds, *heldout, mismatch is not None and mismatch.is_significant, remains,
                       unloads(found.experiment))
    if advice is not None:
        verdict = replace(verdict, next_experiment=advice)
    return Diagnosis(found, mismatch, tuple(rounds), verdict, residual, after, final, source, whole,
                     effect(whole, seen), grid, clock.seconds, active, tuple(own))


def enriched(source: Source, null: Refit, refits: Refits, grid: Grid, seed: int) -> tuple[Refit, ResidualEvidence | None]:
    """The last model on the recording as it is, and what it leaves (None where it finds no answer there).

    It begins where its fit to a copy ended, a few standard deviations away, and with the estimator of that end.
    """
    (final,) = refits([RefitJob("enriched", source, ("enriched",), ({},), (null.values,), null.local, grid, np.inf, seed,
                                copies=False, estimator=null.estimator)])
    return final, refit_residual(source.load(), final) if final.usable else None


def ended(copy: ExcessLeft, source: Source, null: Refit, refits: Refits, grid: Grid, seed: int) -> ExcessLeft:
    """What the last model leaves on the copy for judging once its fit to the other one, cut short, has come to its end."""
    (fitted,) = refits([RefitJob("ended", source, ("ended",), ({},), (null.values,), null.local, grid, np.inf, seed,
                                 unlimited=True)])
    return replace(copy, after=fitted.judgement) if fitted.usable else copy


def located(found: Identification, residual: ResidualEvidence) -> Mismatch | None:
    """Side, onset and place; None where a law finds no answer along the path."""
    try:
        return locate(found, residual)
    except NotConverged:
        return None


def screened(source: Source, null: Refit, seed: int, library: Sequence[Candidate],
             watch: Watch = lambda *seen: None) -> Screening:
    """Score every candidate against the null model on the copy for choosing."""
    found = identification_at(thinned(source.load(), CHOICE, seed), null.values, null.local, null.steps)
    residual = residual_evidence(found)
    here = situation(found, residual, source.document())
    trials = [(candidate, variant) for candidate in library for variant in candidate.variants(here)]

    def load(edits: Mapping[str, object]):
        return thinned(source.load(edits), CHOICE, seed)

    labels, columns = score_columns(found, residual, trials, load) if trials else ((), residual.null.pick([]))
    watch(residual, labels, columns)
    return screen(residual.evidence, residual.null, labels, columns, room=null.choice.room,
                  materials=[material.element_set for material in found.experiment.materials])


def yields(found: Identification, states: Collection[str] = ("plastic_strain",)) -> bool:
    """Whether a law of its model has one of these states."""
    laws = (section.law.spec for section in found.forward.model.sections)
    return any(state in law.state_names for law in laws for state in states)


def acts_as_a_law(one: Round) -> bool:
    """Whether what was named first is a law of yielding, flow or damage: only of such the points say where it acts."""
    return one.winner is not None and one.winner.ranked.candidate.family in FLOW_FAMILIES
