"""Screening: every candidate is scored against the present model on the whole recording, and a round begins."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import Any

from idic.correlation import FrameResponse
from idic.diagnose.discretisation.combinations import FINITE_STRAINS
from idic.diagnose.discretisation.weight import error_column, error_columns
from idic.diagnose.physics.candidate import Candidate, Situation, Variant
from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.refits.refit import Fit
from idic.diagnose.refits.refit_job import AnnouncedRefits
from idic.diagnose.residual.channel_left import channels_left, smallest_reading
from idic.diagnose.residual.excess import power
from idic.diagnose.residual.margin import ASSUMED, Margin
from idic.diagnose.residual.residual_evidence import ResidualEvidence, residual_evidence
from idic.diagnose.residual.subpixel_columns import RELATIVE_STD, subpixel_columns
from idic.diagnose.residual.thinning import COPY_VARIANCE_FACTOR
from idic.diagnose.screen.free_courses import with_free_courses
from idic.diagnose.screen.misregistration import reason_to_wait
from idic.diagnose.screen.score_columns import Load, score_columns
from idic.diagnose.screen.practical import MIN_CHANNEL_EFFECT_STD, PracticalSize
from idic.diagnose.screen.select import Screening, screen_candidates
from idic.diagnose.screen.situation import situation
from idic.diagnose.selection import stages
from idic.diagnose.selection.move import Move, itself
from idic.diagnose.selection.rival import Round
from idic.diagnose.selection.state import State, Watch, unwatched
from idic.model import Experiment, MotionError

NOTHING: Mapping[str, MotionError] = MappingProxyType({})
CAMERA = "camera"  # the family that is left out where another system has measured the fields


def opened(state: State) -> State:
    """A round begins with the scores of the library against the present model."""
    setting, model = state.setting, state.model
    responses = model.residual.responses if model.is_simulated_there else None
    screening = screened(model, setting.library, setting.watch, setting.margin, responses, state.small_errors,
                         shows_mismatch(state), not state.rounds and is_beyond_small(state))
    if not screening.shortlist:
        setting.stage("no candidate is significant: no refit")
    announced = AnnouncedRefits(setting.refits, setting.stage, 1 if setting.quick else len(screening.shortlist))
    return replace(state, number=state.number + 1, joined=None, announced=announced,
                   round=Round(screening, model.fit, (), None, source=model.source))


def shows_mismatch(state: State) -> bool:
    """Whether free motions show a mismatch beyond noise and the practical margin, or channels one beyond noise."""
    return (state.mismatch is None or state.mismatch.is_significant
            or any(channel.is_significant for channel in channels_left(state.first.residual, None)))


def is_beyond_small(state: State) -> bool:
    """Whether the identified model leaves what the verdict calls unexplained: motion beyond the practical margin, or
    readings beyond what two meshes of one law differ by."""
    return ((state.mismatch is not None and state.mismatch.is_significant)
            or any(channel.matters for channel in channels_left(state.first.residual, None)))


def screened(model: FittedModel, library: Sequence[Candidate], watch: Watch = unwatched, margin: Margin = ASSUMED,
             responses: Sequence[FrameResponse] | None = None, small_errors: Mapping[str, MotionError] = NOTHING,
             is_located: bool = True, is_unexplained: bool = False) -> Screening:
    """Score every candidate against the null model on the whole recording: a score fits nothing, and one copy shows
    a faint effect by seven tenths of the standard deviations only. Refits see one copy, and promises are of that.

    responses : of the null, where it has been simulated; small_errors : of the simulation, that no model counts;
    is_located : whether free motions or channels show a mismatch; is_unexplained : whether the model leaves more than
    small errors do. Where no candidate is significant then, finite strains may have left it: they are no small error,
    but a candidate, with all that imitate them
    """
    source, null, identification, load = model.source, model.fit, model.identification(), each_once(model.source.load)
    residual = residual_evidence(identification, responses=responses)
    place = situation(identification, residual, source.document())
    trials, untestable = _trials(library, identification.experiment.recording.points is not None, place, residual, null)
    trials += with_free_courses(trials, place.document, identification.parameters.free, load)
    labels, columns = score_columns(identification, residual, trials, load) if trials else ((), residual.null.pick([]))
    watch(residual, labels, columns)
    error = source.motion_error
    blurs = subpixel_columns(residual) if any(variant.pixels is not None for _, variant in trials) else None
    screen = partial(
        screen_candidates, residual.evidence, residual.null, labels, columns,
        practical=practical_size(residual, margin, is_located),
        mesh=None if error is None else error_column(residual, error.of_mesh),
        known_columns=None if blurs is None else (blurs, RELATIVE_STD),
        materials=[material.element_set for material in identification.experiment.model.materials])
    scored = screen(errors=error_columns(residual, small_errors.values()))
    if is_unexplained and not scored.shortlist and FINITE_STRAINS in small_errors:
        errors = [error for name, error in small_errors.items() if name != FINITE_STRAINS]
        scored = screen(errors=error_columns(residual, errors))
    unresolved = [ranked for ranked in scored.significant if ranked.variant.unresolved]
    untestable += [(ranked.candidate, ranked.variant.unresolved) for ranked in unresolved]
    return replace(scored, ranked=tuple(ranked for ranked in scored.ranked if ranked not in unresolved),
                   untestable=tuple(untestable))


def each_once(load: Load) -> Load:
    """`load`, asked once for each set of edits: variants of a candidate share theirs."""
    experiments: dict[str, Experiment] = {}

    def experiment_of(edits: Mapping[str, Any]) -> Experiment:
        key = json.dumps(dict(edits), sort_keys=True, default=repr)
        if key not in experiments:
            experiments[key] = load(edits)
        return experiments[key]

    return experiment_of


def practical_size(residual: ResidualEvidence, margin: Margin, is_located: bool) -> PracticalSize:
    """The size below which no candidate is named in this recording: motion at the practical margin, readings that two
    meshes of one law may differ by."""
    return PracticalSize(margin.px, max(MIN_CHANNEL_EFFECT_STD, smallest_reading(residual)),
                         float(power(residual.evidence).sum()) / COPY_VARIANCE_FACTOR, is_located)


def _trials(library: Sequence[Candidate], is_measured: bool, place: Situation, residual: ResidualEvidence,
            null: Fit) -> tuple[list[tuple[Candidate, Variant]], list[tuple[Candidate, str]]]:
    """Variants to be scored, and the candidates that are not, each with its reason.

    is_measured : another system has measured the fields: no candidate is one of the camera
    """
    trials, untestable = [], []
    for candidate in library:
        if is_measured and candidate.family == CAMERA:
            continue
        reason = candidate.reason_against(place)
        variants = () if reason else candidate.variants(place)
        if reason := reason or reason_to_wait(variants, residual, null.choice):
            untestable.append((candidate, reason))
        else:
            trials += [(candidate, variant) for variant in variants]
    return trials, untestable


SCREENING = Move("screening", "screening_s", itself, opened, lambda state: state.is_open,
                 stage=lambda state: f"{stages.SCREENING}, round {state.number + 1}")
