"""The chain of a diagnosis on a RUN: copies, screening, refits side by side, judgement, the next round.

The coordinator marches and screens; every refit is a task of its own (paths and numbers in, one `Refit` out).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import takewhile
from pathlib import Path

import numpy as np

from idic.diagnose.active import STATES, Activity, activity
from idic.diagnose.candidate import Candidate, Variant, candidates
from idic.diagnose.evidence import Columns
from idic.diagnose.excess import power
from idic.diagnose.gather import Gathered, gather
from idic.diagnose.heldout import Fit, fit, grid_of
from idic.diagnose.mismatch import Mismatch, locate
from idic.diagnose.refit import STARTS, Race, Refit, measured, placed, warm_start
from idic.diagnose.select import Ranked, Screening, screen
from idic.diagnose.situation import situation
from idic.diagnose.subspace import Grid
from idic.diagnose.templates import Trial, screen_columns
from idic.diagnose.thinning import CHOICE, NOISIER, thinned
from idic.diagnose.verdict import (
    EXCESS_Z,
    IN_THE_WHOLE_BODY,
    Remains,
    Rival,
    Round,
    Verdict,
    conclude,
    effect,
    judge,
)
from idic.edge.diagnosis_next import next_experiment
from idic.edge.diagnosis_source import Source, open_source
from idic.edge.diagnosis_store import RefitStore
from idic.edge.refit_job import KeptRefits, RefitJob, run_refits
from idic.edge.runner import TaskRunner
from idic.errors import NotConverged
from idic.identify.in_memory import Identification

MAX_ROUNDS = 3
AT_ONCE = 2  # refits side by side after the first: the fewer, the more is known of what they have to reach
MORE = 1.1  # times what its limit promises: a larger model is refitted beside it
HOPELESS = 0.5  # of the best rival's drop: who promises less is not refitted
LEFT = 0.05  # of what a refit explains is left of it: that is all there is
FAR = 0.2  # of a promise: what first order may be off by
CLOSE = 25.0  # chi-square between two that hardly can be told apart, noise included
KEPT = 0.5  # of the promised drop; a refit that keeps less began in the wrong place, or the promise was far from linear
SEED = 20260
Watch = Callable[[Gathered, Sequence[Trial], Columns], None]


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """All that was found, for files and figures.

    found : the identification under diagnosis; mismatch : side, onset and place (None where a law found no answer along
    the path); rounds : additions, the last one without a winner unless the limit was
    reached; whole_before : fit of the identified model on the recording as it is; effect_px : motion (rms) that
    nothing in the model explains; final : the enriched model on it (None where
    nothing was added); source : experiment with everything that was added; cost : seconds per step; active : where and
    since when what was named first acts in the enriched model, None where it is no law of yielding, flow or damage
    """

    found: Identification
    mismatch: Mismatch | None
    rounds: tuple[Round, ...]
    verdict: Verdict
    gathered: Gathered
    gathered_after: Gathered | None
    final: Refit | None
    source: Source
    whole_before: Fit
    effect_px: float
    grid: Grid
    cost: Mapping[str, float]
    active: Activity | None = None

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
        return self.active is not None and not winner.ranked.candidate.turns and yields(self.found, STATES)

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
                   library: Sequence[Candidate] | None = None, kept: KeptRefits | None = None,
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
        gathered = gather(found, light=False)
        grid = grid_of(gathered)
        whole = fit(gathered, grid)
    stage("locating what does not fit")
    with clock.step("locate_s"):
        mismatch = located(found, gathered)
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
        stage(f"refitting {', '.join(r.called for r in screening.shortlist) or 'nothing'}")
        with clock.step("refits_s"):
            rivals = refitted(source, null, screening, partial(run_refits, runner, kept), grid, seed,
                              bends=not rounds and yields(found))
        winner, equals = judge(rivals, screening)
        crossed = None
        if not rounds and (near := undecided(rivals)):
            stage(f"judging {', '.join(r.ranked.called for r in near)} on both copies")
            with clock.step("refits_s"):
                rivals, crossed = judged_on_both(source, null, rivals, screening, partial(run_refits, runner, kept),
                                                 grid, seed)
            winner, equals = judge(rivals, screening)
        rounds.append(Round(screening, null, rivals, winner, equals, crossed))
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
            (final,) = run_refits(runner, kept, [RefitJob("enriched", source, ("enriched",), ({},), (null.values,),
                                                          null.local, grid, np.inf, seed, copies=False)])
            after = measured(source.load(), final) if final.usable else None
            if after is not None and acts_as_a_law(rounds[0]):
                active = activity(placed(source.load(), final.values, final.local, final.steps))
    seen = float(power(gathered.evidence).sum())
    remains = Remains(first.judgement, null.judgement, seen / NOISIER) if after is None else \
        Remains(whole, fit(after, grid), seen)
    alone = rounds[0].winner is not None and null is rounds[0].winner.refitted
    heldout = rounds[0].heldout_fits(rounds[0].winner) if alone else (first.judgement, null.judgement)
    verdict = conclude(rounds, *heldout, mismatch is not None and mismatch.is_real, remains)
    if advice is not None:
        verdict = replace(verdict, next_experiment=advice)
    return Diagnosis(found, mismatch, tuple(rounds), verdict, gathered, after, final, source, whole,
                     effect(whole, seen), grid, clock.seconds, active)


def located(found: Identification, gathered: Gathered) -> Mismatch | None:
    """Side, onset and place; None where a law finds no answer along the path."""
    try:
        return locate(found, gathered)
    except NotConverged:
        return None


def screened(source: Source, null: Refit, seed: int, library: Sequence[Candidate],
             watch: Watch = lambda *seen: None) -> Screening:
    """Score every candidate against the null model on the copy for choosing."""
    found = placed(thinned(source.load(), CHOICE, seed), null.values, null.local, null.steps)
    gathered = gather(found)
    here = situation(found, gathered, source.document())
    trials = [(candidate, variant) for candidate in library for variant in candidate.variants(here)]

    def load(edits: Mapping[str, object]):
        return thinned(source.load(edits), CHOICE, seed)

    labels, columns = screen_columns(found, gathered, trials, load) if trials else ((), gathered.null.pick([]))
    watch(gathered, labels, columns)
    return screen(gathered.evidence, gathered.null, labels, columns, room=null.choice.room,
                  materials=[material.element_set for material in found.experiment.materials])


def refitted(source: Source, null: Refit, screening: Screening,
             refits: Callable[[Sequence[RefitJob]], list[Refit]], grid: Grid, seed: int,
             bends: bool = False) -> tuple[Rival, ...]:
    """Refit the shortlist, the most promising first; who cannot reach the best any more is left out.

    Who falls short of its promise and could still win starts elsewhere again. After the shortlist those of its reserve
    have their turn that are not left out either, and in the end the rivals of the best one's own family (`alike`).

    Parameters
    ----------
    refits : runs jobs side by side; how many it can changes nothing in what they are asked (`next_wave`)
    bends : the null has a law that yields, and nothing is in the model yet (`alike`)
    """
    waiting, rivals, race, best = alternatives(screening.shortlist), {}, None, 0.0
    reserve = [r for r in alternatives([*screening.shortlist, *screening.reserve]) if r in screening.reserve]
    starts = {r.key: starting_variants(screening, r.candidate, r.variant) for r in [*waiting, *reserve]}

    def run(chosen, first: int, last: int, reach: float | None = None) -> list[Rival]:
        answers = refits([_job(source, null, r, starts[r.key][first:last], first == 0 and reach is None,
                               KEPT * r.gain if reach is None else reach, grid, seed, race) for r in chosen])
        return [_rival(ranked, answer, null) for ranked, answer in zip(chosen, answers, strict=True)]

    while waiting:
        wave = next_wave(waiting, not rivals)
        waiting = waiting[len(wave):]
        rivals |= {rival.ranked.key: rival for rival in run(wave, 0, 1)}
        ahead = max((r for r in rivals.values() if r.refitted.usable), key=lambda r: r.achieved, default=None)
        best = 0.0 if ahead is None else ahead.achieved
        waiting = still_promising(waiting, ahead)
        if not waiting:
            waiting, reserve = still_promising(reserve, ahead), []
        race = Race(null.phi, np.nanmin([null.phi, *(r.refitted.phi for r in rivals.values())]))
    akin = alike(screening, tuple(rivals.values()), bends)
    untried = [r for r in akin if r.key not in rivals]
    starts |= {r.key: starting_variants(screening, r.candidate, r.variant) for r in untried}
    short = [r.ranked for r in rivals.values() if len(starts[r.ranked.key]) > 1
             and (r.predicted > best or r.ranked in akin)
             and not (r.refitted.usable and r.achieved > KEPT * r.predicted)]
    rivals |= {rival.ranked.key: rival for rival in run(untried, 0, STARTS, best)}
    for again in run(short, 1, STARTS):
        former = rivals[again.ranked.key]
        if again.refitted.usable and not (former.refitted.usable and former.achieved >= again.achieved):
            rivals[again.ranked.key] = again
    return tuple(rivals.values())


def undecided(rivals: Sequence[Rival]) -> list[Rival]:
    """Who is judged on both copies: all, where nobody stands out on one and somebody does where it was fitted.

    One copy shows a faint effect by seven tenths of the standard deviations that the recording does.
    """
    near = [r for r in rivals if r.refitted.usable and r.achieved > 0.0]
    clear = any(r.passes and r.heldout > EXCESS_Z**2 for r in near)
    return near if not clear and any(r.achieved > r.least for r in near) else []


def judged_on_both(source: Source, null: Refit, rivals: Sequence[Rival], screening: Screening,
                   refits: Callable[[Sequence[RefitJob]], list[Refit]], grid: Grid,
                   seed: int) -> tuple[tuple[Rival, ...], Fit | None]:
    """Rivals refitted to the copy for judging and judged on the other one too: nothing judges a fit it had part in.

    The candidates were chosen on one of the two, so the bar is twice as high (`Rival.least`).

    Returns
    -------
    The rivals with what they bring on both copies, and the null's fit on the second; as they were, and None, where the
    null finds no answer there.
    """
    (there,) = refits([RefitJob("null", source, ("null",), ({},), (null.values,), null.local, grid, np.inf, seed,
                                swapped=True)])
    if not there.usable:
        return tuple(rivals), None
    near = undecided(rivals)
    answers = refits([_swapped(source, there, r, variant_of(r, screening), grid, seed) for r in near])
    both = {id(r): _judged_twice(r, there, answer) for r, answer in zip(near, answers, strict=True)}
    return tuple(both.get(id(r), r) for r in rivals), there.judgement


def _swapped(source: Source, null: Refit, rival: Rival, variant: Variant, grid: Grid, seed: int) -> RefitJob:
    """A rival on the copy for judging: from its probe, and from where it ended on the other one; the better of both.

    The other copy judges it: what started there counts only where the search has left its start (`Start.borrowed`).
    """
    labels, edits = (f"{variant.label}, from the other copy", variant.label), {**variant.edits, **variant.refit}
    probe = {**null.values, **(variant.null if variant.direct else variant.probe)}
    return RefitJob(rival.name, source, labels, (edits, edits), (rival.refitted.values, probe), null.local, grid,
                    -np.inf, seed, swapped=True, borrowed=labels[0])


def _judged_twice(rival: Rival, null: Refit, answer: Refit) -> Rival:
    if not answer.usable:
        return replace(rival, silent=True)
    return replace(rival, heldout=rival.heldout + null.judgement.chi2 - answer.judgement.chi2, crossed=answer.judgement,
                   achieved_there=null.choice.chi2 - answer.choice.chi2)


def yields(found: Identification, states: Collection[str] = ("plastic_strain",)) -> bool:
    """Whether a law of its model has one of these states."""
    laws = (section.law.spec for section in found.forward.model.sections)
    return any(state in law.state_names for law in laws for state in states)


def acts_as_a_law(one: Round) -> bool:
    """Whether what was named first is a law of yielding, flow or damage: only of such the points say where it acts."""
    return one.winner is not None and one.winner.ranked.candidate.family in IN_THE_WHOLE_BODY


def alike(screening: Screening, rivals: Sequence[Rival], bends: bool = False) -> list[Ranked]:
    """Who is refitted beside the best, whatever first order promises of it: its rivals of the same family.

    Where nobody passes on one copy, of the one that showed most where it was fitted.

    bends : the null has a law that yields: where nobody passes, its bends are refitted as well

    A straight line of hardening that was identified hides a bend to first order (drop of chi-square 28 promised, 128
    once it was refitted), and the back stress that imitates it was named alone (93). Only where the way to the answer
    is not straight: laws, not channels and cameras. The same bend, clear, let warmth and a drift of the force stand out
    instead (z 7.6 and 6.1, itself 2.7), which did not survive on the other copy.
    """
    found = [r for r in rivals if r.passes]
    shown = found or [r for r in rivals if r.refitted.usable and r.achieved > r.least]
    best = max(shown, key=lambda r: r.achieved, default=None)
    laws = [r for r in screening.ranked if not r.variant.direct and r.variant.pixels is None]
    akin = [] if best is None else [r for r in laws if r.candidate.name in best.ranked.candidate.rivals
                                    and r.candidate.family == best.ranked.candidate.family
                                    and r.subject == best.ranked.subject]
    hidden = [r for r in laws if r.candidate.family == "plasticity" != r.candidate.name and r not in akin]
    return akin + (hidden if bends and rivals and not found else [])


def next_wave(waiting: Sequence[Ranked], first: bool) -> list[Ranked]:
    """Who is refitted side by side next: the most promising one alone, then `AT_ONCE`, the slow ones among themselves.

    What a wave reaches decides who of the others is still refitted, and is what they have to reach. With waves as
    wide as there are workers, the answer would depend on their number.
    """
    alike = takewhile(lambda r: _is_slow(r) == _is_slow(waiting[0]), waiting)
    return list(alike)[:1 if first else AT_ONCE]


def _is_slow(ranked: Ranked) -> bool:
    """Whether its simulations take long: a body begins to tear."""
    return ranked.candidate.family == "damage"


def still_promising(waiting: Sequence[Ranked], ahead: Rival | None) -> list[Ranked]:
    """Who may still reach the best refit so far; everybody, where there is none."""
    if ahead is None:
        return list(waiting)
    left = [r for r in waiting if r.gain > HOPELESS * ahead.achieved]
    return [r for r in left if not falls_behind(r, ahead)] if settled(ahead) else left


def settled(ahead: Rival) -> bool:
    """Whether a refit explains all there is, as its score promised: nobody can do better, and first order is right."""
    return ahead.refitted.choice.room < LEFT * ahead.achieved and ahead.achieved > (1.0 - FAR) * ahead.predicted


def falls_behind(ranked: Ranked, ahead: Rival) -> bool:
    """Whether a candidate promises less than one that this record could not tell from the best would."""
    return ranked.gain < min((1.0 - FAR) * ahead.predicted, ahead.predicted - CLOSE)


def alternatives(shortlist: Sequence[Ranked]) -> list[Ranked]:
    """The shortlist without those that promise no more than a limit of theirs: their turn is after it.

    Damage, whose simulations are slow where a body begins to tear, comes behind those that promise nearly as much: it
    then has something to reach.
    """
    gains = {r.key: r.gain for r in shortlist}
    left = [r for r in shortlist
            if not any(r.gain < MORE * gains.get((limit, r.subject), 0.0) for limit in r.candidate.contains)]
    near = (1.0 - FAR) * max(gains.values(), default=0.0)
    slow = [r for r in left if _is_slow(r) and r.gain >= near]
    others = [r for r in left if r not in slow]
    last = max((k for k, r in enumerate(others) if r.gain >= near), default=-1) + 1
    return [*others[:last], *slow, *others[last:]]


def _job(source: Source, null: Refit, ranked: Ranked, variants: Sequence[Variant], warm: bool, drop: float,
         grid: Grid, seed: int, race: Race | None) -> RefitJob:
    """Variants start at their probes; warm : the best of them at what its score promises before that.

    drop : of chi-square, which ends the search for a better start
    """
    begins = [(v.label, {**v.edits, **v.refit}, {**null.values, **(v.null if v.direct else v.probe)})
              for v in variants]
    if warm:
        begins.insert(0, (begins[0][0], begins[0][1], warm_start(ranked, null.values)))
    labels, edits, values = zip(*begins, strict=True)
    return RefitJob(ranked.candidate.name, source, labels, edits, values, null.local, grid,
                    null.choice.chi2 - drop, seed, race)


def starting_variants(screening: Screening, candidate: Candidate, best: Variant) -> list[Variant]:
    """The best variant, then those of the same candidate with the same unknowns by score, at most `STARTS`."""
    scores = screening.scores
    found = {trial.variant.label: (abs(scores.z[i]), trial.variant) for i, trial in enumerate(screening.trials)
             if trial.candidate.name == candidate.name and trial.variant.new == best.new}
    others = sorted((entry for label, entry in found.items() if label != best.label), key=lambda e: -e[0])
    return [best, *(variant for _, variant in others)][:STARTS]


def _rival(ranked: Ranked, answer: Refit, null: Refit) -> Rival:
    if not answer.usable:
        return Rival(ranked, answer, ranked.gain, float("nan"), float("nan"))
    return Rival(ranked, answer, ranked.gain, null.choice.chi2 - answer.choice.chi2,
                 null.judgement.chi2 - answer.judgement.chi2)


def edits_of(winner: Rival, screening: Screening) -> dict[str, object]:
    """The edits of the variant that the winner's refit began at."""
    variant = variant_of(winner, screening)
    return {**variant.edits, **variant.refit}


def variant_of(rival: Rival, screening: Screening) -> Variant:
    """The variant that a rival's refit began at."""
    variants = [trial.variant for trial in screening.trials if trial.candidate.name == rival.name]
    return next(v for v in variants if v.label == rival.refitted.label)
