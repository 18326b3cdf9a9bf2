"""The diagnosis of one identification: residual, location, screening, refits, judgement, the next round.

    1  residual evidence of the identified model; side, onset and place of the mismatch
    2  null refit: the identified model fitted to one of two thinned copies of the recording
    3  up to `MAX_ROUNDS` rounds: screening, refits of the shortlist, selection of a candidate; it joins the null model
    4  the enriched model fitted to the recording itself; excess of its residual; verdict

This module marches and screens; every refit is a job (`RefitJob`) for the callable that the caller supplies.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from idic.diagnose.channel_left import ChannelLeft, channels_left
from idic.diagnose.locate.active_elements import ACTIVE_STATES, Activity, activity
from idic.diagnose.locate.mismatch import Mismatch, SelectedEffect, locate
from idic.diagnose.next_test import next_experiment, unloads
from idic.diagnose.notes import Notes
from idic.diagnose.probability import probability
from idic.diagnose.refit import Refit, identification_at, refit_residual
from idic.diagnose.refit_job import ExperimentSource, RefitJob, Refits, Told, refit_of_one
from idic.diagnose.residual.evidence import Columns
from idic.diagnose.residual.excess import power
from idic.diagnose.residual.heldout import Fit, fit, grid_of
from idic.diagnose.residual.margin import ASSUMED, Margin
from idic.diagnose.residual.residual_evidence import ResidualEvidence, residual_evidence
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.residual.thinning import CHOICE, COPY_VARIANCE_FACTOR, thinned
from idic.diagnose.revision import Workplace, min_further_drop, revised
from idic.diagnose.rivals import edits_of, judged_on_both, refitted, undecided
from idic.diagnose.screen.candidate import Candidate, candidates
from idic.diagnose.screen.local_residual import local_residual_tests
from idic.diagnose.screen.score_columns import ScoreColumn, score_columns
from idic.diagnose.screen.select import Screening, screen
from idic.diagnose.screen.situation import situation
from idic.diagnose.screen.time_course import time_course_test
from idic.diagnose.verdict import ExcessLeft, Round, Verdict, conclude, effect, judge
from idic.errors import NotConverged
from idic.identify.in_memory import Identification

MAX_ROUNDS = 3
SEED = 20260
YIELD_STATES = ("plastic_strain",)
CAMERA = "camera"  # the family that is left out where another system has measured the fields
Stage = Callable[[str], None]
Group = list[tuple[ExperimentSource, Refit]]  # indistinguishable models
Watch = Callable[[ResidualEvidence, Sequence[ScoreColumn], Columns], None]


def silent(text: str) -> None:
    """A stage that reports nothing."""


def unwatched(residual: ResidualEvidence, tested: Sequence[ScoreColumn], columns: Columns) -> None:
    """A watch that looks at nothing."""


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """All results, for files and figures.

    Attributes
    ----------
    found : the identification under diagnosis
    mismatch : side, onset and place; None where a law finds no equilibrium along the path
    rounds : additions to the model; the last one has no winner, unless the limit of rounds was reached
    residual_before, residual_after : of the identified and the enriched model on the recording itself
    final : the enriched model fitted to the recording itself, None without a selected candidate
    source : the experiment with every selected candidate
    whole_before : fit of the identified model on the recording itself
    effect_px : unexplained motion of the identified model, rms
    cost : seconds per step
    active : elements in which the first selected candidate acts; None where it is no law of yielding, flow or damage
    excess_left : local residual tests at new inclusions, and the time-course test
    margin : motion that no candidate may be blamed for
    notes : parts beside the verdict that failed
    channels, left : what the last model leaves in the channels, and of motions, on the whole recording
    probability : that the selected set holds the truth (`idic.diagnose.probability`), None where the test says nothing
    quick : no rival was refitted, and `final` is the fit to one copy
    """

    found: Identification
    mismatch: Mismatch | None
    rounds: tuple[Round, ...]
    verdict: Verdict
    residual_before: ResidualEvidence
    residual_after: ResidualEvidence | None
    final: Refit | None
    source: ExperimentSource
    whole_before: Fit
    effect_px: float
    grid: Grid
    cost: Mapping[str, float]
    active: Activity | None = None
    excess_left: tuple[ExcessLeft, ...] = ()
    margin: Margin = ASSUMED
    notes: tuple[str, ...] = ()
    channels: tuple[ChannelLeft, ...] = ()
    left: ExcessLeft | None = None
    probability: float | None = None
    quick: bool = False

    @property
    def selected_effect(self) -> SelectedEffect | None:
        """Side and onset of the first selected candidate, None without one.

        It acts from the start unless it, or a candidate indistinguishable from it, has an onset.
        """
        first = self.rounds[0]
        if first.winner is None:
            return None
        candidate, active = first.winner.ranked.candidate, self.active
        has_onset = any(rival.ranked.candidate.has_onset for rival in first.rivals
                        if rival is first.winner or rival.name in first.equals)
        modifies = active is not None and not candidate.shows_at_reversal and has_state(self.found, ACTIVE_STATES)
        return SelectedEffect(candidate.side, not has_onset, None if active is None else active.first_frame,
                              modifies)


@dataclass
class Clock:
    """Seconds spent on every step."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def step(self, name: str):
        """Add the time spent inside to a step."""
        began = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - began


