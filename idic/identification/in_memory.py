"""The identification as one call without files: an experiment record in, parameters and their evidence out.

The same records, functions and numbers as with a RUN folder (`idic.run.points`). Frames are simulated and correlated
one after the other; of the fields only those of the accepted point are kept, where they are small enough
(`idic.identification.kept_simulation`). For notebooks, studies of small runs (each a task on a worker) and the
refits of a diagnosis.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from idic.correlation import CorrelationContext, FrameResponse, Reference, Weights, build_experiment_reference
from idic.errors import GaveUp, InputError, NotConverged
from idic.fe import Control, FrameState
from idic.identification.discrepancy.normal_equations import DiscrepancySystem, discrepancy_system, reason_against
from idic.identification.driver import MemoryPoints, next_local, run_loop
from idic.identification.free_motion.two_step import check_method, measure, measured_reference
from idic.identification.kept_simulation import (
    MAX_SECOND_ORDER_STD, MAX_SECOND_ORDER_STD_ON_THE_WAY, Path, PathKeeper,
)
from idic.identification.loop import experiment_of, parameters_at, start
from idic.identification.point import closed_evaluation, point_context, streamed_system
from idic.identification.result import build_result
from idic.identification.step.state import (
    GENERALISED,
    HALF_RATE,
    ORDINARY,
    EstimatorChoice,
    Evaluation,
    IncrementChoice,
    LoopState,
    Trial,
)
from idic.identification.stiffness_field import StiffnessField, stiffness_field
from idic.identification.systematic.discretisation import is_coarse, with_mesh_error
from idic.identification.weights import noise_weights
from idic.images import Camera
from idic.model import Experiment, ForwardModel, build_forward, tried_increments
from idic.parameters import ParameterSet
from idic.simulation_error import ModelPoint


@dataclass(frozen=True)
class Identification:
    """The end of an identification.

    point : the accepted evaluation, None where no simulation converged; local : (n_frames, m) mm, frame-local
    unknowns of that point; steps : its increments (s); weights : with the noise figures behind them; path : its
    simulation, None where it was not kept; stored : displacements of every simulated frame ((n_nodes, dim) mm, the
    reference first) or guesses of them, anew at every call, where a RUN or another model has them.
    """

    experiment: Experiment
    forward: ForwardModel
    state: LoopState
    point: Evaluation | None
    local: np.ndarray
    steps: np.ndarray | None
    weights: Weights
    path: Path | None = None
    stored: Callable[[], Iterator[np.ndarray]] | None = None

    @property
    def parameters(self) -> ParameterSet:
        """All parameters at the accepted point."""
        return parameters_at(self.experiment.model, self.state)

    @property
    def model_point(self) -> ModelPoint:
        """The model there without a known error, to compare it with another one (`idic.simulation_error`)."""
        return ModelPoint(replace(self.experiment, model=replace(self.experiment.model, motion_error=None)),
                          self.parameters, self.local, self.steps, self._motion)

    def march(self, names: Sequence[str] = (), influence: bool = False) -> Iterator[FrameState]:
        """Simulate the accepted point once more, beginning at its solution where that is at hand.

        With its increments: halved where a fresh start needs it, as the search had a neighbour's solution to begin
        with.

        Parameters
        ----------
        names, influence : as for `ForwardModel.march`

        Raises
        ------
        NotConverged
            If equilibrium is not found however small the increments.
        """
        motion = None if self._motion is None else self._motion()
        return self.forward.march(self.parameters, names, self.local, self.steps, influence, motion, may_cut=True)

    @property
    def _motion(self) -> Callable[[], Iterator[np.ndarray]] | None:
        """Gives the displacements of every simulated frame, at this point or near it, at each call; None without."""
        path, error = self.path, self.experiment.model.motion_error
        if path is None:
            return self.stored
        if error is None:
            return lambda: (at.u for at in path.frames)
        return lambda: (at.u[:, :error.u.shape[2]] - error.u[at.frame] for at in path.frames)

    @property
    def result(self) -> dict:
        """Parameters with standard deviations, correlations and parameters that are not identifiable: the keys of
        result.json."""
        return build_result(self.experiment, self.state, self.point, self.weights.image_noise, {}, [],
                            {"forward_runs": self.state.evaluations}, self.discrepancy)

    def stiffness_field(self, element_set: str, spacing_mm: float, length_mm: float,
                        std: float = 0.3) -> StiffnessField:
        """Where an element set is stiffer or softer than the accepted point says, which stays as it is.

        Parameters
        ----------
        spacing_mm : of the grid of the field, hundreds of whose values cost a few simulations
        length_mm : within which the field is alike; std : of its logarithm before the test

        Raises
        ------
        InputError, NotConverged
            As `idic.identification.stiffness_field`.
        """
        experiment = experiment_of(self.experiment, self.state)
        setup = _Setup(experiment, self.forward, (), self.weights, {}, {})
        steps = self.steps if self.state.increments.per_frame is None else None
        return stiffness_field(self.forward, self.parameters, _context(setup, self.parameters, False),
                               experiment.correlated_frames(range(experiment.model.n_frames)), steps, element_set,
                               spacing_mm, length_mm, std)

    @property
    def discrepancy(self) -> DiscrepancySystem | str:
        """The normal equations with what the model may leave unexplained, or why they are not made.

        One more pass over the images at the accepted point, and one law evaluation per frame; of a coarse mesh one more
        simulation on a finer one.
        """
        experiment = experiment_of(self.experiment, self.state)
        reason = reason_against(experiment, self.point)
        if reason:
            return reason
        moving = tuple(name for name in experiment.model.parameters.free if self.forward.moves(name))
        setup = _Setup(experiment, self.forward, moving, self.weights, {}, {})
        context = _context(setup, self.parameters, self.point.system.generalised)
        start = experiment.model.reference

        def frames(names: Sequence[str]) -> Iterator[FrameResponse]:
            if self.path is not None:
                return iter(self.path.frames[1:])
            return (FrameResponse.of(at, start) for at in self.march(names, bool(names)) if at.frame > 0)

        return point_discrepancy(context, self.forward, self.local, (response.u for response in frames(())),
                                 frames(moving), experiment, self.point, self.state.increments.per_frame)


def point_discrepancy(context: CorrelationContext, forward: ForwardModel, local: np.ndarray,
                      motion: Iterable[np.ndarray], responses: Iterable[FrameResponse], experiment: Experiment,
                      point: Evaluation, increments: int | None) -> DiscrepancySystem | str:
    """The normal equations of an accepted point with what its model may leave unexplained and with the error of a
    coarse mesh, or why they are not made.

    Parameters
    ----------
    context : of the point, with the weights of its estimator
    local : (n_frames, m) mm, frame-local unknowns
    motion : displacements of every frame after the reference  # (n_nodes, dim) mm each
    responses : of these frames, with their derivatives
    experiment : as the last stage sees it; point : its evaluation; increments : per frame, extrapolated in time
    """
    compared = (response for response in responses if experiment.correlated_frames([response.frame]))
    try:
        system = discrepancy_system(context, forward, local, motion, compared)
    except NotConverged as problem:
        return str(problem)
    if not is_coarse(experiment):
        return system
    return with_mesh_error(system, evaluate_at, experiment, context.parameters.as_values(), local,
                           point.system.generalised, point, increments)


def identify(experiment: Experiment, local: np.ndarray | None = None, steps: np.ndarray | None = None,
             progress: Callable[[LoopState], None] = lambda state: None,
             motion: Mapping[str, np.ndarray] | None = None, searched: bool = False,
             estimator: str = ORDINARY, control: Control | None = None, begun: Path | None = None,
             foreseen: bool = False) -> Identification:
    """Identify the free parameters of an experiment whose image noise is known, in this process.

    Parameters
    ----------
    local : (n_frames, m) mm, optional
        Start of the frame-local unknowns (measured edges, noise of a logged grip); zero without it.
    steps : increments to follow (s), optional
        Otherwise those of the first accepted simulation are kept.
    progress : called with the first state, and with the state after every evaluation
    motion : per camera (n_frames, n_nodes, 2) px, NaN where unknown, optional
        The first of two steps, where it has been made; otherwise a free FE-DIC makes it.
    searched : whether the start was found from far (`idic.identification.start_search`)
    estimator : to begin with; "generalised" only from a start within a few standard deviations of the answer
    control : tolerances and limits of every increment, those of `idic.fe` by default; not of an external solver
    begun : a simulation of the start or of a point near it, whose increments are followed
    foreseen : points so near to a simulated one that first order tells their motions are not simulated
        (`idic.identification.kept_simulation`)

    Raises
    ------
    InputError
        If the noise of the images is not known, or the experiment makes no model.
    """
    setup = _prepare(experiment, motion)
    if control is not None and isinstance(setup.forward, ForwardModel):
        setup = replace(setup, forward=replace(setup.forward, control=control))
    local = np.zeros((experiment.model.n_frames, setup.forward.drives.n_local)) if local is None else local
    if begun is not None and begun.moving == setup.moving and begun.local.shape == local.shape:
        first = _Point(None, local, begun.steps, begun)
    else:
        first = _Point(None, local, steps)
    setup = replace(setup, foreseen=foreseen and isinstance(setup.forward, ForwardModel))
    points = _points(setup, start(experiment, searched, estimator), first)
    state = run_loop(points, progress=progress)
    end = points.point
    if end.path is not None and end.path.origin is not None and not _is_told(setup, end, state.accepted.values):
        state, end = _continued(setup, state, end, progress)
    return Identification(experiment, setup.forward, state, end.evaluation, end.local, end.steps, setup.weights,
                          end.path)


def _points(setup: _Setup, state: LoopState, first: _Point) -> MemoryPoints:
    return MemoryPoints(setup.experiment, setup.weights.image_noise, state, first, partial(_next_point, setup))


def _continued(setup: _Setup, state: LoopState, end: _Point,
               progress: Callable[[LoopState], None]) -> tuple[LoopState, _Point]:
    """The search from an end that first order alone has told, simulated there; that end where this finds none."""
    parameters = setup.experiment.model.parameters.with_starts(state.accepted.values)
    experiment = replace(setup.experiment, model=replace(setup.experiment.model, parameters=parameters), stages=())
    restart = start(experiment, True, state.estimator.kind if state.generalised else ORDINARY)
    points = _points(replace(setup, experiment=experiment), restart,
                     _Point(None, end.local, end.steps, end.path.origin))
    later = run_loop(points, progress=progress)
    if points.point.evaluation is None:
        return state, end
    return replace(later, evaluations=state.evaluations + later.evaluations,
                   history=(*state.history, *later.history)), points.point


@dataclass(frozen=True)
class _Point:
    """An evaluated point with its frame-local unknowns (n_frames, m) mm, increments (s) and simulation, where known."""

    evaluation: Evaluation | None
    local: np.ndarray
    steps: np.ndarray | None
    path: Path | None = None


def _next_point(setup: _Setup, trial: LoopState, accepted: _Point) -> _Point:
    local = accepted.local
    if accepted.evaluation is not None:
        local = next_local(trial, accepted.evaluation, local, setup.experiment.model.parameters.free)
    steps = None if trial.trial.new_increments else accepted.steps
    evaluation, steps, path = _evaluate(setup, trial, local, steps, _begun_at(setup, trial, accepted, local, steps))
    return _Point(evaluation, local, steps, path)


def _begun_at(setup: _Setup, trial: LoopState, accepted: _Point, local: np.ndarray,
              steps: np.ndarray | None) -> Path | None:
    """The simulation that a trial begins at: of the accepted point, or the trial's own where first order tells it."""
    path, evaluation, values = accepted.path, accepted.evaluation, trial.trial.values
    if not setup.foreseen or None in (path, evaluation) or steps is None or path.is_at(values, local, steps):
        return path
    lack = _second_order_std(setup, accepted, values, path)
    return path.foreseen_at(values, local) if lack <= MAX_SECOND_ORDER_STD_ON_THE_WAY else path


