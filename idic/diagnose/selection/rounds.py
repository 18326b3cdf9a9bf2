"""The rounds of a diagnosis: screening, refits of the shortlist, selection of a candidate, which joins the null
model."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from idic.correlation import FrameResponse
from idic.diagnose.discretisation.following import following
from idic.diagnose.discretisation.known_error import known_error
from idic.diagnose.discretisation.thickness_error import with_bricks
from idic.diagnose.discretisation.weight import error_column, weighed
from idic.diagnose.physics.candidate import Candidate
from idic.diagnose.refits.refit import Refit, identification_at, is_residual_of, residual_from_rest
from idic.diagnose.refits.refit_job import ExperimentSource, RefitJob, Refits, Told, refit_of_one
from idic.diagnose.residual.channel_left import smallest_reading
from idic.diagnose.residual.evidence import Columns
from idic.diagnose.residual.excess import power
from idic.diagnose.residual.excess_left import effect
from idic.diagnose.residual.heldout import fit
from idic.diagnose.residual.margin import ASSUMED, Margin
from idic.diagnose.residual.measured_motion import MAX_REGISTER_PX, holds_motion
from idic.diagnose.residual.residual_evidence import ResidualEvidence, residual_evidence
from idic.diagnose.residual.subpixel_columns import RELATIVE_STD, subpixel_columns
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.residual.thinning import COPY_VARIANCE_FACTOR
from idic.diagnose.screen.free_courses import with_free_courses
from idic.diagnose.screen.local_residual import local_residual_tests
from idic.diagnose.screen.misregistration import reason_to_wait
from idic.diagnose.screen.score_columns import ScoreColumn, score_columns
from idic.diagnose.screen.select import MIN_CHANNEL_EFFECT_STD, Screening, screen_candidates
from idic.diagnose.screen.situation import situation
from idic.diagnose.selection.block_step import judged_by_step
from idic.diagnose.selection.both_copies import judged_on_both, undecided
from idic.diagnose.selection.few_jumps import with_few_jumps, without_idle_jumps
from idic.diagnose.selection.finite_strains import with_finite_strains_counted
from idic.diagnose.selection.judged_together import Doubted, Last, judged_alone, judged_together
from idic.diagnose.selection.own_course import with_imitated, with_own_course
from idic.diagnose.selection.own_scale import with_own_scale
from idic.diagnose.selection.revision import Workplace, earns_its_place, revised
from idic.diagnose.selection.rival import Rival, Round, causes_of, judge
from idic.diagnose.selection.rivals import edits_of, from_other_starts, refitted
from idic.diagnose.selection.rivals_again import foreseen, judged_again, near_rivals
from idic.errors import NotConverged
from idic.identification import Identification
from idic.model import MotionError

MAX_ROUNDS = 3
YIELD_STATES = ("plastic_strain",)
CAMERA = "camera"  # the family that is left out where another system has measured the fields
Stage = Callable[[str], None]
Group = list[tuple[ExperimentSource, Refit]]  # indistinguishable models
Watch = Callable[[ResidualEvidence, Sequence[ScoreColumn], Columns], None]


def silent(text: str) -> None:
    """A stage that reports nothing."""


def unwatched(residual: ResidualEvidence, tested: Sequence[ScoreColumn], columns: Columns) -> None:
    """A watch that looks at nothing."""


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


def null_refit(source: ExperimentSource, found: Identification, setting: Setting) -> Refit:
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


def selected_rounds(source: ExperimentSource, found: Identification, null: Refit, whole: ResidualEvidence,
                    setting: Setting) -> tuple[list[Round], ExperimentSource, Refit, list[Group], ResidualEvidence]:
    """Additions to the model, its last source and refit, the indistinguishable groups, and a residual on the recording:
    of the last model, unless it finds no equilibrium from rest.

    whole : residual of the identified model on the recording itself
    """
    rounds: list[Round] = []
    doubted: Doubted | None = None
    bends, place = has_state(found, YIELD_STATES), _workplace(setting)
    unit = float(power(whole.evidence).sum()) / COPY_VARIANCE_FACTOR if holds_motion(found.experiment) else np.inf
    for number in range(1, 2 if setting.quick else MAX_ROUNDS + 1):
        if rounds:
            rounds, source, null, whole = _beside_its_errors(rounds, source, null, whole, setting)
        far = effect(null.judgement, unit) > MAX_REGISTER_PX  # type: ignore[arg-type]
        one = _round(source, null, number, rounds, setting, bends, far, whole)
        if one.winner is not None and not setting.quick:
            alone = Doubted(one, tuple(rounds), Last(source, null, whole))
            one, whole = held_by_blocks(one, whole, setting, bool(causes_of(rounds)))
            doubted = alone if doubted is None and one.awaits_others else doubted
        if one.winner is None:
            rounds.append(one)
            break
        rounds.append(one)
        if len(rounds) > 1:
            setting.stage("every selected cause tested for removal and exchange")
            with setting.clock.step("revision_s"):
                rounds, selected = revised(rounds, place), [one.winner for one in rounds]
                if [one.winner for one in rounds] != selected:
                    whole = _residual_of_winner(rounds[-1]) or whole
        last = rounds[-1]
        source, null = last.source.with_edits(edits_of(last.winner, last.screening)), last.winner.refitted
    else:
        if len(rounds) > 1:
            rounds, source, null, whole = _beside_its_errors(rounds, source, null, whole, setting)
    if doubted is not None:
        setting.stage("judgement of all causes on parts of the recording")
        with setting.clock.step("blocks_s"):
            judged = judged_by_step(doubted.model.whole, whole, setting.grid)
        rounds, last_model = judged_together(rounds, Last(source, null, whole), doubted, judged)
        source, null, whole = last_model.source, last_model.null, last_model.whole
    rounds = [with_imitated(one, whole.u) for one in rounds]
    return rounds, source, null, [_group(one) for one in rounds if one.winner is not None and one.equals], whole


def _beside_its_errors(rounds: list[Round], source: ExperimentSource, null: Refit, whole: ResidualEvidence,
                       setting: Setting) -> tuple[list[Round], ExperimentSource, Refit, ResidualEvidence]:
    """A model that a cause has joined with the error of its mesh, bricks and finite strains where the recording asks
    for them now, and what these change of its last cause: a nearer rival, none, fewer jumps."""
    before, near, known = null, near_rivals(rounds[-1]), source.motion_error
    source, null, whole = with_new_error(source, null, whole, setting)
    rounds = [_knowing(one, source) for one in rounds]
    counted = _finite_strains(rounds, source, null, whole, setting)
    is_finite, (rounds, source, null, whole) = counted[2] is not null, counted
    if near and null is not before:
        rounds, source, null, whole = _rivals_again(rounds, near, source, null, whole, is_finite, known, setting)
    if len(rounds) > 1 and null is not before:
        rounds, source, null, whole = _last_cause_again(rounds, source, null, whole, setting)
    if null is not before:
        rounds, source, null, whole = _without_idle_jumps(rounds, source, null, whole, setting)
    return rounds, source, null, whole


def _residual_of_winner(one: Round) -> ResidualEvidence | None:
    """Residual of a round's winner on the recording; None where it finds no equilibrium from rest."""
    there = one.source.with_edits(edits_of(one.winner, one.screening))  # type: ignore[union-attr, arg-type]
    return residual_from_rest(there.load(), one.winner.refitted)  # type: ignore[union-attr]


