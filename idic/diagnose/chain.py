"""The diagnosis of one identification.

    1  the identified model: its residual, its known error; side, onset and place of the mismatch
    2  its fit to one of two thinned copies of the recording, which every candidate is compared with
    3  the selection: one loop over a table of moves (`idic.diagnose.selection.moves.table`)
    4  the last model fitted to the recording itself; its residual; verdict; the next test

Every refit is a job (`RefitJob`) for the callable that the caller supplies.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from idic.diagnose.cut_mesh import as_cut
from idic.diagnose.diagnosis import Diagnosis
from idic.diagnose.discretisation.neglected import Neglected, neglected
from idic.diagnose.discretisation.thickness_error import neglected_errors
from idic.diagnose.discretisation.weight import MIN_SHIFT_STD, weighed
from idic.diagnose.free_form import FreeForm, free_form, has_other_sides, is_offered
from idic.diagnose.identified import Identified, as_identified
from idic.diagnose.locate.active_elements import Activity, activity
from idic.diagnose.next_test import next_experiment, unloads
from idic.diagnose.physics.candidate import Candidate
from idic.diagnose.physics.edits import open_share
from idic.diagnose.probability import probability
from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.refits.refit import refit_residual
from idic.diagnose.refits.refit_job import ExperimentSource, RefitJob, Refits
from idic.diagnose.remainder import Remainder, remainder_of
from idic.diagnose.residual.margin import ASSUMED, Margin
from idic.diagnose.residual.residual_evidence import path_of
from idic.diagnose.screen.library import candidate_library
from idic.diagnose.screen.select import Ranked
from idic.diagnose.selection.moves.screening import screened
from idic.diagnose.selection.moves.table import selected
from idic.diagnose.selection.moves.whole_fit import fitted_to_recording, whole_fit, with_std_of_bricks
from idic.diagnose.selection.rival import Round, causes_of
from idic.diagnose.selection.rivals import edits_of
from idic.diagnose.selection.stages import NULL_FIT
from idic.diagnose.selection.state import Clock, Setting, Stage, State, Watch, silent, unwatched
from idic.diagnose.selection.verdict import Verdict, conclude, is_of_readings
from idic.errors import NotConverged
from idic.identification import Identification
from idic.parameters import Parameter

SEED = 20260
DRAW_FIRST = ("draw the outline of the specimen (outline_mm in mesh) and diagnose again; the outline of the points "
              "may explain the whole finding")
DRAW_ANYWAY = ("draw the outline of the specimen (outline_mm in mesh): that of the points may be off by {:.2g} % of "
               "its narrowest width, and moduli that the force determines with it")


def diagnose(source: ExperimentSource, identification: Identification, refits: Refits, stage: Stage = silent,
             seed: int = SEED,
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
    candidates = candidate_library() if library is None else library
    identified = as_identified(source, identification, margin, quick, stage, clock)
    if any(candidate.cuts_mesh for candidate in candidates):
        cut = as_cut(identified, margin, quick, stage, clock)
        identified, identification = cut, identification if cut is identified else cut.identification
    setting = Setting(refits, partial(screened, margin=margin), identified.grid, seed, candidates, stage, clock, watch,
                      margin, quick)
    state = fitted_to_recording(selected(compared_with(identified, setting)))
    active = _active(state)
    remainder = remainder_of(state, identified.misfit)
    verdict = _verdict(identification, state, remainder)
    notes = setting.notes
    corrected = notes.attempt("the fit with the known error", _corrected, state)
    neglect = notes.attempt("what the model neglects", _neglected, identified, state, corrected)
    advice = _separating_test(identification, state, verdict)
    curve = notes.attempt("a free law", _free_law, identification, state, verdict)
    verdict = _with_next_test(verdict, state, advice, curve)
    chance = probability(verdict, state.rounds, remainder.excesses[0], remainder.channels)
    return Diagnosis(identification, identified, state, remainder, verdict, chance, active, corrected, neglect, curve,
                     tuple(notes.texts))


def compared_with(identified: Identified, setting: Setting) -> State:
    """The state before the selection: the identified model fitted to the copy for choosing."""
    setting.stage(f"{NULL_FIT} to one of two copies of the recording")
    source, identification = identified.source, identified.identification
    with setting.clock.step("null_s"):
        (null,) = setting.refits([RefitJob("null", source, ("null",), ({},), (identification.parameters.as_values(),),
                                           identification.local, setting.grid, np.inf, setting.seed,
                                           begun=path_of(identified.residual, identification.steps))])
    if not null.usable:
        raise NotConverged("the identified model finds no equilibrium when it is fitted again to a copy of the "
                           "recording; no candidate can be compared with it. Identify with smaller increments, or from "
                           f"the values of result.json, and diagnose again ({null.problem})")
    first = FittedModel(source, null, identified.residual)
    return State(setting, identification, first, first, identified.mismatch,
                 small_errors=identified.neglected or {})


def _active(state: State) -> Activity | None:
    """Elements in which the first cause acts, where it is a law of yielding, flow or damage."""
    if state.final is None or state.final.residual is None:
        return None
    first = next(iter(causes_of(state.rounds)), state.rounds[0])
    if first.winner is not None and first.winner.ranked.candidate.kind.active:
        with suppress(NotConverged), state.setting.clock.step("final_s"):  # the residual chose its own increments
            return activity(state.final.identification())
    return None


def _verdict(identification: Identification, state: State, remainder: Remainder) -> Verdict:
    """By both copies of the recording where they judged the only cause, otherwise by the one without a part in the
    fits."""
    first, margin = state.rounds[0], state.setting.margin
    is_alone = first.winner is not None and state.model.fit is first.winner.refitted
    heldout = (first.heldout_fits(first.winner) if is_alone
               else (state.first.fit.judgement, state.model.fit.judgement))
    floor = 0.0 if margin.floor is None else margin.floor.px
    floor_px = margin.px if is_of_readings(remainder.excesses[0], remainder.channels) else floor
    copies = 2 if is_alone and first.winner.crossed_judgement is not None else 1
    source = (state.final or state.model).source
    is_located = state.mismatch is not None and state.mismatch.is_significant
    return conclude(state.rounds, *heldout, is_located, remainder.excesses,
                    unloads(identification.experiment.model), copies * floor_px**2 * state.power_of_copy,
                    remainder.channels,
                    lambda ranked: _freedom(source, ranked))


def _freedom(source: ExperimentSource, ranked: Ranked) -> Parameter | None:
    """The degree of freedom that the amplitude of a direct candidate is the value of."""
    return source.load(ranked.variant.edits).model.parameters.get(ranked.label) if ranked.variant.direct else None


def _corrected(state: State) -> FittedModel | None:
    """The identified model with its known error, fitted to the recording; None where a cause joined it, where no error
    is counted, or where that of the mesh alone moves no parameter by half a standard deviation.

    A mesh that is coarse for its body and leaves no residual has moved the parameters: C10 of a strip of rubber by 2
    standard deviations.
    """
    setting, model = state.setting, state.first
    if setting.quick or state.final is not None or model.error is None or (
            model.error.thickness is None
            and weighed(model.residual, model.error).shift_std < MIN_SHIFT_STD):
        return None
    setting.stage(f"{NULL_FIT} with its known error")
    with setting.clock.step("final_s"):
        fit = whole_fit(setting, model)
        if not fit.usable:
            return None
        return with_std_of_bricks(FittedModel(model.source, fit, refit_residual(model.source.load(), fit)))


def _neglected(identified: Identified, state: State, corrected: FittedModel | None) -> Neglected | None:
    """Of the last model: that with its causes, or the identified one, with bricks where the recording shows them."""
    model, final = state.model, state.final
    if state.setting.quick or (final is not None and final.residual is None):
        return None
    with state.setting.clock.step("mesh_s"):
        of_bricks = corrected if model.error is not None and model.error.thickness is not None else None
        final = final or of_bricks
        if final is not None:
            errors = neglected_errors(final.identification()) if final.neglected is None else final.neglected
            return neglected(final.residual, errors)
        errors = identified.neglected
        return neglected(identified.residual, neglected_errors(identified.identification) if errors is None else errors)


def _separating_test(identification: Identification, state: State, verdict: Verdict) -> str | None:
    """The outline where it is open; else the simulated test that separates the first indistinguishable group for which
    there is one."""
    share = open_share(identification.experiment.model)
    if share is not None and verdict.word != "blind":
        return DRAW_ANYWAY.format(100.0 * share) if verdict.word == "none" else DRAW_FIRST
    setting = state.setting
    for entry in state.rounds:
        if entry.winner is None or not entry.equals:
            continue
        members = _group(entry)
        setting.stage("simulation of tests that separate " + " and ".join(member.fit.name for member in members))
        with setting.clock.step("next_s"):
            advice = setting.notes.attempt("a simulated next test", next_experiment, members)
        if advice is not None:
            return advice
    return None


def _group(entry: Round) -> list[FittedModel]:
    """The winner of a round and the models that are indistinguishable from it, by their names."""
    return [FittedModel(entry.source.with_edits(edits_of(rival, entry.screening)),
                        replace(rival.refitted, name=rival.name))
            for rival in entry.rivals if rival is entry.winner or rival.name in entry.equals]


def _free_law(identification: Identification, state: State, verdict: Verdict) -> FreeForm | None:
    """The free law that explains most in the place of a material's law, where no named cause fits: of the identified
    model, and of the last one where it holds causes that are not of the specimen."""
    setting, final = state.setting, state.final
    if setting.quick or state.end is not None or not is_offered(verdict, state.mismatch, state.rounds,
                                                                identification.experiment.model):
        return None
    models = [state.first]
    if final is not None and final.residual is not None and has_other_sides(state.rounds):
        models.append(replace(final, fit=state.model.fit))
    with setting.clock.step("free_form_s"):
        return free_form(state, models)


def _with_next_test(verdict: Verdict, state: State, advice: str | None, curve: FreeForm | None) -> Verdict:
    """With the test that says more than the library's general one, where there is such a test."""
    if state.end is not None:
        advice = state.end.next_test
    if curve is not None and curve.describes and advice is None:
        advice = curve.next_test
    return verdict if advice is None else replace(verdict, next_experiment=advice)
