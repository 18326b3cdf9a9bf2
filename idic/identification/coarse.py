"""A coarse fit from far: to the motion measured by a free FE-DIC, and to the channels.

The images tell a motion to a hundredth of a pixel, but nothing of one that is wrong by more than the grain of their
pattern: from there the residual falls towards any local minimum. A measured motion is compared node by node, however
far the simulated one is off; it needs no image, so that a fit costs its simulations alone.

    phi = sum_t sum_nodes |u_measured - u|^2 / s^2 + sum_t (F_measured - F)^2 / s_F^2

The standard deviation of the motion of a node is about what the regularisation of the measurement leaves,
`MOTION_STD_PX`; that of a channel is a share of its largest value. Both are far above the noise: the fit is a start,
not an answer. Fewer frames therefore do, and a mesh of fewer elements whose nodes are among those of the given one,
where there is such a mesh (`idic.fe.Coarse`).

A simulation that breaks down is compared up to there and stands still afterwards: the frames before tell where to step,
and a fit that gets farther is the better one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from idic.correlation import (
    CorrelationContext, CorrelationSystem, FrameEquations, FrameResponse, Weights, camera_at, channel_equations, dense,
    eliminate, global_columns, reduce_systems, view_of,
)
from idic.errors import NotConverged
from idic.fe import Coarse, Control
from idic.identification.driver import MemoryPoints, run_loop
from idic.identification.free_motion.free_motion_start import measured_start
from idic.identification.loop import start
from idic.identification.step.schedule import first_free
from idic.identification.step.state import Evaluation, LoopState
from idic.model import (
    Experiment, ForwardModel, Model, Parametrised, Stage, build_forward, selected_frames, tried_increments,
)
from idic.parameters import ParameterSet

MOTION_STD_PX = 0.5
CHANNEL_STD_SHARE = 0.01  # of a channel's largest value
MAX_FRAMES = 50  # simulated; a neck that is a pixel off does no harm here
MIN_FRAMES = 5  # with the reference: a simulation that breaks down earlier gives no direction
FAST_FAILURE = Control(smallest_cut=1 / 64, most_failures=8)  # a simulation that breaks down ends at once
COARSE_ELEMENTS = 200  # of the coarse mesh, about; a neck is off by another pixel


@dataclass(frozen=True)
class CoarseFit:
    """The end of a coarse fit: values of all parameters (internal units) and their functional.

    phi : functional, infinite where no simulation converged; points : number of measured values; part : simulated part
    of the test, 1 where the simulation did not break down
    """

    values: Mapping[str, float]
    phi: float
    points: int
    evaluations: int
    part: float = 1.0

    @property
    def misfit(self) -> float:
        """Root of the functional per measured value: 1 is half a pixel, and a hundredth of the channels."""
        return float(np.sqrt(self.phi / max(self.points, 1)))

    @classmethod
    def of(cls, experiment: Experiment, u_px: np.ndarray | None, values: Mapping[str, float],
           evaluations: int, simplified: bool = False) -> CoarseFit:
        """Identify the free parameters by measured motion and channels, for so many evaluations at most.

        Parameters
        ----------
        u_px : (n_frames, n_nodes, 2) px of the main camera, NaN where nothing was measured; None: channels alone
        values : where to begin, internal units
        simplified : on a mesh of fewer elements
        """
        parameters = experiment.model.parameters.with_free(first_free(experiment))  # the others keep their values
        setup = _prepare(experiment.with_parameters(parameters), u_px, simplified)
        start_values = {**setup.experiment.model.parameters.as_values(), **values}
        options = replace(setup.experiment.options, max_iterations=evaluations, estimator="ordinary", schedule="all",
                          search="never", step_limit=None, trial_steps=1)
        start_experiment = setup.experiment.with_parameters(setup.experiment.model.parameters.with_values(start_values))
        setup = replace(setup, experiment=replace(start_experiment, stages=(Stage("all"),), options=options))
        points = MemoryPoints(setup.experiment, setup.weights.image_noise, start(setup.experiment),
                              _Point(None, None, 0.0), partial(_evaluate, setup))
        state, end = run_loop(points), points.point
        if end.evaluation is None:
            return cls(start_values, np.inf, setup.points, state.evaluations, 0.0)
        return cls(state.accepted.values, end.evaluation.system.phi, setup.points, state.evaluations, end.part)


@dataclass(frozen=True)
class _Setup:
    """u_px : (n_frames, n_nodes, 2) NaN where unknown, of the simulated frames; local : (n_frames, m) mm, motion of
    measured edges, zero elsewhere."""

    experiment: Experiment
    forward: ForwardModel
    moving: tuple[str, ...]
    u_px: np.ndarray
    local: np.ndarray
    weights: Weights
    points: int


@dataclass(frozen=True)
class _Point:
    """An evaluated point: the increments of its simulation, None where that broke down, and the part of the test."""

    evaluation: Evaluation | None
    steps: np.ndarray | None
    part: float


def _prepare(experiment: Experiment, u_px: np.ndarray | None, simplified: bool) -> _Setup:
    if u_px is None:
        u_px = np.full((experiment.model.n_frames, experiment.model.mesh.n_nodes, 2), np.nan)
    frames = coarse_frames(experiment.model)
    if simplified or len(frames) < experiment.model.n_frames - experiment.model.reference:
        experiment = replace(experiment, options=replace(experiment.options, substeps=1))
    experiment, u_px = selected_frames(experiment, frames), u_px[frames]
    if simplified and (coarse := coarse_mesh(experiment.model)) is not None:
        experiment, u_px = experiment.on_coarse_mesh(coarse), u_px[:, coarse.nodes]
    u_px[[experiment.model.reference, *experiment.recording.excluded]] = np.nan
    forward = replace(build_forward(experiment), control=FAST_FAILURE)
    moving = tuple(name for name in experiment.model.parameters.free if forward.moves(name))
    local = np.zeros((experiment.model.n_frames, forward.drives.n_local))
    if np.isfinite(u_px).any():
        at_rest = u_px.copy()
        at_rest[experiment.model.reference] = 0.0
        local = measured_start(experiment, at_rest, experiment.recording.excluded)
    noises = np.array([CHANNEL_STD_SHARE * max(np.abs(channel.values).max(), 1e-300)
                       for channel in experiment.model.channels])
    weights = Weights(MOTION_STD_PX**-2, MOTION_STD_PX, noises**-2.0, noises)
    points = int(np.isfinite(u_px).sum()) + (experiment.model.n_frames - experiment.model.reference) * len(noises)
    return _Setup(experiment, forward, moving, u_px, local, weights, points)


def coarse_mesh(model: Model) -> Coarse | None:
    """A mesh of about `COARSE_ELEMENTS` for the experiment; None where there is none, or shapes on its nodes or
    cracks between them are parameters."""
    shaped = model.morphs or model.cracks or any(isinstance(entry.drive, Parametrised) for entry in model.prescribed)
    return None if shaped else Coarse.of(model.mesh, COARSE_ELEMENTS)


def coarse_frames(model: Model) -> list[int]:
    """The simulated frames: the reference and at most `MAX_FRAMES` evenly after it, with the last one."""
    if model.camera.motion is not None:
        return list(range(model.n_frames))  # its courses are known by the number of the frame
    first, end = model.reference, model.n_frames - 1
    number = min(end - first, MAX_FRAMES)
    return np.unique(np.rint(np.linspace(first, end, number + 1)).astype(int)).tolist()


def _evaluate(setup: _Setup, state: LoopState, accepted: _Point) -> _Point:
    experiment, forward = setup.experiment, setup.forward
    parameters = experiment.model.parameters.with_values(state.trial.values)
    context = CorrelationContext(
        experiment, parameters, experiment.model.parameters.free, setup.moving, camera_at(experiment, parameters), None,
        setup.weights, forward.drives.local_precision, local_scatter=forward.drives.local_scatter)
    times = experiment.model.times[experiment.model.reference:]
    farthest, problem = [], None
    for frozen in tried_increments(forward, times, None, accepted.steps):
        came, step_times, problem = _simulate(setup, parameters, frozen)
        farthest = max(farthest, came, key=len)
        if problem is None:
            break
    if problem is not None and len(farthest) < MIN_FRAMES:
        return _Point(Evaluation(state.evaluations, None, None, str(problem)), None, 0.0)
    still = [_standing(farthest[-1], frame) for frame in range(farthest[-1].frame + 1, experiment.model.n_frames)]
    system = reduce_systems([_frame(context, response, setup.u_px[response.frame], setup.local[response.frame])
                             for response in (*farthest, *still)])
    nothing = np.zeros((len(system.names),) * 2)
    increments = 0 if still else len(step_times)
    evaluation = Evaluation(state.evaluations, replace(system, shared=dense(system.shared)[:0]), nothing,
                            increments=increments)
    return _Point(evaluation, None if still else np.array(step_times), (len(farthest) - 1) / max(len(times) - 1, 1))


def _simulate(setup: _Setup, parameters: ParameterSet,
              frozen) -> tuple[list[FrameResponse], tuple, NotConverged | None]:
    """The frames that a simulation reaches, the reference first, its increments, and why it stopped (None: at the
    end)."""
    experiment, forward = setup.experiment, setup.forward
    came, step_times = [], ()
    try:
        for at in forward.march(parameters, setup.moving, setup.local, frozen, forward.drives.n_local > 0):
            step_times = at.steps.times
            came.append(FrameResponse(at.frame + experiment.model.reference, at.seen_u, at.channels, at.seen_du,
                                      at.dchannels,
                                      at.local_du, at.local_dchannels))
    except NotConverged as problem:
        return came, step_times, problem
    return came, step_times, None


def _standing(response: FrameResponse, frame: int) -> FrameResponse:
    """A later frame of a simulation that broke down: as the last one, `response`, independent of the parameters."""
    nothing = {name: np.zeros_like(getattr(response, name))
               for name in ("du", "dchannels", "local_du", "local_dchannels")}
    return replace(response, frame=frame, **nothing)


def _frame(context: CorrelationContext, response: FrameResponse, u_px: np.ndarray,
           local: np.ndarray) -> CorrelationSystem:
    """The contribution of a frame to M and b: nodes take the place of pixels; local : its own unknowns, mm"""
    experiment = context.experiment
    view = view_of(experiment, context.camera).at(response.frame)
    nodes = experiment.model.mesh.nodes
    columns = np.hstack([global_columns(context, response), view.columns(nodes, response.u, response.local_du)])
    gap = u_px.ravel() - view.motion(nodes, response.u)[:, :2].ravel()
    columns = columns.reshape(len(nodes), view.n_components, -1)[:, :2].reshape(2 * len(nodes), -1)
    is_measured = np.isfinite(gap)
    gap, columns = gap[is_measured], columns[is_measured]
    rows = FrameEquations(
        gram=columns.T @ columns, rhs=columns.T @ gap, rr=float(gap @ gap), shared=np.zeros((0, columns.shape[1])),
        kappa=1.0, channels=channel_equations(context, response), local_precision=context.local_precision,
        local_gap=-local,
        scatter=context.local_scatter)
    return eliminate(response.frame, context.names, rows, context.weights, len(gap), 0)