def _knowing(one: Round, source: ExperimentSource) -> Round:
    """A round whose source knows the error of the last model, for its refits in a revision."""
    error = source.motion_error
    return one if error is None or one.source is None else replace(one, source=one.source.with_motion_error(error))


def _finite_strains(rounds: list[Round], source: ExperimentSource, null: Refit, whole: ResidualEvidence,
                    setting: Setting) -> tuple[list[Round], ExperimentSource, Refit, ResidualEvidence]:
    """The model that a cause has joined with finite strains, where the recording asks for them."""
    with setting.clock.step("mesh_s"):
        counted = with_finite_strains_counted(rounds, null, whole, setting.refits, setting.grid, setting.seed)
    return (rounds, source, null, whole) if counted is None else counted


def _rivals_again(rounds: list[Round], near: Sequence[Rival], source: ExperimentSource, null: Refit,
                  whole: ResidualEvidence, is_finite: bool, error: MotionError | None, setting: Setting,
                  ) -> tuple[list[Round], ExperimentSource, Refit, ResidualEvidence]:
    """The last cause and its nearest rivals judged anew, as bricks, finite strains or an error of the mesh have joined.

    near : as they were before; whole : residual of the present model on the recording itself; error : before
    """
    setting.stage("rivals of the cause compared again, as the model has changed beside it")
    with setting.clock.step("refits_s"):
        foresee = partial(foreseen, known=source.motion_error, before=error, grid=setting.grid)
        left = fit(whole, setting.grid).chi2 - following(whole)[1]
        judged = judged_again(rounds, near, source, null, is_finite, foresee, setting.refits, setting.grid,
                              setting.seed, left)
        after = whole if judged[2] is null else residual_from_rest(judged[1].load(), judged[2])
    return (rounds, source, null, whole) if after is None else (*judged, after)