@dataclass(frozen=True, eq=False)
class Setting:
    """What all steps of one diagnosis share.

    refits : runs refit jobs; stage : called with the name of a step that begins; seed : of the noise that makes two
    copies of the recording; library : candidates that are tested; watch, margin, quick : see `diagnose`
    """

    refits: Refits
    grid: Grid
    seed: int
    library: Sequence[Candidate]
    stage: Stage
    clock: Clock
    watch: Watch
    margin: Margin
    quick: bool = False


def diagnose(source: ExperimentSource, found: Identification, refits: Refits, stage: Stage = silent, seed: int = SEED,
             library: Sequence[Candidate] | None = None, watch: Watch = unwatched,
             margin: Margin = ASSUMED, quick: bool = False) -> Diagnosis:
    """Locate the mismatch of an identification, select the missing physics, refit, and judge on held-out data.

    Parameters
    ----------
    source : experiment of the identification, which candidates edit
    refits : runs refit jobs
    stage : called with the name of every step that begins
    seed : of the noise that makes two copies of the recording
    library : candidates to test, all registered ones by default
    watch : called with the input of every screening: residual evidence, tested columns, their fields
    margin : motion that no candidate may be blamed for, with the camera's own floor where it was measured
    quick : screening and refit of the most promising candidate alone: no rivals, no further cause, no final fit

    Raises
    ------
    NotConverged
        If the identified model finds no equilibrium on a copy of the recording.
    """
    clock = Clock()
    stage("residual evidence of the identified model")
    with clock.step("gather_s"):
        before = residual_evidence(found, light=False)
        grid = grid_of(before)
        whole = fit(before, grid)
    setting = Setting(refits, grid, seed, candidates() if library is None else library, stage, clock, watch, margin,
                      quick)
    stage("side, onset and place of the mismatch")
    with clock.step("locate_s"):
        mismatch = located(found, before, margin)
    first = _null_refit(source, found, setting)
    rounds, source, null, groups = _rounds(source, found, first, setting)
    final, after, active = _enriched(source, null, rounds, setting) if null is not first else (None, None, None)
    unit = float(power(before.evidence).sum())
    of_camera = {"margin_px": margin.px, "camera_px": margin.camera_px}
    on_copy = ExcessLeft(first.judgement, null.judgement, unit / COPY_VARIANCE_FACTOR, **of_camera)
    excesses, own = [on_copy], []
    limited = not quick and null.status == "max_iterations"
    channels = channels_left(before, after)
    if after is not None:
        own = [*local_residual_tests(before, after, grid, final.values, margin),
               time_course_test(before, after, grid, margin)]
        excesses = [ExcessLeft(whole, fit(after, grid), unit, **of_camera), *own, on_copy]
        if on_copy.matters and not any(one.matters for one in excesses[:-1]) and limited:
            stage("fit of the enriched model to one copy, without a limit of evaluations")
            with clock.step("final_s"):
                excesses[-1] = unlimited_excess(on_copy, source, null, refits, grid, seed)
    alone = rounds[0].winner is not None and null is rounds[0].winner.refitted
    heldout = rounds[0].heldout_fits(rounds[0].winner) if alone else (first.judgement, null.judgement)
    verdict = conclude(rounds, *heldout, mismatch is not None and mismatch.is_significant, excesses,
                       unloads(found.experiment), _camera_chi2(margin, unit, rounds[0] if alone else None), channels)
    notes = Notes()
    advice = _separating_test(groups, setting, notes)
    if advice is not None:
        verdict = replace(verdict, next_experiment=advice)
    return Diagnosis(found, mismatch, tuple(rounds), verdict, before, after, final, source, whole, effect(whole, unit),
                     grid, clock.seconds, active, tuple(own), margin, tuple(notes.told), channels, excesses[0],
                     probability(verdict, rounds, excesses[0], channels), quick)


