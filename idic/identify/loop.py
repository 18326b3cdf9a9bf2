"""The identification as a state machine: state + evaluated system → next state. No memory between calls.

Whoever drives it (a Prefect flow, a notebook, a test) evaluates ``state.trial`` and hands the system back to
`advance`, until ``state.status`` is no longer "running". A rejected step and a failed simulation are normal events.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from idic.identify.covariance import Scaled, covariance, scaled_system, spectrum
from idic.identify.step.acceptance import functional, improves
from idic.identify.step.activation import MAX_REJECTED_ACTIVATIONS, active_parameters, activation_step
from idic.identify.step.estimator import check_estimator, next_estimator
from idic.identify.step.non_smooth import directional_derivative
from idic.identify.step.parallel_steps import MIN_EXTRA_GAIN_SHARE, ParallelTrial, damping_at, parallel_steps
from idic.identify.step.proposal import STEP_CLIP, Step, propose
from idic.identify.step.schedule import (
    MIN_CONTINUED_STAGE_GAIN,
    MIN_PRELIMINARY_GAIN,
    MIN_PRELIMINARY_STEP,
    is_continued,
    is_preliminary,
    begins_blurred,
    same_images,
    seen_in,
    strong_directions,
)
from idic.identify.step.stages import resolve_stages, stage_parameters
from idic.identify.step.state import GENERALISED, ORDINARY, GENERALISED_REJECTED, Evaluation, LoopState
from idic.identify.step.trust_radius import MAX_DAMPED_RADIUS, radius_after_rejection, radius_after_step, step_length, predicted_decrease
from idic.model.experiment import Experiment, Stage
from idic.parameters import ParameterSet

MAX_REJECTIONS = 8  # steps have then shrunk to nothing
MIN_DAMPING = 1e-5  # let go slowly: what was just rejected without damping would be rejected again
NON_SMOOTH_TOLERANCE = 0.1  # of a standard deviation, where nothing nearer is found: yielding points make kinks in phi
MIN_DAMPED_STEP_SHARE = 0.1  # of the tolerance: damped to less than this, steps go nowhere (a model that cannot explain the images)
MIN_EVALUATIONS_OF_AN_ESTIMATOR = 2  # evaluations at least, for another estimator to arrive
MIN_SCALED_STEP = 1e-7  # scaled: below this a step is rounding, however small the standard deviation


def start(experiment: Experiment, searched: bool = False, estimator: str = ORDINARY) -> LoopState:
    """The state before anything is evaluated; validates the schedule.

    searched : whether the start is what a search from far has found: then blurred images lead on; estimator : to begin with
    """
    resolve_stages(experiment)
    check_estimator(experiment)
    skipped = 1 if begins_blurred(experiment) and not searched else 0
    return LoopState(trial=experiment.parameters.as_values(), stage=skipped, estimator=estimator)


def trial_states(state: LoopState) -> tuple[LoopState, ...]:
    """All trials of a state, each as the state that tries it alone: the ordinary one first."""
    alone = replace(state, beside=())
    return (alone, *(replace(alone, trial=dict(other.values), damping=other.damping,
                             evaluations=state.evaluations + number)
                     for number, other in enumerate(state.beside, start=1)))


def advance(state: LoopState, experiment: Experiment, evaluated: Evaluation, accepted: Evaluation | None,
            image_noise: float, beside: Sequence[Evaluation] = ()) -> tuple[LoopState, Step | None]:
    """Judge the evaluated trial and propose the next one.

    Parameters
    ----------
    evaluated : Evaluation
        Of ``state.trial``.
    accepted : Evaluation or None
        Of the last accepted point (needed after a rejection).
    beside : of the trials ``state.beside``, in their order (none: they were not evaluated); the best of all is judged

    Returns
    -------
    next_state, step : the state with the next trial, and the step that leads to it (None where the loop has ended).
    """
    stages = resolve_stages(experiment)
    points, tried, rungs = (evaluated, *beside), trial_states(state), [0, *(other.rung for other in state.beside)]
    best, ordinary_damping = _best(points, None if state.fresh else accepted), state.damping
    evaluated, state = points[best], replace(tried[best], evaluations=state.evaluations)
    worse = evaluated.system is None or (state.accepted is not None and not state.fresh and not improves(
        evaluated, accepted, experiment, stages[state.stage], image_noise, state))
    entries = (_history_entry(one, point, not worse and point is evaluated, not worse and point is not evaluated)
               for one, point in zip(tried, points, strict=False))
    moved = state.accepted is not None and not state.fresh
    length, worth = _judge(tried[0 if worse else best], evaluated, accepted, experiment, stages[state.stage],
                           image_noise) if moved else (1.0, None)
    state = replace(state, evaluations=state.evaluations + len(points), extra=state.extra + len(beside),
                    history=(*state.history, *entries), fresh=False, sought=False,
                    refused=state.refused + (worse and state.sought))
    if worse:
        shortest = max(rungs[:len(points)])  # all of them were in vain
        reach = radius_after_rejection(state.reach, length, shortest)
        state = replace(state, rejected=state.rejected + shortest + 1, reach=reach,
                        damping=damping_at(ordinary_damping, shortest + 1) if reach < MAX_DAMPED_RADIUS else ordinary_damping)
        following, step = _after_rejection(state, experiment, stages, evaluated, accepted, image_noise)
        if following.status == "stalled" and evaluated.system is None:
            following = replace(following, status="forward_failed")  # the search ended at what cannot be simulated
        return following, step
    state = replace(state, accepted=dict(state.trial), accepted_evaluation=evaluated.number, phi=evaluated.system.phi,
                    iteration=state.iteration + moved, rejected=0,
                    stage_iterations=state.stage_iterations + moved,
                    reach=radius_after_step(state.reach, length, worth) if moved else state.reach,
                    damping=0.0 if state.damping < MIN_DAMPING else state.damping / 3.0)
    return _next_step(state, experiment, stages, evaluated, image_noise)


def _judge(tried: LoopState, trial: Evaluation, previous: Evaluation, experiment: Experiment, stage: Stage,
           image_noise: float) -> tuple[float, float | None]:
    """How long the step to `tried` was, and what it was worth of what had been promised (`idic.identify.step.trust_radius`)."""
    here = experiment.parameters.with_values(tried.accepted)
    parameters, there = (stage_parameters(at, stage) for at in (here, here.with_values(tried.trial)))
    scaled = scaled_system(previous.system.restrict(stage.free), parameters, _restrict(previous, stage.free),
                           image_noise)
    delta = np.array([there[name].to_scaled() - parameters[name].to_scaled() for name in scaled.names])
    length, expected = step_length(delta, scaled, parameters, experiment.options.step_limit), predicted_decrease(delta, scaled)
    if trial.system is None or trial.system.generalised or previous.system.generalised or expected <= 0.0:
        return length, None
    n_pixels = previous.system.n_pixels + previous.system.n_lost
    gained = functional(previous.system, n_pixels) - functional(trial.system, n_pixels)
    return length, gained / expected if gained > 0.0 else None


def _best(points: Sequence[Evaluation], previous: Evaluation | None) -> int:
    """The number of the point with the lowest functional, the first one where no other is clearly better.

    What is hardly determined hardly shows in the functional: a shorter step, which leaves it where it is, may be lower
    by a trifle and is no progress.
    """
    there = [k for k, point in enumerate(points) if point.system is not None]
    if len(there) < 2 or previous is None or previous.system is None:
        return there[0] if there else 0
    n_pixels = max(points[k].system.n_pixels + points[k].system.n_lost for k in there)
    values = {k: functional(points[k].system, n_pixels) for k in there}
    lowest, before = min(there, key=values.get), functional(previous.system, n_pixels)
    clearly = 0 not in there or values[0] - values[lowest] > MIN_EXTRA_GAIN_SHARE * max(before - values[0], 0.0)
    return lowest if clearly else 0


def _after_rejection(state, experiment, stages, trial: Evaluation, accepted: Evaluation | None, image_noise):
    if accepted is None or accepted.system is None:
        return replace(state, status="forward_failed"), None
    turned = _along_a_kink(state, trial, accepted, experiment, stages[state.stage], image_noise)
    if turned is not None:  # how far to go across says nothing of how far along
        state = replace(state, damping=0.0, reach=1.0)
    return _next_step(state, experiment, stages, accepted, image_noise, turned)


def _along_a_kink(state: LoopState, trial: Evaluation, accepted: Evaluation, experiment: Experiment, stage: Stage,
                  image_noise: float) -> Scaled | None:
    """The accepted point's system with the gradient along a kink that the trial has told of (`idic.identify.step.non_smooth`)."""
    if trial.system is None or trial.system.generalised != accepted.system.generalised:
        return None
    known = experiment.parameters.with_values(state.accepted)
    parameters, moved = (stage_parameters(at, stage) for at in (known, known.with_values(state.trial)))
    here, there = (scaled_system(point.system.restrict(stage.free), at, _restrict(point, stage.free), image_noise)
                   for point, at in ((accepted, parameters), (trial, moved)))
    return directional_derivative(here, there, spectrum(here), parameters, moved, NON_SMOOTH_TOLERANCE)