def _last_cause_again(rounds: list[Round], source: ExperimentSource, null: Refit, whole: ResidualEvidence,
                      setting: Setting) -> tuple[list[Round], ExperimentSource, Refit, ResidualEvidence]:
    """Without the last cause, where bricks, finite strains or an error of the mesh that have joined since leave it less
    than a further cause must explain.

    null, whole : fit with it, and its residual on the recording itself
    """
    last, first = rounds[-1], next(iter(causes_of(rounds)), rounds[0])
    setting.stage("the last cause tested anew, as the model has changed beside it")
    with setting.clock.step("revision_s"):
        (without,) = setting.refits([refit_of_one(last.source, "null", last.null, setting.grid,  # type: ignore[arg-type]
                                                  setting.seed)])
        if not without.usable or earns_its_place(last.winner, first.null.judgement,  # type: ignore[arg-type]
                                                 without.judgement, null.judgement):
            return rounds, source, null, whole
        after = residual_from_rest(last.source.load(), without)  # type: ignore[union-attr]
    return (rounds, source, null, whole) if after is None else (rounds[:-1], last.source, without, after)  # type: ignore


def _without_idle_jumps(rounds: list[Round], source: ExperimentSource, null: Refit, whole: ResidualEvidence,
                        setting: Setting) -> tuple[list[Round], ExperimentSource, Refit, ResidualEvidence]:
    """Without jumps of the last cause that bricks, finite strains or an error of the mesh have made idle."""
    with setting.clock.step("revision_s"):
        found = without_idle_jumps(rounds[-1], source, null, setting.refits, setting.grid, setting.seed)
        after = None if found is None else residual_from_rest(found[1].load(), found[2])
    return (rounds, source, null, whole) if after is None else ([*rounds[:-1], found[0]], *found[1:], after)  # type: ignore


