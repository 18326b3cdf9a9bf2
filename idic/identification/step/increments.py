"""The choice of the increments of time: as many as the identified parameters need, by halving them at a converged
point.

One increment per frame makes a rate-dependent law wrong by many standard deviations, and plasticity where frames are
few. A search therefore begins with one increment per frame, which is cheap, and continues from its end with finer ones:
1 and 2 per frame, extrapolated in time (`idic.fe.extrapolation`), then 2 and 4, 4 and 8, ... While a search runs its
increments are frozen. The choice ends where the error that is left,

    value - value without time error = (value before - value) / (2^(p+1) - 1),  p + 1 = 2

after extrapolation of a law of first order, is at most `MAX_ERROR_STD` standard deviations of every parameter. A search
need not reach its end for that: near it a Gauss-Newton step tells where it lies (`knows_end`), and finer increments
begin there. Only the search with the last increments runs to its end.

Where a material softens, a long increment may find no equilibrium and is halved. The functional jumps where that
begins, by the error of the time integration, and a search before such a jump ends nowhere. Finer increments begin there
(`meets_a_jump`).

Laws with a memory but without time are often exact enough with one increment per frame. At the end of their first
search one increment for two frames is simulated for comparison, beginning at the known solution and without derivatives
(`idic.fe.half_rate`). The Gauss-Newton step from there is the estimated error of one increment per frame. Where it is
small, the end of the first search is the answer. Otherwise 1 and 2 per frame are simulated, with the same judgement.
Where one is not enough, 1 and 2 leave an eighth of its error at most (docs/evidence/time-step.md), and mostly suffice.

Linear elements of a solid that is too large for a finer mesh have an error whose size is known at most. In bars
between rigid grips it was the larger one: 10 cubed hex8 moved the hardening modulus by 24 %, with 31 cubed it was 5 %
off; 1 and 2 increments per frame moved it by 2 and 1 % (studies/evidence/volumes/scale.py). There 1 and 2 are the last
for laws without time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from idic.identification.step.acceptance import scaled_at
from idic.identification.step.proposal import Step
from idic.identification.step.settled import negligible
from idic.identification.step.stages import stage_parameters
from idic.identification.step.state import (
    AS_GIVEN,
    AT_LIMIT,
    COMPARED,
    ENOUGH,
    FAILED,
    HALF_RATE,
    OPEN,
    Evaluation,
    IncrementChoice,
    LoopState,
    SchedulePosition,
    Trial,
    TrustRegion,
)
from idic.model import Experiment, Measured, Model, Stage
from idic.simulation_error import can_be_refined

MAX_ERROR_STD = 0.25  # of a parameter by the increments, standard deviations
REMAINING_SHARE = 1.0 / 3.0  # of the change by halving: the error after it, of second order
# after 1 and 2 per frame, of the change from 1: laws without time (1/50 to 1/10 measured)
REMAINING_SHARE_WITHOUT_TIME = 1.0 / 8.0
MAX_HALF_RATE_SHARE = 0.85  # of the limit, up to which an estimate in steps of two frames is trusted
MANY_INTERVALS, MIN_HALF_RATE_INTERVALS = 20, 4  # between frames
MAX_HALF_RATE_SHARE_OF_FEW = 0.4  # with fewer than many the estimate is 0.45 to 1.9 times the error (measured)
FIRST_HALVING = 2  # increments per frame, of the finer simulation; it is always tried
MAX_INCREMENTS = 64  # per frame, of the finer simulation
MAX_INCREMENTS_OF_TEST = 5000  # of the finer simulation, all frames
MIN_EVALUATIONS = 4  # left for a search with finer increments, that it converges
ENDS = ("converged", "at_bound", "stalled")  # of a search whose end is worth a finer one
TOO_COARSE = "too_coarse"  # end of a search whose increments are so long that it does not find its end soon
MOST_COARSE = 8  # increments per frame, from which on only the estimated error asks for more
MAX_COARSE_STEPS, MAX_COARSE_REJECTIONS = 8, 2  # accepted steps, and rejected ones in a row, of that search
KNOWN = "known"  # end of a search that is known before it is reached
# distance from its end after a Gauss-Newton step, over the step and its largest scaled component (at most 6 in J2
# strips of 5 to 24 frames, a strip that creeps and a plate before two cameras; 13 in the demo, where the step is short)
CURVATURE = 5.0
MAX_KNOWN_ERROR = 0.1  # of that distance, over the largest change with which increments are enough


def chooses_increments(experiment: Experiment) -> bool:
    """Whether the number of increments is found by an error estimate: a law has a memory, and no number is given."""
    return experiment.options.substeps is None and bool(experiment.model.path_dependent_laws)


def with_increments_judged(state: LoopState, experiment: Experiment, stage: Stage, point: Evaluation,
                           image_noise: float, status: str, end_values: Mapping[str, float] | None = None) -> LoopState:
    """The state at the end of its schedule with a verdict on its increments, or with the trial of finer ones.

    Parameters
    ----------
    stage : the last one; point : the accepted one; status : with which the schedule ends, TOO_COARSE or KNOWN
    end_values : where the search will end, if it has not; a verdict on them is given once more at the end
    """
    choice = state.increments
    if not chooses_increments(experiment) or choice.status in (AT_LIMIT, FAILED):
        return state
    values = state.accepted.values if end_values is None else end_values
    if status not in (*ENDS, TOO_COARSE, KNOWN):
        return replace(state, increments=replace(choice, status=OPEN))
    if status == TOO_COARSE:
        return _to_finer(state, 2 * (choice.per_frame or 1), None, None)
    coarser = choice.coarser
    if coarser is not None:
        choice = replace(choice, coarser=None, change={name: values[name] - coarser[name] for name in values})
    if choice.change is not None and (largest_change(choice, state, experiment, stage, point, image_noise, status)
                                      <= max_change(experiment.model, choice)):
        return replace(state,
                       increments=replace(choice, status=ENOUGH, coarser=None if end_values is None else coarser))
    finer = 2 * (choice.per_frame or 1)
    if finer > max_increments(experiment.model):
        return replace(state, increments=replace(choice, status=AT_LIMIT))
    if experiment.options.max_iterations - state.rounds < MIN_EVALUATIONS:
        return replace(state, increments=replace(choice, status=OPEN))
    if choice == IncrementChoice() and not experiment.model.rate_dependent_laws:
        half_rate = n_intervals(experiment.model) >= MIN_HALF_RATE_INTERVALS
        return _to_compare(state, HALF_RATE if half_rate else finer)
    return _to_finer(state, finer, dict(values), choice.change)


def _to_finer(state: LoopState, finer: int, end: Mapping[str, float] | None,
              change: Mapping[str, float] | None) -> LoopState:
    """The state that goes on with so many increments, from the end of the search so far or from the accepted point."""
    return replace(state, increments=IncrementChoice(finer, OPEN, end, change), trust=TrustRegion(),
                   schedule=SchedulePosition(state.schedule.stage),
                   trial=Trial(dict(state.accepted.values if end is None else end), re_evaluation=True,
                               new_increments=True))


def _to_compare(state: LoopState, increments: int) -> LoopState:
    """The state that simulates its accepted point once more, for comparison."""
    values = dict(state.accepted.values)
    return replace(state, increments=IncrementChoice(increments, COMPARED, values),
                   trial=Trial(values, re_evaluation=True, new_increments=True))


def knows_end(step: Step, state: LoopState, experiment: Experiment) -> bool:
    """Whether the end of a search whose increments are to be judged is known by the next step from its accepted point.

    The step is a whole Gauss-Newton step and so short that its end misses that of the search by a small part of what
    the judgement of the increments bears. One increment per frame, which may be the answer, goes to its end.
    """
    choice = state.increments
    if not chooses_increments(experiment) or choice.status != OPEN or choice.coarser is None:
        return False
    return is_whole(step, state) and error_of(step) < MAX_KNOWN_ERROR * max_change(experiment.model, choice)


def is_whole(step: Step, state: LoopState) -> bool:
    """Whether a step is that of Gauss and Newton along all directions, neither damped nor limited."""
    along_all = step.significance == step.relative
    return (along_all and state.trust.damping == 0.0 and state.trust.rejections == 0 and not step.clipped
            and not step.pinned)


def error_of(step: Step) -> float:
    """Distance of a whole Gauss-Newton step's end from the end of its search, standard deviations."""
    return CURVATURE * step.largest * step.relative