def _has_a_way_back(state: LoopState, experiment: Experiment) -> bool:
    """Whether generalised least squares may be given up for the ordinary ones that had arrived, in one evaluation."""
    return state.generalised and state.arrived is not None and experiment.options.estimator != GENERALISED


def _used_up(state, experiment, stages, point: Evaluation, image_noise: float):
    if _has_a_way_back(state, experiment):
        return _leave_stage(state, experiment, stages, point, image_noise, "max_iterations")
    return replace(state, status="max_iterations"), None


def _next_step(state, experiment, stages, point: Evaluation, image_noise, turned: Scaled | None = None):
    """The step from an accepted point; ends the stage or the loop where it has become small.

    turned : its system with the gradient along a kink, where it lies in one
    """
    options = experiment.options
    here = experiment.parameters.with_values(state.accepted)
    stage = stages[state.stage]
    parameters = stage_parameters(here, stage)
    scaled = scaled_system(point.system.restrict(stage.free), parameters,
                           _restrict(point, stage.free), image_noise) if turned is None else turned
    found = spectrum(scaled)
    stds = np.sqrt(np.maximum(np.diagonal(covariance(scaled, found)), 0.0))
    limit = (options.step_limit or STEP_CLIP) * state.reach
    allowed = strong_directions(scaled, found) if options.schedule == "spectrum" else None

    def version(damping: float, size: float) -> Step:
        return propose(scaled, found, stds, parameters, damping, size, allowed)

    step = version(state.damping, limit)
    felt_here = active_parameters(scaled, parameters)
    state = replace(state, felt=tuple(dict.fromkeys((*state.felt, *felt_here))))
    begins = activation_step(scaled, parameters, state.felt, state.reach)
    seeks = state.refused < MAX_REJECTED_ACTIVATIONS and bool(begins.any())
    # after rejections only the undamped step tells whether the point is a minimum
    gain = float(scaled.b @ found.inverse @ scaled.b) / state.phi if state.phi else 0.0
    led = (is_preliminary(stage) and (step.largest < MIN_PRELIMINARY_STEP or gain < MIN_PRELIMINARY_GAIN)) or (is_continued(stages, state.stage) and gain < MIN_CONTINUED_STAGE_GAIN)
    done = (step.relative < options.tolerance or step.largest < MIN_SCALED_STEP
            or ((state.rejected > 1 or turned is not None) and step.relative < NON_SMOOTH_TOLERANCE) or led
            or (state.estimator == GENERALISED_REJECTED and state.arrived is not None and state.accepted == state.arrived))
    lost = tuple(name for name in state.felt if name not in felt_here and name not in state.again)
    if done and not seeks and lost and stage is stages[-1] and not state.generalised:
        state = replace(state, felt=felt_here, again=(*state.again, *lost), refused=0)
        begins = activation_step(scaled, parameters, state.felt, state.reach)
        seeks = bool(begins.any())  # not where it is at its bound
    exhausted = stage.max_iterations is not None and state.stage_iterations >= stage.max_iterations
    if exhausted or (done and not seeks):
        status = "at_bound" if step.pinned else ("converged" if done else "max_iterations")
        return _leave_stage(state, experiment, stages, point, image_noise, status)
    if state.rejected >= MAX_REJECTIONS or (
            not seeks and (state.damping > 0.0 or state.rejected > 0)
            and step.significance < MIN_DAMPED_STEP_SHARE * options.tolerance):
        return _leave_stage(state, experiment, stages, point, image_noise, "stalled")
    if state.rounds >= options.max_iterations - _has_a_way_back(state, experiment):
        return _used_up(state, experiment, stages, point, image_noise)
    further = [] if state.generalised else parallel_steps(version, step, state.damping, limit, options.trial_steps - 1,
                                                           state.rejected > 0)

    def reached(by: Step) -> dict[str, float]:
        return parameters.unpack(parameters.pack() + by.delta + (begins if seeks else 0.0)).as_values()

    beside = tuple(ParallelTrial(reached(other), damping, rung) for rung, damping, other in further)
    return replace(state, trial=reached(step), beside=beside, sought=seeks), step