def _second_order_std(setup: _Setup, accepted: _Point, values: Mapping[str, float], path: Path) -> float:
    """What first order lacks at other values (`Path.second_order_std`), by the equations of the accepted point."""
    evaluation = accepted.evaluation
    noise = evaluation.system.spread + setup.weights.image_noise**2 * evaluation.reference_gram
    information = evaluation.system.M @ np.linalg.pinv(noise, hermitian=True) @ evaluation.system.M
    return path.second_order_std(values, evaluation.system.names, information)


def _is_told(setup: _Setup, end: _Point, values: Mapping[str, float]) -> bool:
    """Whether first order tells the end of a search: it lacks little, and no law with a memory hands on what the
    unknowns of a frame have moved."""
    hands_on = setup.forward.drives.n_local and setup.experiment.model.path_dependent_laws
    return not hands_on and _second_order_std(setup, end, values, end.path) <= MAX_SECOND_ORDER_STD


def evaluate_at(experiment: Experiment, values: Mapping[str, float], local: np.ndarray,
                generalised: bool = False, increments: int | None = None) -> tuple[Evaluation, Weights]:
    """The system of one point on all images as the experiment has them, without a step from it, and the weights
    behind it.

    For the images of a stage of its schedule give the experiment as the stage sees it
    (`idic.identification.loop.experiment_of`).

    values : internal units; local : (n_frames, m) mm, frame-local unknowns; generalised : least squares; increments :
    per frame, extrapolated in time, None: those of the options
    """
    experiment = replace(experiment, stages=())
    setup = _prepare(experiment)
    state = replace(start(experiment), trial=Trial(dict(values)),
                    estimator=EstimatorChoice(GENERALISED if generalised else ORDINARY),
                    increments=IncrementChoice(increments))
    return _evaluate(setup, state, local, None)[0], setup.weights