def meets_a_jump(state: LoopState, model: Model, trial: Evaluation, accepted: Evaluation) -> bool:
    """Whether trials may have been rejected since the functional jumps: an increment found no equilibrium and was
    halved, at the accepted point or at the last trial.

    Laws that depend on time have a rule of their own (`is_too_coarse`).
    """
    per_frame = state.increments.per_frame or 1
    intervals = n_intervals(model) if trial.intervals is None else trial.intervals
    n_without_halving = intervals * (per_frame + (per_frame // 2 if state.increments.per_frame else 0))
    return (trial.system is not None and max(trial.increments, accepted.increments) > n_without_halving > 0
            and accepted.increments > 0 and per_frame < MOST_COARSE and not model.rate_dependent_laws
            and state.trust.rejections >= MAX_COARSE_REJECTIONS)


def is_too_coarse(state: LoopState, experiment: Experiment, jump: bool = False) -> bool:
    """Whether a search is left for one with finer increments before its end.

    Its end with one increment per frame is wrong by many standard deviations where a law depends on time; where the
    stress falls as the specimen yields, it may not exist.

    jump : whether increments that were halved may be why the last trials were rejected (`meets_a_jump`)
    """
    choice, rejections = state.increments, state.trust.rejections
    if (not chooses_increments(experiment) or choice.status not in (AS_GIVEN, OPEN)
            or experiment.options.max_iterations - state.rounds < MIN_EVALUATIONS
            or 2 * (choice.per_frame or 1) > max_increments(experiment.model)):
        return False
    if jump:
        return True
    return choice == IncrementChoice() and bool(experiment.model.rate_dependent_laws) and (
        state.schedule.iterations >= MAX_COARSE_STEPS or rejections >= MAX_COARSE_REJECTIONS)


def has_rough_steps(experiment: Experiment) -> bool:
    """Whether steps are wrong by a part of themselves.

    Where an edge moves as it was measured and points yield, its noise in one frame changes plastic strain in later
    ones, which the derivatives leave out.
    """
    measured = any(isinstance(entry.drive, Measured) for entry in experiment.model.prescribed)
    return measured and chooses_increments(experiment) and not experiment.model.rate_dependent_laws


def is_judged_next(state: LoopState, experiment: Experiment) -> bool:
    """Whether the end of a search is where its increments are judged first, with evaluations left to go on."""
    return (state.increments == IncrementChoice() and chooses_increments(experiment)
            and experiment.options.max_iterations - state.rounds >= MIN_EVALUATIONS)


def with_comparison_judged(state: LoopState, experiment: Experiment, stage: Stage, finer: Evaluation,
                           accepted: Evaluation,
                           image_noise: float) -> LoopState:
    """The state after other increments were simulated for comparison: back to one increment per frame where that is
    enough; otherwise on with finer ones, which are to be compared after steps of two frames.

    Parameters
    ----------
    stage : the last one; finer, accepted : evaluations of the accepted values, extrapolated in time and with
    one increment per frame
    """
    half_rate = state.increments.per_frame == HALF_RATE
    if finer.system is None and half_rate:
        return _to_compare(state, 2)
    if finer.system is None:
        return replace(state, increments=IncrementChoice(None, FAILED), trial=Trial(dict(state.accepted.values)))
    current = experiment.model.parameters.with_values(state.accepted.values)
    parameters, steps = stage_parameters(current, stage), []
    for point in (finer, accepted):
        scaled = scaled_at(point, parameters, stage, image_noise)
        steps.append(scaled.spectrum().inverse @ scaled.b)
    moved = parameters.unpack(parameters.pack() + steps[0] - steps[1])
    change = {name: (moved[name].value if name in moved else value) - value
              for name, value in current.as_values().items()}
    choice = IncrementChoice(None, ENOUGH, None, change)
    largest = largest_change(choice, state, experiment, stage, accepted, image_noise, state.end.status)
    many = n_intervals(experiment.model) >= MANY_INTERVALS
    trusted = MAX_HALF_RATE_SHARE if many else MAX_HALF_RATE_SHARE_OF_FEW
    if half_rate and largest > trusted * max_change(experiment.model, choice):
        return _to_compare(state, 2)
    if largest > max_change(experiment.model, choice):
        return replace(state, increments=replace(state.increments, status=OPEN), trust=TrustRegion(),
                       schedule=SchedulePosition(state.schedule.stage))
    return replace(state, increments=choice, trial=Trial(dict(state.accepted.values)))


def remaining_share(model: Model, choice: IncrementChoice) -> float:
    """Error that is left over the change of a parameter that is known of a choice."""
    if choice.per_frame is None:
        return 1.0
    first_of_a_law_without_time = choice.per_frame == 2 and not model.rate_dependent_laws
    return REMAINING_SHARE_WITHOUT_TIME if first_of_a_law_without_time else REMAINING_SHARE


def max_change(model: Model, choice: IncrementChoice) -> float:
    """Largest change of a parameter with which a choice is enough, standard deviations."""
    return MAX_ERROR_STD / remaining_share(model, choice)


def max_increments(model: Model) -> int:
    """The limit of increments per frame: `MAX_INCREMENTS`, fewer in a test of many frames; the first halving where the
    error by the mesh is larger."""
    if errs_by_its_mesh(model):
        return FIRST_HALVING
    return max(FIRST_HALVING, min(MAX_INCREMENTS, MAX_INCREMENTS_OF_TEST // n_intervals(model)))


def errs_by_its_mesh(model: Model) -> bool:
    """Whether linear elements of a solid, of laws without time, leave an error of which at most its size is known."""
    return (model.kind == "solid" and model.mesh.can_raise_order and not can_be_refined(model)
            and not model.rate_dependent_laws)


def n_intervals(model: Model) -> int:
    """Intervals between the simulated frames."""
    return max(model.n_frames - 1 - model.reference, 1)


def largest_change(choice: IncrementChoice, state: LoopState, experiment: Experiment, stage: Stage, point: Evaluation,
                   image_noise: float, status: str) -> float:
    """Largest change of a parameter by the last halving, in standard deviations; 0 where the error that is left does
    not matter beside the misfit of the model.

    status : with which the search ended; one that stalled may have met the jumps that its increments make
    """
    parameters = stage_parameters(experiment.model.parameters.with_values(state.accepted.values), stage)
    scaled = scaled_at(point, parameters, stage, image_noise)
    error = remaining_share(experiment.model, choice) * np.array([choice.change[name] for name in scaled.names])
    error /= np.where(scaled.slopes == 0.0, np.inf, scaled.slopes)
    if status != "stalled" and error @ scaled.M @ error < negligible(point.system, experiment.options.lowpass_px):
        return 0.0
    stds = np.sqrt(np.maximum(np.diagonal(scaled.covariance(scaled.spectrum())), 0.0)) * np.abs(scaled.slopes)
    changes = np.array([abs(choice.change[name]) for name in scaled.names])
    return float(np.max(changes[stds > 0.0] / stds[stds > 0.0], initial=0.0))


def without_finer(state: LoopState) -> LoopState:
    """The state after finer increments that find no equilibrium: back to the accepted ones, which are the last."""
    coarser = state.increments.per_frame // 2
    return replace(state, trust=TrustRegion(), trial=Trial(dict(state.accepted.values)), increments=replace(
        state.increments, per_frame=coarser if coarser > 1 else None, coarser=None, status=FAILED))


def time_bias(model: Model, choice: IncrementChoice) -> Mapping[str, float]:
    """Estimated error of the values by the increments (internal units); empty where none was estimated."""
    share = remaining_share(model, choice)
    return {} if choice.change is None else {name: -share * change for name, change in choice.change.items()}


def increments_entry(experiment: Experiment, choice: IncrementChoice) -> dict:
    """``increments`` of result.json: the number per frame, how it was chosen, and in words.

    per_frame : of the finer simulation where two are extrapolated in time; chosen : "frames" (no law has a memory),
    "given" (``substeps``), "error_estimate"; status : "enough", or why the error may be larger
    """
    laws, substeps = experiment.model.path_dependent_laws, experiment.options.substeps
    chosen = "given" if substeps is not None else "error_estimate" if laws else "frames"
    number = substeps or choice.per_frame or 1
    entry = {"per_frame": number, "extrapolated": choice.per_frame is not None, "chosen": chosen,
             "status": choice.status if chosen == "error_estimate" else None,
             "rate_dependent_laws": list(experiment.model.rate_dependent_laws), "path_dependent_laws": list(laws)}
    return entry | {"words": describe(experiment, choice)}


def describe(experiment: Experiment, choice: IncrementChoice) -> str:
    """The increments in one sentence part."""
    substeps, n = experiment.options.substeps, choice.per_frame
    if substeps is not None and experiment.model.path_dependent_laws:
        return f"{substeps} per frame, as given by substeps; their error was not estimated"
    if not chooses_increments(experiment):
        return f"{substeps or 1} per frame"
    if n is None and choice.status == ENOUGH:
        return (f"1 per frame, chosen by an error estimate: shorter ones would change no parameter by more than "
                f"{max_change(experiment.model, choice):g} std")
    number = "1 per frame" if n is None else f"{n} per frame, extrapolated in time from {n // 2} and {n}"
    reason = (f", chosen by an error estimate: halving them changed no parameter by more than "
              f"{max_change(experiment.model, choice):g} std")
    return number + (reason if choice.status == ENOUGH else "")


def planned_increments(experiment: Experiment) -> tuple[str, ...]:
    """What `idic check` says of the increments, before any simulation; nothing where no law has a memory, or where they
    are given to one without time."""
    laws, substeps = ", ".join(experiment.model.path_dependent_laws), experiment.options.substeps
    in_time = bool(experiment.model.rate_dependent_laws)
    if not laws or (substeps is not None and not in_time):
        return ()
    on = f"law {laws} depends on {'time' if in_time else 'its history'}"
    if substeps is not None:
        return (f"{on}: {substeps} increment{'s' if substeps > 1 else ''} per frame, as given by substeps",)
    return (f"{on}: the identification chooses the increments per frame by an error estimate, "
            f"{max_increments(experiment.model)} at most",)


def increment_notes(experiment: Experiment, choice: IncrementChoice) -> list[str]:
    """How many increments were chosen and why, or that they are not known to be short enough."""
    if not chooses_increments(experiment):
        return []
    laws, n = ", ".join(experiment.model.path_dependent_laws), choice.per_frame
    if choice.status == ENOUGH:
        return [f"increments of law {laws}: {describe(experiment, choice)}"]
    changed = "" if choice.change is None else (f"; the last halving changed a parameter by more than "
                                                f"{max_change(experiment.model, choice):g} std")
    limit = ("shorter ones are not tried where the error by the mesh is larger: take a finer mesh or quadratic elements"
             if errs_by_its_mesh(experiment.model) else
             f"{max_increments(experiment.model)} are the limit here: record more frames where the load changes fast, "
             "or give substeps")
    reason = {AT_LIMIT: limit,
              FAILED: "no equilibrium was found with shorter ones: give substeps, or check the loads",
              }.get(choice.status, "the search ended before shorter ones were tried: raise max_iterations")
    return [f"time step error not known to be below the standard deviations: law {laws}, "
            f"{n or 1} increment{'s' if n else ''} per frame{changed}; {reason}"]