def _leave_stage(state, experiment, stages, point: Evaluation, image_noise, status: str):
    """On to the next stage, which may move where this one cannot; after the last one the loop ends with `status`."""
    if state.stage + 1 == len(stages):
        following = next_estimator(state.estimator, status, experiment, stages[-1].free, point, image_noise)
        options, left = experiment.options, experiment.options.max_iterations - state.rounds
        if following == state.estimator or left < 1:
            return replace(state, status=status), None
        if following == GENERALISED and left < MIN_EVALUATIONS_OF_AN_ESTIMATOR:  # what has converged stands, unless it was not asked for
            asked = options.estimator == GENERALISED
            return replace(state, status="max_iterations" if asked else status), None
        back = following == GENERALISED_REJECTED and state.arrived is not None
        arrived = state.arrived if following == GENERALISED_REJECTED else dict(state.accepted)  # None: ordinary ones never have
        return replace(state, estimator=following, trial=dict(state.arrived if back else state.accepted), fresh=True,
                       arrived=arrived, damping=0.0, rejected=0, stage_iterations=0, reach=1.0), None
    same = same_images(stages[state.stage], stages[state.stage + 1])
    state = replace(state, stage=state.stage + 1, stage_iterations=0, damping=0.0, rejected=0, reach=1.0)
    if not same and state.rounds < experiment.options.max_iterations:
        return replace(state, trial=dict(state.accepted), fresh=True), None
    return _next_step(state, experiment, stages, point, image_noise)


def _restrict(point: Evaluation, names) -> np.ndarray:
    pick = [point.system.names.index(name) for name in names]
    return point.reference_gram[np.ix_(pick, pick)]


def _history_entry(state: LoopState, evaluated: Evaluation, accepted: bool, passed_over: bool) -> dict:
    system = evaluated.system
    rms = None if system is None else float(np.sqrt(sum(r.rr for r in system.frames) / max(system.n_pixels, 1)))
    return {
        "evaluation": evaluated.number, "stage": state.stage, "accepted": accepted,
        "passed_over": passed_over, "damping": state.damping,
        "phi": None if system is None else system.phi, "phi_image": None if system is None else system.phi_image,
        "rms_gv": rms, "values": dict(state.trial), "message": evaluated.message,
    }


def experiment_of(experiment: Experiment, state: LoopState) -> Experiment:
    """The experiment as the stage of a state sees it."""
    return seen_in(experiment, resolve_stages(experiment)[state.stage])


def parameters_at(experiment: Experiment, state: LoopState) -> ParameterSet:
    """The accepted parameters (the start where nothing was accepted)."""
    return experiment.parameters.with_values(state.accepted or {})


