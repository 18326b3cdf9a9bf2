"""The identification loop: simulates, correlates and judges trial parameters until the search ends.

One driver for every identification. Where the evaluated points are kept is the business of a `PointStore`: in memory
(`MemoryPoints`) or in a RUN folder (`idic.run.points`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from idic.identification.loop import advance
from idic.identification.step.state import HALF_RATE, Evaluation, LoopState
from idic.model import Experiment

StageHook = Callable[..., Any]  # stage(name, function, *arguments): calls the function and returns its result


class PointStore(Protocol):
    """Evaluated points of an identification, and how a point is evaluated.

    experiment : whose schedule and options steer the loop; image_noise : GV, after the low-pass
    state : where the identification stands, its start where nothing has been evaluated
    simulate : the trials of a state; why each failed, or ""
    correlate : the trials, those that failed included; an evaluation of each
    accepted : the last accepted point, None where there is none
    keep : store the state, the evaluated points and where the next trials start; drop what is no longer needed
    """

    @property
    def experiment(self) -> Experiment: ...
    @property
    def image_noise(self) -> float: ...
    def state(self) -> LoopState: ...
    def simulate(self, trials: Sequence[LoopState]) -> list[str]: ...
    def correlate(self, trials: Sequence[LoopState], failed: Sequence[str]) -> Sequence[Evaluation]: ...
    def accepted(self, state: LoopState) -> Evaluation | None: ...
    def keep(self, state: LoopState, points: Sequence[Any], previous: Any) -> None: ...  # evaluations of this store


def call(name: str, function: Callable, *arguments: object) -> Any:
    """The stage hook that only calls."""
    return function(*arguments)


def run_loop(points: PointStore, stage: StageHook = call,
             progress: Callable[[LoopState], None] = lambda state: None, pause_after: int | None = None) -> LoopState:
    """Drive an identification to its end, or to the end of a stage of its schedule; returns the last state.

    Parameters
    ----------
    points : where it begins or resumes, and where evaluated points are kept
    stage : makes a named stage of an iteration ("simulate it003", "correlate it003", "update it003")
    progress : called with the first state and with every later one
    pause_after : number of a stage of the schedule (1: the first); the loop returns a running state where this process
        has seen its end and another stage follows
    """
    state = points.state()
    progress(state)
    began_in = state.schedule.stage
    while state.running and not (pause_after is not None and began_in < pause_after <= state.schedule.stage):
        number, trials = f"it{state.evaluations:03d}", state.trial_states
        failed = stage(f"simulate {number}", points.simulate, trials)
        evaluated = stage(f"correlate {number}", points.correlate, trials, failed)
        state = stage(f"update {number}", update, points, state, evaluated)
        progress(state)
    return state


def update(points: PointStore, state: LoopState, evaluated: Sequence[Evaluation]) -> LoopState:
    """Judge the evaluated trials, choose the next ones and keep both."""
    previous = points.accepted(state)
    first, *parallel = evaluated
    advanced = advance(state, points.experiment, first, previous, points.image_noise, parallel)
    points.keep(advanced, evaluated, previous)
    return advanced


def next_local(state: LoopState, point: Evaluation, local: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Frame-local unknowns of a trial: their own step plus the response to the step of the global ones.

    Their own step is damped as that of the global ones: where points yield, that of one frame changes the frames after
    it, and at full length it may undo what a short step of the global ones gains.

    Parameters
    ----------
    point, local : the accepted point and its frame-local unknowns  # (n_frames, m) mm
    names : the global unknowns of the point

    Returns
    -------
    array (n_frames, m) mm
    """
    predicted = local.copy()
    if state.increments.per_frame == HALF_RATE:
        return predicted  # beside a known simulation
    change = np.array([state.trial.values[name] - state.accepted.values[name] for name in names])
    for record in point.system.frames:
        predicted[record.frame] += record.local_step / (1.0 + state.trust.damping) + record.local_slope @ change
    return predicted


class MemoryPoint(Protocol):
    """A point in memory: its evaluation (None before the first one) and the data that the next simulation needs."""

    evaluation: Evaluation | None


P = TypeVar("P", bound=MemoryPoint)


class MemoryPoints(Generic[P]):
    """The accepted point, in memory. See `PointStore`.

    Parameters
    ----------
    first : the state to begin with; start : the point before any was evaluated
    evaluate : evaluates a trial, beginning at the accepted point; frames are simulated and correlated in turn
    """

    def __init__(self, experiment: Experiment, image_noise: float, first: LoopState, start: P,
                 evaluate: Callable[[LoopState, P], P]):
        self.experiment, self.image_noise, self.point = experiment, image_noise, start
        self._first, self._evaluate = first, evaluate
        self._tried: list[P] = []

    def state(self) -> LoopState:
        return self._first

    def simulate(self, trials: Sequence[LoopState]) -> list[str]:
        """Nothing yet: `correlate` takes each frame as it is simulated."""
        return [""] * len(trials)

    def correlate(self, trials: Sequence[LoopState], failed: Sequence[str]) -> list[Evaluation]:
        self._tried = [self._evaluate(trial, self.point) for trial in trials]
        return [point.evaluation for point in self._tried]

    def accepted(self, state: LoopState) -> Evaluation | None:
        return self.point.evaluation

    def keep(self, state: LoopState, points: Sequence[Evaluation], previous: Evaluation | None) -> None:
        for point in self._tried:
            if state.has_accepted(point.evaluation.number):
                self.point = point
        self._tried = []


def describe_evaluation(entry: Mapping) -> str:
    """One line for an entry of the history of an identification."""
    if entry.get("phi") is None:
        reason = entry.get("message") or "not converged"
        consequence = "" if entry.get("passed_over") else "; step halved"
        return f"evaluation {entry['evaluation']:3d}  no simulation: {reason}{consequence}"
    rms = "" if entry.get("rms_gv") is None else f"  residual {entry['rms_gv']:.4g} (rms)"
    judged = ("" if entry.get("accepted") else "  with other increments, for comparison" if entry.get("compared")
              else "  passed over" if entry.get("passed_over") else "  rejected")
    return f"evaluation {entry['evaluation']:3d}  objective {entry['phi']:.6g}{rms}{judged}"


def log_progress(say: Callable[[str], None]) -> Callable[[LoopState], None]:
    """A progress callback that gives `say` a line per point evaluated since its first call."""
    lengths: list[int] = []

    def progress(state: LoopState) -> None:
        for entry in state.history[lengths[-1] if lengths else len(state.history):]:
            say(describe_evaluation(entry))
        lengths.append(len(state.history))

    return progress
