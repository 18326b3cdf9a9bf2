"""The diagnosis of one identification: residual, location, screening, refits, judgement, the next round.

    1  residual evidence of the identified model, with the error of its mesh; side, onset and place of the mismatch
    2  null refit: the identified model fitted to one of two thinned copies of the recording
    3  up to `MAX_ROUNDS` rounds: screening, refits of the shortlist, selection of a candidate; it joins the null model
    4  the enriched model fitted to the recording itself; excess of its residual; verdict

This module marches and screens; every refit is a job (`RefitJob`) for the callable that the caller supplies.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

from idic.diagnose.discretisation.following import is_at
from idic.diagnose.discretisation.known_error import renewed_error, with_error
from idic.diagnose.discretisation.neglected import Neglected, neglected
from idic.diagnose.discretisation.sheet import sheet_and_bricks_at
from idic.diagnose.discretisation.thickness_error import neglected_errors, with_bricks, with_thickness
from idic.diagnose.discretisation.thickness_std import std_factors
from idic.diagnose.discretisation.weight import MIN_SHIFT_STD, weighed
from idic.diagnose.free_form import NEXT_TEST, Base, FreeForm, free_form, has_other_sides, is_offered
from idic.diagnose.locate.active_elements import ACTIVE_STATES, Activity, activity
from idic.diagnose.locate.mismatch import Mismatch, SelectedEffect, locate
from idic.diagnose.next_test import next_experiment, unloads
from idic.diagnose.notes import Notes
from idic.diagnose.physics.candidate import Candidate
from idic.diagnose.physics.edits import open_share
from idic.diagnose.probability import probability
from idic.diagnose.refits.refit import Refit, identification_at, is_residual_of, refit_residual, residual_from_rest
from idic.diagnose.refits.refit_job import ExperimentSource, Refits, refit_of_one
from idic.diagnose.residual.channel_left import MIN_READING_SHARE, ChannelLeft, channels_left
from idic.diagnose.residual.excess import power
from idic.diagnose.residual.excess_left import ExcessLeft, effect
from idic.diagnose.residual.heldout import Fit, fit, grid_of
from idic.diagnose.residual.margin import ASSUMED, Margin
from idic.diagnose.residual.measured_motion import OutOfRegister
from idic.diagnose.residual.residual_evidence import ResidualEvidence, residual_evidence
from idic.diagnose.residual.spots import LeftOut
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.residual.thinning import COPY_VARIANCE_FACTOR
from idic.diagnose.screen.courses import Course, courses_of
from idic.diagnose.screen.library import candidate_library
from idic.diagnose.screen.local_residual import local_residual_tests
from idic.diagnose.screen.select import Ranked
from idic.diagnose.screen.situation import situation
from idic.diagnose.screen.time_course import time_course_test
from idic.diagnose.selection.block_step import BlockJudgement, judged_by_step
from idic.diagnose.selection.free_end import FreeEnd, free_end, may_be_an_end, told
from idic.diagnose.selection.other_axis import fit_from_other_axes, is_another_answer, is_better
from idic.diagnose.selection.rival import Round, causes_of
from idic.diagnose.selection.rounds import (Clock, Group, Setting, Stage, Watch, has_state, null_refit, selected_rounds,
                                            silent, unwatched)
from idic.diagnose.selection.verdict import Verdict, conclude, is_of_readings
from idic.errors import NotConverged
from idic.identification import Identification
from idic.model import MotionError
from idic.parameters import Parameter

SEED = 20260
MINIMA = ("converged", "at_bound")  # ends of a search whose values are those of a minimum
MAX_RENEWALS = 3  # of the known error of the last model: it depends on the parameters, and they on it
DRAW_FIRST = ("draw the outline of the specimen (outline_mm in mesh) and diagnose again; the outline of the points "
              "may explain the whole finding")


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
    blocks : both models on blocks of the recording, after one step from the finished fit to the others
    other_axis : fit of the last model with another axis, which the recording does not tell from it
    neglected : what bricks and finite strains would do to the parameters of the last model, where it has neither
    corrected : the identified model with its known error, fitted to the recording, where no cause joined it: with
        bricks, or on a finer mesh that moves its parameters
    register : where the images are out of register with the identified model and the measured motion took their place
    spots : what was left out of the images before
    free_form : the free law, refitted where no named cause of the specimen fits
    free_end : the end whose free motion explains more than the causes that were selected, which are not told then
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
    blocks: tuple[BlockJudgement, ...] = ()
    neglected: Neglected | None = None
    corrected: Refit | None = None
    other_axis: Refit | None = None
    register: OutOfRegister | None = None
    spots: LeftOut | None = None
    free_form: FreeForm | None = None
    free_end: FreeEnd | None = None

    @property
    def enriched(self) -> Refit | None:
        """The enriched model, where it was fitted to the recording and finds an equilibrium from rest; else None."""
        is_whole = self.final is not None and self.final.usable and self.residual_after is not None
        return self.final if is_whole else None

    @property
    def first_cause(self) -> Round | None:
        """The round of the first selected candidate, None without one; finite strains belong to the description, and
        are no cause where there is another."""
        won = [one for one in self.rounds if one.winner is not None]
        return next(iter(causes_of(won) or won), None)

    @property
    def selected_effect(self) -> SelectedEffect | None:
        """Side and onset of the first cause, None without one.

        It acts from the start unless it, or a candidate indistinguishable from it, has an onset.
        """
        first = self.first_cause
        if first is None:
            return None
        candidate, active = first.winner.ranked.candidate, self.active  # type: ignore[union-attr]
        has_onset = any(rival.ranked.candidate.has_onset for rival in first.rivals
                        if rival is first.winner or rival.name in first.equals)
        modifies = active is not None and not candidate.shows_at_reversal and has_state(self.found, ACTIVE_STATES)
        began = [course.onset for course in self.courses(first) if course.onset and course.onset[0] > 0]
        return SelectedEffect(candidate.side, not has_onset, None if active is None else active.first_frame,
                              modifies, min(began, default=None) if has_onset else None)

    def courses(self, one: Round) -> list[Course]:
        """Courses of the winner of a round, with their error bands; [] of a material."""
        if self.enriched is None:
            return []
        return courses_of(one.winner.name, self.residual_after.context.experiment,  # type: ignore[union-attr]
                          self.found.experiment, one.winner.ranked.variant.new,  # type: ignore[union-attr]
                          self.enriched.values, self.enriched.stds)


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
        source, here, before = with_error(source, found)
        grid = grid_of(before)
        whole = fit(before, grid)
    setting = Setting(refits, grid, seed, candidate_library() if library is None else library, stage, clock, watch,
                      margin, quick)
    stage("side, onset and place of the mismatch")
    with clock.step("locate_s"):
        mismatch = located(here, before, margin)
        significant = mismatch is not None and mismatch.is_significant
        absent = neglected_errors(here) if significant or not quick else {}
        source, there = with_thickness(source, here, before, whole, grid, absent, significant)
        if there is not here:
            here, before, absent = there, residual_evidence(there, light=False), None
            whole, mismatch = fit(before, grid), located(there, before, margin)
    first, begun = null_refit(source, here, setting), source
    rounds, source, null, groups, left = selected_rounds(source, here, first, before, setting)
    notes, unit = Notes(), float(power(before.evidence).sum())
    end = None if quick else notes.attempt("the free motion of an end", _free_end, begun, first, before, null, rounds,
                                           mismatch, setting, unit / COPY_VARIANCE_FACTOR)
    if end is not None:
        mismatch, rounds = told(end, mismatch, rounds)  # type: ignore[arg-type]
        source, null, groups = begun, first, []
    last = _Enriched(source) if null is first else _enriched(source, null, left, rounds, setting)
    source, final, after, active = last.source, last.final, last.after, last.active
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
    floor_px = margin.px if is_of_readings(excesses[0], channels) else 0.0 if margin.floor is None else margin.floor.px
    verdict = conclude(rounds, *heldout, mismatch is not None and mismatch.is_significant, excesses,
                       unloads(found.experiment), _floor_chi2(floor_px, unit, rounds[0] if alone else None), channels,
                       lambda one: _freedom(source, one))
    blocks = () if after is None else judged_by_step(before, after, grid)
    corrected, without = None, None
    if not quick and final is None:
        corrected = notes.attempt("the fit with the known error", _with_known_error, source, before, first, setting)
    of_bricks = None if source.motion_error is None or source.motion_error.thickness is None else corrected
    if not quick and (final is None or after is not None):
        without = notes.attempt("what the model neglects", _neglected, here, before, absent, source,
                                final if after is not None else of_bricks, after, clock)
    of_points = open_share(found.experiment) is not None and verdict.word not in ("none", "blind")
    advice = DRAW_FIRST if of_points else _separating_test(groups, setting, notes)
    curve = None
    if not quick and end is None and is_offered(verdict, mismatch, rounds, found.experiment):
        of_last = [(source, null, after)] if after is not None and has_other_sides(rounds) else []
        curve = notes.attempt("a free law", _free_form, [(begun, first, before), *of_last], setting,
                              unit / COPY_VARIANCE_FACTOR)
    if end is not None:
        advice = end.next_test
    if curve is not None and curve.describes and advice is None:
        advice = NEXT_TEST[curve.law.kind]
    if advice is not None:
        verdict = replace(verdict, next_experiment=advice)
    return Diagnosis(found, mismatch, tuple(rounds), verdict, before, after, final, source, whole, effect(whole, unit),
                     grid, clock.seconds, active, tuple(own), margin, tuple(notes.told), channels, excesses[0],
                     probability(verdict, rounds, excesses[0], channels), quick, blocks, without, corrected,
                     last.other, free_form=curve, free_end=end)


def _free_form(models: Sequence[tuple[ExperimentSource, Refit, ResidualEvidence]], setting: Setting,
               power_of_copy: float) -> FreeForm | None:
    """The free law that explains most in the place of a material's law of these models, the identified one first.

    models : experiment, fit to the copy for choosing, residual on the recording
    """
    setting.stage("a free law, as no named cause fits")
    with setting.clock.step("free_form_s"):
        bases = []
        for source, fitted, residual in models:
            there = identification_at(source.load(), fitted.values, fitted.local, fitted.steps)
            bases.append(Base(source, situation(there, residual, source.document()), fitted))
        return free_form(bases, models[0][1], setting.refits, setting.grid, setting.seed, power_of_copy,
                         setting.margin)


def _free_end(source: ExperimentSource, null: Refit, residual: ResidualEvidence, last: Refit, rounds: Sequence[Round],
              mismatch: Mismatch | None, setting: Setting, power_of_copy: float) -> FreeEnd | None:
    """The end whose free motion explains more than the selected causes.

    source, null, residual : the identified model, fitted to the copy for choosing, on the recording; last : the model
    with these causes
    """
    left = ExcessLeft(null.judgement, last.judgement, power_of_copy, margin_px=setting.margin.px)  # type: ignore
    if not may_be_an_end(mismatch, rounds, left):
        return None
    setting.stage("free motion of every end, as a rival of what was selected")
    with setting.clock.step("free_end_s"):
        there = identification_at(source.load(), null.values, null.local, null.steps)
        selected = [one.winner.ranked.candidate for one in rounds if one.winner is not None]
        return free_end(source, situation(there, residual, source.document()), null, last, selected, setting.refits,
                        setting.grid, setting.seed, power_of_copy, setting.margin)


def _freedom(source: ExperimentSource, ranked: Ranked) -> Parameter | None:
    """The degree of freedom that the amplitude of a direct candidate is the value of."""
    return source.load(ranked.variant.edits).parameters.get(ranked.label) if ranked.variant.direct else None


def _with_known_error(source: ExperimentSource, residual: ResidualEvidence, null: Refit,
                      setting: Setting) -> Refit | None:
    """The identified model with its known error, fitted to the recording; None where none is counted, or that of the
    mesh alone moves no parameter by half a standard deviation.

    A mesh that is coarse for its body and leaves no residual has moved the parameters: C10 of a strip of rubber by 2
    standard deviations.

    residual : of the identified model
    """
    error = source.motion_error
    if error is None or (error.thickness is None and weighed(residual, error).shift_std < MIN_SHIFT_STD):
        return None
    setting.stage("fit of the identified model with its known error")
    with setting.clock.step("final_s"):
        found = _whole_fit(source, null, setting)
        return _with_its_std(source, found, refit_residual(source.load(), found)) if found.usable else None


def _with_its_std(source: ExperimentSource, found: Refit, residual: ResidualEvidence) -> Refit:
    """A fit to the recording whose standard deviations know that the error of plane stress follows the law."""
    factors = std_factors(identification_at(source.load(), found.values, found.local, found.steps), residual)
    return replace(found, stds={name: None if std is None else std * factors.get(name, 1.0)
                                for name, std in found.stds.items()})


def _neglected(here: Identification, before: ResidualEvidence, errors: Mapping[str, MotionError] | None,
               source: ExperimentSource, last: Refit | None, after: ResidualEvidence | None,
               clock: Clock) -> Neglected | None:
    """Of the last model.

    errors : of `here`, where they are known; last, after : fit of the last model to the recording, where it is another
    one, and its residual where a cause has joined it
    """
    with clock.step("mesh_s"):
        if last is None:
            return neglected(before, neglected_errors(here) if errors is None else errors)
        there = identification_at(source.load(), last.values, last.local, last.steps)
        return neglected(refit_residual(source.load(), last) if after is None else after, neglected_errors(there))


def _separating_test(groups: Sequence[Group], setting: Setting, notes: Notes) -> str | None:
    """The simulated test that separates the first indistinguishable group for which there is one."""
    for members in groups:
        setting.stage("simulation of tests that separate " + " and ".join(r.name for _, r in members))
        with setting.clock.step("next_s"):
            advice = notes.attempt("a simulated next test", next_experiment, members)
        if advice is not None:
            return advice
    return None


def _floor_chi2(floor_px: float, power_of_unit: float, judged: Round | None) -> float:
    """Chi-square of motions of a size, which no model explains, on the copies that judge; judged : the round, where one
    candidate was selected."""
    copies = 2 if judged is not None and judged.winner.crossed_judgement is not None else 1  # type: ignore[union-attr]
    return copies * floor_px**2 * power_of_unit / COPY_VARIANCE_FACTOR


@dataclass(frozen=True, eq=False)
class _Enriched:
    """The last model: its source, its fit to the recording, the residual (None without an equilibrium), the elements in
    which it acts, and a fit with another axis that the recording does not tell from it."""

    source: ExperimentSource
    final: Refit | None = None
    after: ResidualEvidence | None = None
    active: Activity | None = None
    other: Refit | None = None


def _enriched(source: ExperimentSource, null: Refit, left: ResidualEvidence, rounds: Sequence[Round],
              setting: Setting) -> _Enriched:
    """The last model fitted to the recording itself.

    The fit begins at the end of the fit to a copy, a few standard deviations away, with the estimator of that end. The
    known error of its simulation is that of the values on the copy; where those of the recording change it, or ask for
    bricks now that the cause is known, the fit is repeated with it, and the source has it. Bricks that are known
    already follow to the recording in turns first, and the fit begins where these end: it is repeated only where it
    ends elsewhere. A quick diagnosis ends with the fit to the copy.

    left : residual on the recording, mostly of that end
    """
    setting.stage("residual of the enriched model" if setting.quick
                  else "fit of the enriched model to the whole recording")
    with setting.clock.step("final_s"):
        turned = None if setting.quick else _turned(source, null, left, setting)
        if turned is not None:
            source, final, of = turned
        else:
            final, of = null if setting.quick else _whole_fit(source, null, setting), None
        if not final.usable:
            return _Enriched(source, final)
        after, active = residual_from_rest(source.load(), final), None
        if after is None:
            return _Enriched(source, final)
        for turn in range(0 if setting.quick else MAX_RENEWALS):
            if of is not None and is_at(final.values, of, final.stds):
                break
            there = identification_at(source.load(), final.values, final.local, final.steps)
            bricks = with_bricks(there, after, setting.grid) if turn == 0 else None
            new = bricks or renewed_error(there, after, setting.grid)
            if new is None:
                break
            renewed = source.with_motion_error(new[0])
            of = None if bricks else new[1]  # the error of the mesh is the old one
            again = _whole_fit(renewed, final, setting, new[1])
            left = residual_from_rest(renewed.load(), again) if again.usable else None
            if left is None:
                break
            source, final, after = renewed, again, left
        other = None if setting.quick else fit_from_other_axes(source, final, rounds, setting.refits, setting.grid,
                                                               setting.seed)
        if other is not None and is_better(other, final):
            left = residual_from_rest(source.load(), other)
            other, final, after = (None, final, after) if left is None else (final, other, left)
        final = final if setting.quick else _with_its_std(source, final, after)
        first = next(iter(causes_of(rounds)), rounds[0])
        if first.winner.ranked.candidate.kind.active:  # type: ignore[union-attr]
            with suppress(NotConverged):  # with these increments: the residual chose its own
                active = activity(identification_at(source.load(), final.values, final.local, final.steps))
    same = other is None or not is_another_answer(other, final)
    return _Enriched(source, final, after, active, None if same else other)


def _turned(source: ExperimentSource, null: Refit, left: ResidualEvidence, setting: Setting,
            ) -> tuple[ExperimentSource, Refit, Identification] | None:
    """The source with the error of plane stress that follows from a copy to the recording, the fit to the recording
    beside it, and the model at the values that the error is of; None where bricks are not known, or this fails.

    null : fit to the copy, which has ended at a minimum: the turns take whole steps; left : see `_enriched`
    """
    known = source.motion_error
    if known is None or known.thickness is None or null.status not in MINIMA:
        return None
    residual = left if is_residual_of(left, null, known) else residual_from_rest(source.load(), null)
    if residual is None:
        return None
    there = identification_at(source.load(), null.values, null.local, null.steps)
    begun = sheet_and_bricks_at(there)
    new = None if begun is None else renewed_error(there, residual, setting.grid, begun)
    if begun is None or new is None:
        return None
    renewed = source.with_motion_error(new[0])
    final = _whole_fit(renewed, null, setting, new[1])
    return (renewed, final, new[1]) if final.usable else None


def _whole_fit(source: ExperimentSource, near: Refit, setting: Setting, at: Identification | None = None) -> Refit:
    """The model of a source fitted to the recording itself, from the end of another fit, or from where turns ended.

    at : that end
    """
    moved = None if at is None else {name: at.parameters[name].value - value for name, value in near.values.items()}
    (found,) = setting.refits([refit_of_one(source, "enriched", near, setting.grid, setting.seed, moved, copies=False,
                                            estimator=near.estimator, whole_std=True)])
    return found


def unlimited_excess(copy: ExcessLeft, source: ExperimentSource, null: Refit, refits: Refits, grid: Grid,
                     seed: int) -> ExcessLeft:
    """Excess on the copy for judging after the fit to the other copy has converged, without a limit of evaluations."""
    (fitted,) = refits([refit_of_one(source, "ended", null, grid, seed, unlimited=True)])
    return replace(copy, after=fitted.judgement) if fitted.usable else copy


def located(found: Identification, residual: ResidualEvidence, margin: Margin = ASSUMED) -> Mismatch | None:
    """Side, onset and place; None where a law finds no equilibrium along the path. Readings that differ by less than
    two meshes of one law do are no mismatch."""
    try:
        mismatch = locate(found, residual, margin=margin)
    except NotConverged:
        return None
    if mismatch.side != "force" or any(
            one.was_beyond_discretisation for one in channels_left(residual, None)):
        return mismatch
    reason = f"readings differ by less than {100.0 * MIN_READING_SHARE:g} % of the largest one, as two meshes may"
    return replace(mismatch, side="", nested_tests=replace(mismatch.nested_tests, side="", reason=reason))