@dataclass(frozen=True)
class _Setup:
    experiment: Experiment
    forward: ForwardModel
    moving: tuple[str, ...]
    weights: Weights
    references: dict  # per camera: the attached reference image where camera and mesh were last
    motions: Mapping[str, np.ndarray]  # per camera: (n_frames, n_nodes, 2) px, of the first of two steps
    foreseen: bool = False  # whether points near a simulated one are not simulated


def _prepare(experiment: Experiment, motion: Mapping[str, np.ndarray] | None = None) -> _Setup:
    if experiment.options.weighting != "noise":
        raise InputError("only weighting by noise is done without a RUN folder", key="[options] weighting",
                         expected='"noise"', found=repr(experiment.options.weighting),
                         remedy="identify it into a RUN folder: idic.identify(..., out=...)")
    forward = build_forward(experiment)
    moving = tuple(name for name in experiment.model.parameters.free if forward.moves(name))
    check_method(experiment)
    if experiment.options.is_two_step and motion is None:
        motion = {view.recording.camera_name: measure(view) for view in experiment.views}
    return _Setup(experiment, forward, moving, noise_weights(experiment), {}, motion or {})


def _evaluate(setup: _Setup, state: LoopState, local: np.ndarray, steps: np.ndarray | None,
              path: Path | None = None) -> tuple[Evaluation, np.ndarray | None, Path | None]:
    """Simulate and correlate the trial frame by frame, with the increments of the accepted point where they hold.

    path : the accepted point's simulation: this one begins at it, or is it where only weights or images have changed
    """
    experiment, forward = experiment_of(setup.experiment, state), setup.forward
    try:
        parameters = experiment.model.parameters.with_values(state.trial.values)
        context = _context(replace(setup, experiment=experiment), parameters, state.generalised)
    except NotConverged as failure:  # a mesh that does not follow its geometry
        return Evaluation(state.evaluations, None, None, str(failure)), None, None
    problem: NotConverged | None = None
    times = experiment.model.times[experiment.model.reference:]
    for frozen in tried_increments(forward, times, state.increments.per_frame, steps):
        try:
            keeper = PathKeeper(1 + experiment.options.trial_steps)
            responses = keeper.passed_on(_responses(setup, context.parameters, local, frozen, path,
                                                    state.increments.per_frame))
            system = streamed_system(context, responses, local)
            evaluation = closed_evaluation(state.evaluations, context, forward, system, len(keeper.steps))
            values = context.parameters.as_values()
            simulated = keeper.path(values, local, setup.moving)
            if simulated is not None and path is not None and path.is_at(values, local, keeper.steps):
                simulated = replace(simulated, origin=path.origin)  # which is another one where the point was foreseen
            return evaluation, np.array(keeper.steps), simulated
        except NotConverged as failure:
            problem = failure
            if isinstance(failure, GaveUp):
                break
    return Evaluation(state.evaluations, None, None, str(problem)), None, None


