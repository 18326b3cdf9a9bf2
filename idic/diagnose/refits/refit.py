"""A candidate as a separate model: identified on one copy of the recording, measured on both.

A finite effect is not reached by one Newton step from its null, so a refit starts at the probe of its best variant; a
start that fails, or ends no better than the model without the candidate, gives way to the next one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idic.diagnose.residual.heldout import Misfit, misfit_of
from idic.diagnose.residual.residual_evidence import ResidualEvidence, residual_evidence, simulated
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.screen.select import Ranked
from idic.errors import InputError, NotConverged
from idic.fe import Control
from idic.identification import (
    AcceptedPoint, Analysis, GENERALISED, Identification, LoopState, ORDINARY, Path, Trial, identify,
    may_begin_generalised, noise_weights,
)
from idic.model import Experiment, MotionError, build_forward

MAX_STARTS = 3  # at most, from different grid points
# of a model that is compared with others: right ones converge in 3 to 7; the winner is fitted to its end
MAX_EVALUATIONS = 12
# of a standard deviation, the last step: convergence is slow where yielding points make phi non-smooth
STEP_TOLERANCE_STD = 0.1
MAX_START_AMPLITUDE = 8.0  # amplitudes of the probe that a start may promise
MIN_NULL_SHARE = 0.2  # of a positive null value
# accepted ones: the first undamped step of a linear problem ends at its minimum, whatever the start
MIN_STEPS_FROM_BORROWED = 2
MAX_FURTHER_GAIN = 3.0  # times its last improvement: the gain that a rival may still make
MAX_LAG_SHARE = 0.1  # of the way back from the best to the null: a rival that stays behind that is given up
MAX_PARAMETER_CHANGE = 0.4  # relative change of an identified parameter
# of the body per frame and increment of the identified model, on the mean of a rival's simulation (right ones take 2 to
# 4, torn ones that were given up at last 38 to 90)
MAX_BODY_EVALUATIONS = 12
MIN_BODY_EVALUATIONS = 300  # of one simulation: half a dozen increments may fail in a short test
MAX_FAILED_SIMULATIONS = 3  # of one search for a rival
GIVEN_UP = "refit given up"  # in the problem of a refit whose simulations fail


@dataclass(frozen=True, eq=False)
class Fit:
    """A model after its identification on the copy for choosing.

    values : every parameter, internal units; stds : of the free ones, None where open, from noise alone in a model
    that is only compared with others; choice, judgement : its fit on
    the copy that it was fitted to and on the other one; problem : why there is none of this, "" otherwise
    """

    name: str
    label: str
    status: str
    values: Mapping[str, float]
    stds: Mapping[str, float | None]
    local: np.ndarray
    steps: np.ndarray | None
    choice: Misfit | None
    judgement: Misfit | None
    evaluations: int = 0
    problem: str = ""
    phi: float = float("nan")  # lowest functional of ordinary least squares on the first copy
    estimator: str = ORDINARY  # it ended with

    @property
    def usable(self) -> bool:
        return self.choice is not None

    @property
    def given_up(self) -> bool:
        """Whether it was given up because its simulations found no equilibrium: the data say nothing of it."""
        return not self.usable and GIVEN_UP in self.problem


@dataclass(frozen=True, eq=False)
class Start:
    """Where a refit begins: the experiment with its candidate, values of parameters (internal units).

    borrowed : they were fitted to the copy that judges: only a search that converges or takes two steps leaves them
    """

    label: str
    experiment: Experiment
    values: Mapping[str, float]
    borrowed: bool = False


@dataclass(frozen=True)
class EarlyStop:
    """The bar for a rival: the functional (first copy) without a candidate and with the best one so far."""

    null: float
    best: float

    def cannot_win(self, phis: Sequence[float]) -> bool:
        """Whether functionals, one per accepted point, will not come near the best any more."""
        if len(phis) < 3 or not self.null > self.best:
            return False
        reachable = phis[-1] - MAX_FURTHER_GAIN * (phis[-2] - phis[-1])
        return reachable > self.best + MAX_LAG_SHARE * (self.null - self.best)


class _Stopped(Exception):
    """The rival is given up: it cannot win, or finds no equilibrium."""


class _Progress:
    """Follows an identification, and ends it where it cannot win, or where too many of its simulations fail.

    limited : whether failed simulations are counted
    """

    def __init__(self, early_stop: EarlyStop | None, limited: bool = False):
        self.early_stop, self.limited = early_stop, limited
        self.phis: list[float] = []

    def __call__(self, state: LoopState) -> None:
        failed = [entry for entry in state.history if entry["phi"] is None]
        if self.limited and len(failed) >= MAX_FAILED_SIMULATIONS:
            raise _Stopped(f"{GIVEN_UP}: {len(failed)} of {state.evaluations} simulations found no equilibrium, the "
                           f"last: {failed[-1]['message']}")
        if state.estimator.kind != ORDINARY or state.accepted is None:
            return
        if not self.phis or state.accepted.phi != self.phis[-1]:
            self.phis.append(state.accepted.phi)
        stop = self.early_stop
        if stop is not None and stop.cannot_win(self.phis):
            won = (stop.null - self.lowest) / (stop.null - stop.best)
            raise _Stopped(f"given up at {won:.0%} of what the best explains")

    @property
    def left(self) -> bool:
        """Whether the search has left its start behind."""
        return len(self.phis) > MIN_STEPS_FROM_BORROWED

    @property
    def lowest(self) -> float:
        return min(self.phis, default=float("nan"))


def refit(name: str, starts: Sequence[Start], other_copies: Mapping[str, Experiment], local: np.ndarray, grid: Grid,
          target: float = np.inf, early_stop: EarlyStop | None = None, estimator: str = ORDINARY,
          unlimited: bool = False, whole_std: bool = False, most_evaluations: int | None = None,
          begun: Path | None = None) -> Fit:
    """Identify a model from the best of a few starts and measure it; points that first order tells are not simulated.

    Parameters
    ----------
    starts : at most `MAX_STARTS` are tried, until one ends below `target`; of those with one label, a model that begins
    in
        several places, the first that converges
    other_copies : {label of the start: the same experiment on the copy for judging}; {} judges nothing
    local : (n_frames, m) mm, frame-local unknowns to begin with
    target : chi-square (`Misfit.chi2`) on the first copy that counts as an improvement
    early_stop : ends an identification that will not come near the best rival
    estimator : to begin with; "generalised" from a start that is near
    unlimited : without the limit of evaluations of a model that is compared with others
    whole_std : the standard deviations also count what the model leaves unexplained: one more pass over the images
    most_evaluations : of the body per frame, on the mean of one simulation; a simulation that needs more has failed,
        and a search of which `MAX_FAILED_SIMULATIONS` fail is given up. None: any number
    begun : a simulation of the first start or of a point near it
    """
    best, runs, problems, watch, lost = None, 0, [], _Progress(early_stop), None
    limit = None if most_evaluations is None else Control(most_evaluations=most_evaluations)
    for start in starts[:MAX_STARTS]:
        if start.label == lost or (best is not None and start.label == best[2].label):
            continue
        try:
            watch = _Progress(early_stop, limit is not None)
            most = MAX_EVALUATIONS if other_copies and not unlimited else None
            identification = _identified(_started(start, most), _fitting(local, start.experiment), watch, estimator,
                                         limit, begun)
            runs += identification.state.evaluations
            if identification.point is None or (start.borrowed
                                                and not (identification.state.status == "converged" or watch.left)):
                problems.append(f"{start.label}: {_no_answer(identification, limit)}")
                continue
            path = simulated(identification, null=False)
            misfit = misfit_of(residual_evidence(identification, light=False, null=False, responses=path), grid)
        except (NotConverged, InputError, np.linalg.LinAlgError) as problem:  # the last: equations without a solution
            problems.append(f"{start.label}: {problem}")
            continue
        except _Stopped as reason:
            problems.append(f"{start.label}: {reason}")
            lost = start.label
            continue
        if best is None or misfit.chi2 < best[1].chi2:
            stds = _stds(identification, whole_std)  # while its simulation is at hand
            best = (replace(identification, path=None), misfit, start, watch.lowest, path, stds)
        if best[1].chi2 < target:
            break
    if best is None:
        return Fit(name, starts[0].label, "failed", {}, {}, local, None, None, None, runs, "; ".join(problems))
    identification, misfit, start, phi, path, stds = best
    judged = None
    if start.label in other_copies:
        other_point = at_other_copy(identification, other_copies[start.label])
        judged = misfit_of(residual_evidence(other_point, light=False, null=False, responses=path), grid)
    return Fit(name, start.label, identification.state.status, identification.parameters.as_values(), stds,
               identification.local, identification.steps, misfit, judged, runs, phi=phi,
               estimator=identification.state.estimator.kind)


def _no_answer(identification: Identification, limit: Control | None) -> str:
    """Why a search ended without a point that counts."""
    if identification.point is None and limit is not None:
        return f"{GIVEN_UP}: {identification.state.history[-1]['message']}"
    return identification.state.status


def _identified(experiment: Experiment, local: np.ndarray | None, watch: _Progress, estimator: str,
                control: Control | None, begun: Path | None) -> Identification:
    """By generalised least squares from the first step where they are to begin with and may; otherwise as every one."""
    begin = estimator if estimator == GENERALISED and may_begin_generalised(experiment) else ORDINARY
    return identify(experiment, local, progress=watch, estimator=begin, control=control, begun=begun, foreseen=True)


def warm_start(ranked: Ranked, values: Mapping[str, float]) -> dict[str, float]:
    """Where the score expects the model with a candidate: its own unknowns and the identified ones, to first order.

    Where the null is infinite the probe is the start, and the others go along with it. Large promises are beyond first
    order and are cut.
    """
    variant, amplitude = ranked.variant, ranked.amplitude
    unknowns: dict[str, float] = dict(ranked.start)
    if variant.free_course:
        size = amplitude
    elif variant.direct:
        size = amplitude
        unknowns = dict(variant.null)
        if len(variant.new) == 1:
            unknowns = {name: value + amplitude for name, value in unknowns.items()}
    else:
        finite = all(np.isfinite(variant.null.get(name, 0.0)) for name in variant.new)
        size = float(np.clip(amplitude, -MAX_START_AMPLITUDE, MAX_START_AMPLITUDE)) if finite else 1.0
        for name in variant.new:
            null, probe = variant.null.get(name, 0.0), variant.probe[name]
            value = null + size * (probe - null) if finite else probe
            unknowns[name] = max(value, MIN_NULL_SHARE * null) if null > 0.0 and finite else value
    share = size / amplitude if amplitude else 0.0
    moved = {name: value + float(np.clip(share * ranked.bias.get(name, 0.0), -MAX_PARAMETER_CHANGE * abs(value),
                                         MAX_PARAMETER_CHANGE * abs(value)))
             for name, value in values.items()}
    return moved | unknowns


def _started(start: Start, evaluations: int | None) -> Experiment:
    """The experiment with its start values; evaluations : at most so many, where they are limited.

    Raises
    ------
    InputError
        If a positive parameter would begin at zero: its logarithm is searched.
    """
    options = replace(start.experiment.options, tolerance=max(start.experiment.options.tolerance, STEP_TOLERANCE_STD))
    if evaluations is not None:
        options = replace(options, max_iterations=min(options.max_iterations, evaluations))
    parameters = start.experiment.model.parameters
    values = {name: float(np.clip(value, *parameters[name].bounds))
              for name, value in parameters.own_of(start.values).items()}
    zeros = [name for name, value in values.items() if parameters[name].transform == "log" and not value > 0.0]
    if zeros:
        raise InputError(f"{', '.join(zeros)} would begin at zero, and is searched as a logarithm",
                         remedy="begin at a positive value")
    return replace(start.experiment, model=replace(start.experiment.model, parameters=parameters.with_starts(values)),
                   stages=(), options=options)


def _fitting(local: np.ndarray, experiment: Experiment) -> np.ndarray | None:
    """The frame-local unknowns as a start, where the candidate leaves their number as it is."""
    return local if build_forward(experiment).drives.n_local == local.shape[1] else None


def _stds(identification: Identification, counts_misfit: bool) -> dict[str, float | None]:
    """Of the free parameters, internal units, None where the recording leaves one open; counts_misfit : not noise
    alone."""
    discrepancy = (identification.discrepancy,) if counts_misfit else ()
    analysis = Analysis(identification.experiment, identification.parameters, identification.point,
                        identification.weights.image_noise, *discrepancy)
    return {name: analysis.std(name) for name in identification.parameters.free}


def at_other_copy(identification: Identification, experiment: Experiment) -> Identification:
    """The same point seen by another copy of the recording; nothing is fitted."""
    return identification_at(experiment, identification.parameters.as_values(), identification.local,
                             identification.steps)


def identification_at(experiment: Experiment, values: Mapping[str, float], local: np.ndarray,
           steps: np.ndarray | None) -> Identification:
    """An identification record at given values, as if it had ended there."""
    state = LoopState(Trial(dict(values)), AcceptedPoint(dict(values)), status="converged")
    return Identification(experiment, build_forward(experiment), state, None, local, steps, noise_weights(experiment))


def refit_residual(experiment: Experiment, refitted: Fit) -> ResidualEvidence:
    """The residual of a refitted model.

    Its search began every simulation at a neighbour's solution. From rest its increments may find no equilibrium; then
    the simulation chooses its own.

    Raises
    ------
    NotConverged
        If there is no equilibrium from rest, however small the increments.
    """
    try:
        point = identification_at(experiment, refitted.values, refitted.local, refitted.steps)
        return residual_evidence(point, light=False)
    except NotConverged:
        point = identification_at(experiment, refitted.values, refitted.local, None)
        return residual_evidence(point, light=False)


def is_residual_of(residual: ResidualEvidence, refitted: Fit, error: MotionError | None) -> bool:
    """Whether a residual was simulated at the end of a refit, with this known error."""
    at = residual.context
    return at.parameters.as_values() == dict(refitted.values) and at.experiment.model.motion_error is error


def residual_from_rest(experiment: Experiment, refitted: Fit) -> ResidualEvidence | None:
    """The residual of a refitted model; None where it finds no equilibrium from rest."""
    try:
        return refit_residual(experiment, refitted)
    except NotConverged:
        return None