def _separating_test(groups: Sequence[Group], setting: Setting, notes: Notes) -> str | None:
    """The simulated test that separates the first indistinguishable group for which there is one."""
    for members in groups:
        setting.stage("simulation of tests that separate " + " and ".join(r.name for _, r in members))
        with setting.clock.step("next_s"):
            advice = notes.attempt("a simulated next test", next_experiment, members)
        if advice is not None:
            return advice
    return None


def _camera_chi2(margin: Margin, power_of_unit: float, judged: Round | None) -> float:
    """Chi-square of the camera's floor on the copies that judge; judged : the round, where one candidate was selected."""
    if margin.floor is None:
        return 0.0
    copies = 2 if judged is not None and judged.winner.crossed_judgement is not None else 1  # type: ignore[union-attr]
    return copies * margin.floor.px**2 * power_of_unit / COPY_VARIANCE_FACTOR


def _null_refit(source: ExperimentSource, found: Identification, setting: Setting) -> Refit:
    """The identified model fitted to the copy for choosing."""
    setting.stage("fit of the identified model to one of two copies of the recording")
    with setting.clock.step("null_s"):
        (null,) = setting.refits([RefitJob("null", source, ("null",), ({},), (found.parameters.as_values(),),
                                           found.local, setting.grid, np.inf, setting.seed)])
    if not null.usable:
        raise NotConverged("the identified model finds no equilibrium when it is fitted again to a copy of the "
                           "recording; no candidate can be compared with it. Identify with smaller increments, or from "
                           f"the values of result.json, and diagnose again ({null.problem})")
    return null


def _rounds(source: ExperimentSource, found: Identification, null: Refit,
            setting: Setting) -> tuple[list[Round], ExperimentSource, Refit, list[Group]]:
    """Additions to the model, its last source and refit, and the indistinguishable groups."""
    rounds: list[Round] = []
    bends, place = has_state(found, YIELD_STATES), _workplace(setting)
    for number in range(1, 2 if setting.quick else MAX_ROUNDS + 1):
        one = _round(source, null, number, rounds, setting, bends)
        if one.winner is None:
            rounds.append(one)
            break
        rounds.append(one)
        if len(rounds) > 1:
            setting.stage("every selected cause tested for removal and exchange")
            with setting.clock.step("revision_s"):
                rounds = revised(rounds, place)
        last = rounds[-1]
        source, null = last.source.with_edits(edits_of(last.winner, last.screening)), last.winner.refitted
    return rounds, source, null, [_group(one) for one in rounds if one.winner is not None and one.equals]


def _round(source: ExperimentSource, null: Refit, number: int, before: Sequence[Round], setting: Setting,
           bends: bool) -> Round:
    """One addition to the model, or none.

    before : the rounds before, whose causes are in the model; bends : a law of yielding was identified
    """
    stage, clock, refits = setting.stage, setting.clock, setting.refits
    stage(f"screening of the library, round {number}")
    with clock.step("screening_s"):
        screening = screened(source, null, setting.seed, setting.library, setting.watch, setting.margin, bool(before))
    if not screening.shortlist:
        stage("no candidate is significant: no refit")
    with clock.step("refits_s"):
        told = Told(refits, stage, 1 if setting.quick else len(screening.shortlist))
        rivals = refitted(source, null, screening, told, setting.grid, setting.seed, bends=not before and bends,
                          alone=setting.quick)
    winner, equals = judge(rivals, screening)
    crossed = None
    if not before and not setting.quick and (near := undecided(rivals)):
        stage(f"judgement on both copies: {', '.join(r.ranked.called for r in near)}")
        with clock.step("refits_s"):
            rivals, crossed = judged_on_both(source, null, rivals, screening, refits, setting.grid, setting.seed)
        winner, equals = judge(rivals, screening)
    if before and winner is not None:
        drop = before[0].null.judgement.chi2 - winner.refitted.judgement.chi2
        if winner.heldout < min_further_drop(winner, drop):
            return Round(screening, null, rivals, None, (), crossed, source, winner)
    return Round(screening, null, rivals, winner, equals, crossed, source)