def with_new_error(source: ExperimentSource, null: Refit, whole: ResidualEvidence,
                   setting: Setting) -> tuple[ExperimentSource, Refit, ResidualEvidence]:
    """The model that a cause has joined with the error of its own mesh, where that differs from the one before, and of
    plane stress, where the recording asks for it now that the cause does not hide it: before, a further cause would
    take it up.

    whole : its residual on the recording itself
    """
    setting.stage("error of the mesh, plane stress and finite strains, tested beside the cause")
    with setting.clock.step("mesh_s"):
        known = source.motion_error
        found = identification_at(source.load(), null.values, null.local, null.steps)
        bricks = None
        if known is None or known.thickness is None:
            bricks = with_bricks(found, whole, setting.grid, settled=False)
        error = None if bricks is None else bricks[0]
        if error is None:
            error = known_error(found, known)
            if error is None:
                return source, null, whole
        change = weighed(whole, error.less(known))
        if bricks is None and not change.matters:
            return source, null, whole
        there = source.with_motion_error(error)
        setting.stage("fit with the error of the mesh")
        (again,) = setting.refits([refit_of_one(there, "null", null, setting.grid, setting.seed,
                                                change.moves, estimator=null.estimator)])
        again = replace(again, phi=null.phi) if np.isnan(again.phi) else again  # of ordinary least squares, before
        after = residual_from_rest(there.load(), again) if again.usable else None
        return (source, null, whole) if after is None else (there, again, after)


def _round(source: ExperimentSource, null: Refit, number: int, before: Sequence[Round], setting: Setting,
           bends: bool, far: bool, whole: ResidualEvidence) -> Round:
    """One addition to the model, or none.

    before : the rounds before, whose causes are in the model; bends : a law of yielding was identified; far : the
    null is pixels off the motion; whole : residual on the recording, mostly of the null: it is not simulated anew then
    """
    stage, clock, refits = setting.stage, setting.clock, setting.refits
    before = causes_of(before)
    stage(f"screening of the library, round {number}")
    with clock.step("screening_s"):
        known = whole.responses if is_residual_of(whole, null, source.motion_error) else None
        screening = screened(source, null, setting.library, setting.watch, setting.margin, bool(before),
                             known)
    if not screening.shortlist:
        stage("no candidate is significant: no refit")
    with clock.step("refits_s"):
        told = Told(refits, stage, 1 if setting.quick else len(screening.shortlist))
        rivals = refitted(source, null, screening, told, setting.grid, setting.seed, bends=not before and bends,
                          alone=setting.quick, far=far)
    winner, equals = judge(rivals, screening)
    crossed = plain = None
    if not before and not setting.quick and (near := undecided(rivals)):
        stage(f"judgement on both copies: {', '.join(r.ranked.called for r in near)}")
        with clock.step("refits_s"):
            rivals, crossed = judged_on_both(source, null, rivals, screening, refits, setting.grid, setting.seed)
        winner, equals = judge(rivals, screening)
    if winner is not None and not setting.quick:
        with clock.step("refits_s"):
            lower = from_other_starts(source, null, winner, screening, told, setting.grid, setting.seed)
        if lower is not None:
            rivals = tuple(lower if r is winner else r for r in rivals)
            winner, equals = judge(rivals, screening)
    if winner is not None and not setting.quick:
        with clock.step("refits_s"):
            freed = with_own_course(source, null, winner, screening, told, setting.grid, setting.seed)
            jumps = with_few_jumps(source, null, freed or winner, told, setting.grid, setting.seed)
            rescaled = with_own_scale(source, null, winner, told, setting.grid, setting.seed)
        if (other := jumps or freed or rescaled) is not None:
            plain, rivals = None if other is rescaled else winner, tuple(other if r is winner else r for r in rivals)
            winner, equals = judge(rivals, screening)
    if before and winner is not None:
        first = before[0].null.judgement
        earning = [r for r in rivals
                   if r.passes and earns_its_place(r, first, null.judgement, r.refitted.judgement)]
        if winner not in earning:
            passed_over, plain = winner, None
            winner, equals = judge(earning, screening)
            return Round(screening, null, rivals, winner, equals, crossed, source, passed_over)
    return Round(screening, null, rivals, winner, equals, crossed, source, plain=plain)


