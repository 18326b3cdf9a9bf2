"""The Gauss-Newton search as a state machine: state + evaluated points → next state. No memory between calls.

The driver (`idic.identification.driver`) evaluates the trials of a state and hands their systems to `advance`, until
``state.status`` is no longer "running". A rejected step and a failed simulation are normal events.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from idic.correlation import CorrelationSystem
from idic.identification.step.acceptance import functional, improves, scaled_at
from idic.identification.step.ending import failed_simulation
from idic.identification.step.estimator import check_estimator
from idic.identification.step.increments import has_rough_steps, with_comparison_judged, without_finer
from idic.identification.step.next_step import after_rejection, leave_schedule, next_step
from idic.identification.step.parallel_steps import damping_after
from idic.identification.step.schedule import begins_blurred, seen_in
from idic.identification.step.stages import resolve_stages, stage_parameters
from idic.identification.step.state import (
    COMPARED,
    ORDINARY,
    AcceptedPoint,
    EstimatorChoice,
    Evaluation,
    LoopState,
    SchedulePosition,
    Trial,
    TrustRegion,
)
from idic.identification.step.trust_radius import (
    MAX_DAMPED_RADIUS,
    predicted_decrease,
    radius_after_rejection,
    radius_after_step,
    step_length,
)
from idic.model import Experiment, Model, Stage
from idic.parameters import ParameterSet

MIN_DAMPING = 1e-5  # below, damping ends; it falls slowly, as the step just rejected without it would be rejected again
# of the gain of the ordinary step: with more than that a parallel one is judged in its place
MIN_EXTRA_GAIN_SHARE = 0.2


def start(experiment: Experiment, searched: bool = False, estimator: str = ORDINARY) -> LoopState:
    """The state before anything is evaluated; validates the schedule.

    Parameters
    ----------
    searched : whether a search from far has found the start: then a stage on blurred images comes first
    estimator : to begin with
    """
    resolve_stages(experiment)
    check_estimator(experiment)
    skipped = 1 if begins_blurred(experiment) and not searched else 0
    return LoopState(Trial(experiment.model.parameters.as_values()), schedule=SchedulePosition(skipped),
                     estimator=EstimatorChoice(estimator))


def advance(state: LoopState, experiment: Experiment, evaluated: Evaluation, accepted: Evaluation | None,
            image_noise: float, parallel: Sequence[Evaluation] = ()) -> LoopState:
    """Judge the evaluated trials and choose the next ones.

    Parameters
    ----------
    evaluated : of ``state.trial``
    accepted : the last accepted point, needed after a rejection
    image_noise : GV, after the low-pass
    parallel : of the trials ``state.trial.parallel``, in their order (none: they were not evaluated); the best of all
        is judged
    """
    stages = resolve_stages(experiment)
    stage, re_evaluation = stages[state.schedule.stage], state.trial.re_evaluation
    if state.increments.status == COMPARED:
        compared = with_comparison_judged(state, experiment, stage, evaluated, accepted, image_noise)
        entry = _history_entry(state, evaluated, False, True) | {"compared": True}
        judged = replace(compared, evaluations=state.evaluations + 1, history=(*state.history, entry))
        if compared.increments.per_frame is None and has_rough_steps(experiment):  # it may have ended early
            return next_step(judged, experiment, stages, accepted, image_noise)
        if compared.increments.per_frame is None:
            return leave_schedule(judged, experiment, stage, accepted, image_noise, state.end)
        if compared.increments.status == COMPARED:  # steps of two frames do not decide
            return judged
        state = compared
    points, tried, ordinary_damping = (evaluated, *parallel), state.trial_states, state.trust.damping
    halvings = max([0, *(trial.halvings for trial in state.trial.parallel)][:len(points)])
    best = _best(points, None if re_evaluation else accepted)
    evaluated, state = points[best], replace(tried[best], evaluations=state.evaluations)
    is_step = state.accepted is not None and not re_evaluation
    rejected = evaluated.system is None or (
        is_step and not improves(evaluated, accepted, experiment, stage, image_noise, state))
    entries = (_history_entry(trial_state, point, not rejected and point is evaluated,
                              not rejected and point is not evaluated)
               for trial_state, point in zip(tried, points, strict=False))
    length, gain_ratio = _length_and_gain(tried[0 if rejected else best], evaluated, accepted, experiment, stage,
                                          image_noise) if is_step else (1.0, None)
    new_increments = state.trial.new_increments
    failed_activation = rejected and state.trial.tries_activation
    state = replace(state, evaluations=state.evaluations + len(points),
                    parallel_evaluations=state.parallel_evaluations + len(parallel),
                    history=(*state.history, *entries), trial=Trial(state.trial.values),
                    activation=replace(state.activation, rejections=state.activation.rejections + failed_activation))
    if rejected and new_increments and accepted is not None:
        return next_step(without_finer(state), experiment, stages, accepted, image_noise)
    if rejected:
        state = replace(state, trust=_trust_after_rejection(state.trust, ordinary_damping, length, halvings))
        next_state = after_rejection(state, experiment, stages, evaluated, accepted, image_noise)
        if next_state.status == "stalled" and evaluated.system is None:
            next_state = failed_simulation(next_state, evaluated.message)  # the search ended there
        return next_state
    trust, schedule = state.trust, state.schedule
    # generalised least squares may begin at the known end of the ordinary search
    moved = is_step or (state.generalised and state.accepted is not None
                        and state.trial.values != state.accepted.values)
    state = replace(state, accepted=AcceptedPoint(dict(state.trial.values), evaluated.number, evaluated.system.phi),
                    iteration=state.iteration + moved,
                    schedule=replace(schedule, iterations=schedule.iterations + is_step),
                    trust=TrustRegion(radius_after_step(trust.radius, length, gain_ratio) if is_step else trust.radius,
                                      0.0 if trust.damping < MIN_DAMPING else trust.damping / 3.0))
    return next_step(state, experiment, stages, evaluated, image_noise)


def _trust_after_rejection(trust: TrustRegion, damping: float, length: float, halvings: int) -> TrustRegion:
    """After a rejected step of that damping and length, and of all its parallel versions."""
    radius = radius_after_rejection(trust.radius, length, halvings)
    return TrustRegion(radius, damping_after(damping, halvings + 1) if radius < MAX_DAMPED_RADIUS else damping,
                       trust.rejections + halvings + 1)


def _length_and_gain(tried: LoopState, trial: Evaluation, previous: Evaluation, experiment: Experiment, stage: Stage,
                     image_noise: float) -> tuple[float, float | None]:
    """Length of the step to `tried`, and its gain over the predicted one (`idic.identification.step.trust_radius`)."""
    accepted = experiment.model.parameters.with_values(tried.accepted.values)
    parameters, moved = (stage_parameters(at, stage) for at in (accepted, accepted.with_values(tried.trial.values)))
    scaled = scaled_at(previous, parameters, stage, image_noise)
    delta = np.array([moved[name].to_scaled() - parameters[name].to_scaled() for name in scaled.names])
    length = step_length(delta, scaled, parameters, experiment.options.step_limit)
    expected = predicted_decrease(delta, scaled)
    judged_by_slope = previous.system.generalised or scaled.weight is not None
    if trial.system is None or trial.system.generalised or judged_by_slope or expected <= 0.0:
        return length, None
    n_pixels = previous.system.n_pixels + previous.system.n_lost
    gained = functional(previous.system, n_pixels) - functional(trial.system, n_pixels)
    return length, gained / expected if gained > 0.0 else None


def _best(points: Sequence[Evaluation], previous: Evaluation | None) -> int:
    """The number of the point with the lowest functional; the first one where no other gains clearly more.

    A weakly determined direction hardly shows in the functional. A shorter step leaves it where it is; a functional
    that is lower by little is no progress then.
    """
    candidates = [k for k, point in enumerate(points) if point.system is not None]
    if len(candidates) < 2 or previous is None or previous.system is None:
        return candidates[0] if candidates else 0
    n_pixels = max(_all_pixels(points[k].system) for k in candidates)
    values = {k: functional(points[k].system, n_pixels) for k in candidates}
    lowest, initial = min(candidates, key=values.get), functional(previous.system, n_pixels)
    clearly = 0 not in candidates or values[0] - values[lowest] > MIN_EXTRA_GAIN_SHARE * max(initial - values[0], 0.0)
    return lowest if clearly else 0


def _all_pixels(system: CorrelationSystem) -> int:
    return system.n_pixels + system.n_lost


def _history_entry(state: LoopState, evaluated: Evaluation, accepted: bool, passed_over: bool) -> dict:
    system = evaluated.system
    rms = None if system is None else float(np.sqrt(sum(r.rr for r in system.frames) / max(system.n_pixels, 1)))
    return {
        "evaluation": evaluated.number, "stage": state.schedule.stage, "accepted": accepted,
        "passed_over": passed_over, "damping": state.trust.damping,
        "phi": None if system is None else system.phi, "phi_image": None if system is None else system.phi_image,
        "rms_gv": rms, "values": dict(state.trial.values), "message": evaluated.message,
    }


def experiment_of(experiment: Experiment, state: LoopState) -> Experiment:
    """The experiment as the stage of a state sees it."""
    return seen_in(experiment, resolve_stages(experiment)[state.schedule.stage])


def parameters_at(model: Model, state: LoopState) -> ParameterSet:
    """The accepted parameters (the start where no point was accepted)."""
    return model.parameters.with_values({} if state.accepted is None else state.accepted.values)