def _workplace(setting: Setting) -> Workplace:
    """What the refits of revised sets need."""
    def screen_some(source: ExperimentSource, null: Refit, library: Sequence[Candidate]) -> Screening:
        return screened(source, null, setting.seed, library, margin=setting.margin, further=True)

    return Workplace(screen_some, setting.refits, setting.grid, setting.seed)


def _group(one: Round) -> Group:
    """The winner of a round and the models that are indistinguishable from it."""
    return [(one.source.with_edits(edits_of(r, one.screening)), r.refitted) for r in one.rivals
            if r is one.winner or r.name in one.equals]


def screened(source: ExperimentSource, null: Refit, seed: int, library: Sequence[Candidate],
             watch: Watch = unwatched, margin: Margin = ASSUMED, further: bool = False) -> Screening:
    """Score every candidate against the null model on the copy for choosing.

    further : the null holds a selected cause
    """
    found = identification_at(thinned(source.load(), CHOICE, seed), null.values, null.local, null.steps)
    residual = residual_evidence(found)
    here = situation(found, residual, source.document())
    apply = [candidate for candidate in library if found.experiment.points is None or candidate.family != CAMERA]
    trials = [(candidate, variant) for candidate in apply for variant in candidate.variants(here)]

    def load(edits: Mapping[str, Any]):
        return thinned(source.load(edits), CHOICE, seed)

    labels, columns = score_columns(found, residual, trials, load) if trials else ((), residual.null.pick([]))
    watch(residual, labels, columns)
    return screen(residual.evidence, residual.null, labels, columns, room=null.choice.room,
                  materials=[material.element_set for material in found.experiment.materials], margin=margin, further=further)


def _enriched(source: ExperimentSource, null: Refit, rounds: Sequence[Round],
              setting: Setting) -> tuple[Refit, ResidualEvidence | None, Activity | None]:
    """The last model fitted to the recording itself, its residual (None without an equilibrium), its active elements.

    The fit begins at the end of the fit to a copy, a few standard deviations away, with the estimator of that end. A quick
    diagnosis ends with the fit to the copy.
    """
    setting.stage("residual of the enriched model" if setting.quick else "fit of the enriched model to the whole recording")
    with setting.clock.step("final_s"):
        (final,) = [null] if setting.quick else setting.refits([refit_of_one(
            source, "enriched", null, setting.grid, setting.seed, copies=False, estimator=null.estimator)])
        if not final.usable:
            return final, None, None
        after, active = refit_residual(source.load(), final), None
        if rounds[0].winner.ranked.candidate.kind.active:
            active = activity(identification_at(source.load(), final.values, final.local, final.steps))
    return final, after, active


def unlimited_excess(copy: ExcessLeft, source: ExperimentSource, null: Refit, refits: Refits, grid: Grid,
                     seed: int) -> ExcessLeft:
    """Excess on the copy for judging after the fit to the other copy has converged, without a limit of evaluations."""
    (fitted,) = refits([refit_of_one(source, "ended", null, grid, seed, unlimited=True)])
    return replace(copy, after=fitted.judgement) if fitted.usable else copy


def located(found: Identification, residual: ResidualEvidence, margin: Margin = ASSUMED) -> Mismatch | None:
    """Side, onset and place; None where a law finds no equilibrium along the path."""
    try:
        return locate(found, residual, margin=margin)
    except NotConverged:
        return None


def has_state(found: Identification, states: Collection[str]) -> bool:
    """Whether a law of the identified model has one of these states."""
    laws = (section.law.spec for section in found.forward.model.sections)
    return any(state in law.state_names for law in laws for state in states)