def held_by_blocks(one: Round, whole: ResidualEvidence, setting: Setting,
                   further: bool = False) -> tuple[Round, ResidualEvidence]:
    """A round after the judgement of blocks of the recording, which had no part in the fit of its winner
    (`idic.diagnose.selection.judged_together`), and the residual of the last model.

    whole : residual of the null on the recording itself; further : there is a cause in the null. On a measured motion,
    an inclusion that leaves motion at its own place describes a flaw of that cause then and is none itself. Blocks
    measure motions and readings: of a cause that acts on grey values they say nothing
    """
    setting.stage("judgement on parts of the recording")
    with setting.clock.step("blocks_s"):
        winner = one.winner
        after = _residual_of_winner(one)
        if after is None:
            return replace(one, winner=None, equals=(), passed_over=winner), whole
        of_grey_values = winner.ranked.variant.pixels is not None  # type: ignore[union-attr]
        judged = () if of_grey_values else judged_by_step(whole, after, setting.grid)
        formal = further and holds_motion(after.context.experiment) and any(
            left.matters for left in local_residual_tests(whole, after, setting.grid,
                                                          winner.refitted.values, setting.margin))  # type: ignore
    one = judged_alone(one, judged, formal)
    return one, whole if one.winner is None else after


def _workplace(setting: Setting) -> Workplace:
    """What the refits of revised sets need."""
    def screen_some(source: ExperimentSource, null: Refit, library: Sequence[Candidate]) -> Screening:
        return screened(source, null, library, margin=setting.margin, further=True)

    return Workplace(screen_some, setting.refits, setting.grid, setting.seed)


def _group(one: Round) -> Group:
    """The winner of a round and the models that are indistinguishable from it."""
    return [(one.source.with_edits(edits_of(r, one.screening)), replace(r.refitted, name=r.name)) for r in one.rivals
            if r is one.winner or r.name in one.equals]


def screened(source: ExperimentSource, null: Refit, library: Sequence[Candidate], watch: Watch = unwatched,
             margin: Margin = ASSUMED, further: bool = False,
             responses: Sequence[FrameResponse] | None = None) -> Screening:
    """Score every candidate against the null model on the whole recording: a score fits nothing, and one copy shows
    a faint effect by seven tenths of the standard deviations only. Refits see one copy, and promises are of that.

    further : the null holds a selected cause; responses : of the null, where it has been simulated
    """
    found = identification_at(source.load(), null.values, null.local, null.steps)
    residual = residual_evidence(found, responses=responses)
    here = situation(found, residual, source.document())
    apply = [candidate for candidate in library if found.experiment.points is None or candidate.family != CAMERA]
    trials, untestable = [], []
    for candidate in apply:
        why = candidate.reason_against(here)
        variants = () if why else candidate.variants(here)
        if why := why or reason_to_wait(variants, residual, null.choice):
            untestable.append((candidate, why))
        else:
            trials += [(candidate, variant) for variant in variants]

    trials += with_free_courses(trials, here.document, found.parameters.free, source.load)
    labels, columns = score_columns(found, residual, trials, source.load) if trials else ((), residual.null.pick([]))
    watch(residual, labels, columns)
    error = source.motion_error
    blurs = subpixel_columns(residual) if any(variant.pixels is not None for _, variant in trials) else None
    made = screen_candidates(residual.evidence, residual.null, labels, columns, room=null.choice.room,
                  mesh=None if error is None else error_column(residual, error.of_mesh),
                  known=None if blurs is None else (blurs, RELATIVE_STD),
                  materials=[material.element_set for material in found.experiment.materials], margin=margin,
                  further=further,
                  min_channel=max(MIN_CHANNEL_EFFECT_STD, smallest_reading(residual)) if further
                  else MIN_CHANNEL_EFFECT_STD)
    unresolved = [r for r in made.significant if r.variant.unresolved]
    untestable += [(r.candidate, r.variant.unresolved) for r in unresolved]
    return replace(made, ranked=tuple(r for r in made.ranked if r not in unresolved), untestable=tuple(untestable))


def has_state(found: Identification, states: Collection[str]) -> bool:
    """Whether a law of the identified model has one of these states."""
    laws = (section.law.spec for section in found.forward.model.sections)
    return any(state in law.state_names for law in laws for state in states)
