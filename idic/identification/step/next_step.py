"""The next trial from an accepted point: a step, another stage, another estimator, or the end of the loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from idic.identification.step.acceptance import scaled_at
from idic.identification.step.activation import MAX_REJECTED_ACTIVATIONS, activation_step, active_parameters
from idic.identification.step.ending import (ITERATIONS, beyond_bounds, bounded, failed_simulation, flat, judged_flat,
                                       out_of_iterations, settled, small_step, stuck)
from idic.identification.step.estimator import next_estimator
from idic.identification.step.increments import (KNOWN, TOO_COARSE, chooses_increments, error_of, has_rough_steps,
                                           is_judged_next, is_too_coarse, is_whole, knows_end, meets_a_jump,
                                           with_increments_judged)
from idic.identification.step.non_smooth import directional_derivative
from idic.identification.step.parallel_steps import parallel_steps
from idic.identification.step.parameter_covariance import Scaled, Spectrum
from idic.identification.step.proposal import STEP_CLIP, Step, propose
from idic.identification.step.schedule import (
    MIN_CONTINUED_STAGE_GAIN,
    MIN_PRELIMINARY_GAIN,
    MIN_PRELIMINARY_STEP,
    is_continued,
    is_preliminary,
    same_images,
    strong_directions,
)
from idic.identification.step.settled import SETTLED_SHARE, negligible
from idic.identification.step.stages import stage_parameters
from idic.identification.step.state import (
    ENOUGH,
    GENERALISED,
    GENERALISED_REJECTED,
    Activation,
    Ending,
    EstimatorChoice,
    Evaluation,
    LoopState,
    ParallelTrial,
    SchedulePosition,
    Trial,
    TrustRegion,
)
from idic.model import Experiment, Model, Options, Stage
from idic.parameters import ParameterSet

MAX_REJECTIONS = 8  # in a row; steps have then shrunk to nothing
# standard deviations: of convergence after rejections, since phi is non-smooth where points yield
NON_SMOOTH_TOLERANCE = 0.1
ROUGH_TOLERANCE = 0.35  # the same of a search that goes on with other increments, with steps that are rough themselves
MIN_DAMPED_STEP_SHARE = 0.1  # of the tolerance: shorter damped steps lead nowhere (the model cannot explain the images)
MIN_EVALUATIONS_OF_AN_ESTIMATOR = 2  # for a change of estimator to converge
MIN_SCALED_STEP = 1e-7  # shorter steps are rounding, however small the standard deviation


def next_step(state: LoopState, experiment: Experiment, stages: Sequence[Stage], point: Evaluation, image_noise: float,
              non_smooth: Scaled | None = None, to_the_end: bool = False, jump: bool = False) -> LoopState:
    """The state with the next trial from the accepted point; a small step ends the stage or the loop.

    non_smooth : the system of the point with the directional derivative, where it is not smooth
    jump : whether increments that were halved may be why the last trials were rejected
    to_the_end : whether the step is made where the end of the search is known (`idic.identification.step.increments`)
    """
    options, stage = experiment.options, stages[state.schedule.stage]
    parameters = stage_parameters(experiment.model.parameters.with_values(state.accepted.values), stage)
    scaled = scaled_at(point, parameters, stage, image_noise) if non_smooth is None else non_smooth
    directions = scaled.spectrum()
    stds = np.sqrt(np.maximum(np.diagonal(scaled.covariance(directions)), 0.0))
    limit = (options.step_limit or STEP_CLIP) * state.trust.radius
    allowed = strong_directions(scaled, directions) if options.schedule == "spectrum" else None

    def version(damping: float, size: float) -> Step:
        return propose(scaled, directions, stds, parameters, damping, size, allowed)

    step = version(state.trust.damping, limit)
    beside_misfit = negligible(point.system, options.lowpass_px)
    is_last = state.schedule.stage + 1 == len(stages)
    goes_on = is_last and is_judged_next(state, experiment) and has_rough_steps(experiment)
    flat_at = ROUGH_TOLERANCE if goes_on else NON_SMOOTH_TOLERANCE
    reason = _why_done(state, stages, step, scaled, directions, options, non_smooth is not None, beside_misfit, flat_at)
    # increments that are to be judged have a rule of their own
    end_is_known = is_last and non_smooth is None and not chooses_increments(experiment) and is_whole(step, state)
    generalised = _generalised_from(state, experiment, stage, point, image_noise, step,
                                    _end_of(step, parameters)) if end_is_known and not reason else None
    ends = is_last and (bool(reason) or generalised is not None)
    state, change = _with_activation(state, scaled, parameters, ends)
    ended = reason and change is None
    if ended or (stage.max_iterations is not None and state.schedule.iterations >= stage.max_iterations):
        beyond = beyond_bounds(step, parameters) if reason else ()
        end = (bounded(beyond) if beyond else Ending("converged", reason) if reason
               else out_of_iterations(state.schedule.iterations, "[stage]", step, options))
        return _leave_stage(state, experiment, stages, point, image_noise, end)
    if generalised is not None and change is None:
        return generalised
    if is_last and is_too_coarse(state, experiment, jump):
        return _leave_stage(state, experiment, stages, point, image_noise, Ending(TOO_COARSE, ""))
    if change is None and non_smooth is None and not to_the_end and is_last and knows_end(step, state, experiment):
        end = _end_of(step, parameters)
        judged = with_increments_judged(state, experiment, stage, point, image_noise, KNOWN, end)
        if judged.trial.new_increments:
            return replace(judged, end=Ending(KNOWN, ""))
        return (_generalised_from(judged, experiment, stage, point, image_noise, step, end)
                or next_step(judged, experiment, stages, point, image_noise, to_the_end=True))
    tried = state.trust.damping > 0.0 or state.trust.rejections > 0
    if state.trust.rejections >= MAX_REJECTIONS or (
            change is None and tried and step.significance < MIN_DAMPED_STEP_SHARE * options.tolerance):
        return _leave_stage(state, experiment, stages, point, image_noise, stuck(step, state.trust.rejections))
    if state.rounds >= options.max_iterations - _can_return(state, experiment.options):
        end = out_of_iterations(options.max_iterations, "options", step, options)
        if _can_return(state, experiment.options):
            return _leave_stage(state, experiment, stages, point, image_noise, end)
        return replace(state, status=end.status, end=end)
    shorter_steps = [] if state.generalised else parallel_steps(
        version, step, state.trust.damping, limit, options.trial_steps - 1, state.trust.rejections > 0)

    def reached(by: Step) -> dict[str, float]:
        return parameters.unpack(parameters.pack() + by.delta + (0.0 if change is None else change)).as_values()

    parallel = tuple(ParallelTrial(reached(candidate), damping, halvings)
                     for halvings, damping, candidate in shorter_steps)
    return replace(state, trial=Trial(reached(step), parallel, tries_activation=change is not None))


def _end_of(step: Step, parameters: ParameterSet) -> dict[str, float]:
    """All values after a step."""
    return parameters.unpack(parameters.pack() + step.delta).as_values()


def _generalised_from(state: LoopState, experiment: Experiment, stage: Stage, point: Evaluation, image_noise: float,
                      step: Step, end_values: Mapping[str, float]) -> LoopState | None:
    """The state that tries generalised least squares at the known end of an ordinary search whose increments are
    enough, or given; None where that end is not known to the tolerance, or ordinary least squares stay.

    step : to that end; end_values : its values
    """
    current = state.estimator.kind
    increments_suffice = state.increments.status == ENOUGH or not chooses_increments(experiment)
    if not increments_suffice or error_of(step) >= experiment.options.tolerance:
        return None
    rounds_left = experiment.options.max_iterations - state.rounds
    kind = next_estimator(current, "converged", experiment, stage.free, point, image_noise)
    if kind != GENERALISED or kind == current or rounds_left <= MIN_EVALUATIONS_OF_AN_ESTIMATOR:
        return None
    return replace(_with_estimator(state, kind, end_values, end_values), end=Ending(KNOWN, ""),
                   increments=replace(state.increments, coarser=None))


def _with_estimator(state: LoopState, kind: str, solution: Mapping[str, float] | None,
                    values: Mapping[str, float]) -> LoopState:
    """The state that evaluates these values with another estimator; solution : of ordinary least squares."""
    return replace(state, estimator=EstimatorChoice(kind, None if solution is None else dict(solution)),
                   trust=TrustRegion(), schedule=SchedulePosition(state.schedule.stage),
                   trial=Trial(dict(values), re_evaluation=True))


def after_rejection(state: LoopState, experiment: Experiment, stages: Sequence[Stage], trial: Evaluation,
                    accepted: Evaluation | None, image_noise: float) -> LoopState:
    """The next trial after a rejected one: a shorter step, or one from a non-smooth point between the two."""
    if accepted is None or accepted.system is None:
        return failed_simulation(state, trial.message)
    non_smooth = _non_smooth_system(state, trial, accepted, experiment.model, stages[state.schedule.stage], image_noise)
    if non_smooth is not None:  # the step length changes with the derivative
        state = replace(state, trust=TrustRegion(rejections=state.trust.rejections))
    jump = meets_a_jump(state, experiment.model, trial, accepted)
    return next_step(state, experiment, stages, accepted, image_noise, non_smooth, jump=jump)


def _non_smooth_system(state: LoopState, trial: Evaluation, accepted: Evaluation, model: Model, stage: Stage,
             image_noise: float) -> Scaled | None:
    """The system of the accepted point with the directional derivative, where the rejected trial shows a non-smooth
    point."""
    if trial.system is None or trial.system.generalised != accepted.system.generalised:
        return None
    origin = model.parameters.with_values(state.accepted.values)
    parameters, moved = (stage_parameters(at, stage) for at in (origin, origin.with_values(state.trial.values)))
    scaled = scaled_at(accepted, parameters, stage, image_noise)
    trial_scaled = scaled_at(trial, moved, stage, image_noise)
    return directional_derivative(scaled, trial_scaled, scaled.spectrum(), parameters, moved, NON_SMOOTH_TOLERANCE)


def _why_done(state: LoopState, stages: Sequence[Stage], step: Step, scaled: Scaled, directions: Spectrum,
              options: Options, non_smooth: bool, beside_misfit: float, flat_at: float) -> str:
    """Why the stage ends at the accepted point, judged by the undamped step; empty where it goes on.

    beside_misfit : gain that does not matter; flat_at : step (std) below which rejected trials end it
    """
    number, phi, rejections = state.schedule.stage, state.accepted.phi, state.trust.rejections
    if step.relative < options.tolerance:
        return small_step(step, options.tolerance)
    if not step.clipped and step.gain < beside_misfit:
        return settled(step, SETTLED_SHARE)
    gain = float(scaled.b @ directions.inverse @ scaled.b) / phi if phi else 0.0
    if is_preliminary(stages[number]) and (step.largest < MIN_PRELIMINARY_STEP or gain < MIN_PRELIMINARY_GAIN):
        return "a preliminary stage has settled"
    if is_continued(stages, number) and gain < MIN_CONTINUED_STAGE_GAIN:
        return f"the next step would lower the objective by less than {MIN_CONTINUED_STAGE_GAIN:g} of itself"
    if (rejections > 1 and step.relative < flat_at) or (non_smooth and step.relative < NON_SMOOTH_TOLERANCE):
        return flat(step, rejections)
    estimator = state.estimator
    foretold = state.end is not None and state.end.status == KNOWN  # that solution: the search goes on to it
    if (estimator.kind == GENERALISED_REJECTED and estimator.ordinary_solution is not None
            and state.accepted.values == estimator.ordinary_solution
            and not (foretold and state.rounds < options.max_iterations)):
        return "generalised least squares did not converge: the values are those of ordinary least squares"
    return "the next step is below rounding" if step.largest < MIN_SCALED_STEP else ""


def _with_activation(state: LoopState, scaled: Scaled, parameters: ParameterSet,
                     ends: bool) -> tuple[LoopState, np.ndarray | None]:
    """The state with the parameters that are active here, and the activation step, None where there is none.

    ends : the search ends here if no parameter is to be activated
    """
    active, activation, radius = active_parameters(scaled, parameters), state.activation, state.trust.radius
    activation = replace(activation, active=tuple(dict.fromkeys((*activation.active, *active))))
    change = activation_step(scaled, parameters, activation.active, radius)
    tries = activation.rejections < MAX_REJECTED_ACTIVATIONS and bool(change.any())
    lost = tuple(name for name in activation.active if name not in active and name not in activation.reactivated)
    if ends and not tries and lost and not state.generalised:
        activation = Activation(active, (*activation.reactivated, *lost))
        change = activation_step(scaled, parameters, activation.active, radius)
        tries = bool(change.any())  # not where it is at its bound
    return replace(state, activation=activation), change if tries else None


def _can_return(state: LoopState, options: Options) -> bool:
    """Whether one evaluation leads back from generalised least squares to the ordinary-least-squares solution."""
    return (state.generalised and state.estimator.ordinary_solution is not None
            and options.estimator != GENERALISED)


def _leave_stage(state: LoopState, experiment: Experiment, stages: Sequence[Stage], point: Evaluation,
                 image_noise: float, end: Ending) -> LoopState:
    """On to the next stage, which may move where this one cannot; the last one ends the loop."""
    number = state.schedule.stage
    if number + 1 == len(stages):
        return leave_schedule(state, experiment, stages[-1], point, image_noise, end)
    new_images, limit = not same_images(stages[number], stages[number + 1]), experiment.options.max_iterations
    if new_images and state.rounds >= limit:
        end = Ending("max_iterations", f"{limit} evaluations are the limit (max_iterations in [options]): none is left "
                     "for the images of the next stage", ITERATIONS)
        return replace(state, status=end.status, end=end)
    state = replace(state, schedule=SchedulePosition(number + 1), trust=TrustRegion())
    if new_images:
        return replace(state, trial=Trial(dict(state.accepted.values), re_evaluation=True))
    return next_step(state, experiment, stages, point, image_noise)


def leave_schedule(state: LoopState, experiment: Experiment, stage: Stage, point: Evaluation, image_noise: float,
                   end: Ending) -> LoopState:
    """On with finer increments, with another estimator at the same or the ordinary-least-squares solution, or the
    end."""
    options, estimator = experiment.options, state.estimator
    status = end.status
    state = with_increments_judged(state, experiment, stage, point, image_noise, status)
    if state.trial.new_increments:
        return replace(state, end=end)  # of the search so far; the last one counts
    kind = next_estimator(estimator.kind, status, experiment, stage.free, point, image_noise)
    rounds_left = options.max_iterations - state.rounds
    if kind == estimator.kind or rounds_left < 1:
        end = judged_flat(state, end)
        return replace(state, status=end.status, end=end)
    # a converged end stands unless it was not asked for
    if kind == GENERALISED and rounds_left < MIN_EVALUATIONS_OF_AN_ESTIMATOR:
        if options.estimator == GENERALISED:
            end = Ending("max_iterations",
                         f"{options.max_iterations} evaluations are the limit (max_iterations in [options]): "
                         "none is left for generalised least squares", ITERATIONS)
        return replace(state, status=end.status, end=end)
    solution = estimator.ordinary_solution if kind == GENERALISED_REJECTED else dict(state.accepted.values)
    returns = kind == GENERALISED_REJECTED and solution is not None
    return _with_estimator(state, kind, solution, solution if returns else state.accepted.values)