def _responses(setup: _Setup, parameters: ParameterSet, local: np.ndarray, steps: Sequence[float] | None,
               path: Path | None,
               increments: int | None) -> Iterator[tuple[FrameResponse, Sequence[float] | np.ndarray]]:
    """Every frame of the simulation, and the increments (s) so far; of a known point without simulating it."""
    forward, values = setup.forward, parameters.as_values()
    if increments == HALF_RATE:
        yield from _without_time_error(forward, parameters, local, path)
        return
    if path is not None and path.is_at(values, local, steps):
        for response in path.frames:
            yield response, path.steps
        return
    prediction = None if path is None else path.predicted_at(values, local)
    for at in forward.march(parameters, setup.moving, local, steps, forward.drives.n_local > 0, prediction,
                            increments=increments):
        yield FrameResponse.of(at, setup.experiment.model.reference), at.steps.times


def _without_time_error(forward: ForwardModel, parameters: ParameterSet, local: np.ndarray,
                        path: Path | None) -> Iterator[tuple[FrameResponse, np.ndarray]]:
    """Every frame of the known simulation of this point, extrapolated in time; its derivatives are kept."""
    if path is None or not path.is_at(parameters.as_values(), local, path.steps):
        raise NotConverged("the simulation of the accepted point was not kept")
    moved = forward.without_time_error(parameters, local, lambda: ((at.u, at.channels) for at in path.frames))
    for response, (u, channels) in zip(path.frames, moved, strict=True):
        yield replace(response, u=u, channels=channels), path.steps


def _context(setup: _Setup, parameters: ParameterSet, generalised: bool) -> CorrelationContext:
    shape = tuple(parameters[name].value for name in setup.forward.morphs)

    def attach(view: Experiment, camera: Camera) -> Reference:
        key = (*camera.values().values(), *shape, view.options.lowpass_px)
        if setup.references.get(view.recording.camera_name, (None,))[0] != key:
            image = build_experiment_reference(view, camera)
            motion = setup.motions.get(view.recording.camera_name)
            setup.references[view.recording.camera_name] = (
                key, image if motion is None else measured_reference(view, image, motion))
        return setup.references[view.recording.camera_name][1]

    weights = setup.weights.as_generalised() if generalised else setup.weights
    return point_context(setup.experiment, parameters, setup.forward, setup.moving, weights, attach)
