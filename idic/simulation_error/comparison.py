"""Two simulations of one test at one point, and their difference on the mesh of the first.

    e(x, t) = u_better(x, t) - u(x, t),      e_c(t) = F_c,better(t) - F_c(t)

Both take the same increments, so that their difference has no error of time, and no derivatives. In every frame they
take those of the model, or a few where it took many: a law with a memory may have asked the search for 64 in a frame.
The error of the time integration by few is nearly the same in two bodies that move nearly alike, and their difference
needs no more: bricks in hundreds of increments take half an hour. In a bent beam that yields, loaded and unloaded in
three frames, one per frame changes the difference of bricks by 2 % and that of a finer mesh by 4 %; 1 and 2,
extrapolated, by 1 and 2 %. Their work is three times that of one. In a few frames one increment leads from each to the
next, and the error is linear in between.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from idic.errors import NotConverged
from idic.fe import Control, FrameState
from idic.laws import get_law
from idic.model import Experiment, ForwardModel, MotionError, build_forward
from idic.parameters import ParameterSet

LOOSE = Control(tolerance=1e-5)  # of the forces, which an error of the simulation moves by 1e-3 and more
MAX_INCREMENTS = 3  # per frame, both of an extrapolation counted, of a law with time
MAX_INCREMENTS_WITHOUT_TIME = 1

Difference = Callable[[FrameState, FrameState], np.ndarray]


@dataclass(frozen=True, eq=False)
class ModelPoint:
    """A model at values of its parameters.

    experiment : without a known error; local : (n_frames, m) mm, frame-local unknowns; steps : ends of its increments,
    s, None: one per frame; motion : gives the displacements of every simulated frame at each call, (n_nodes, dim) mm,
    the reference first: first guesses, where the point or one near it has been simulated
    """

    experiment: Experiment
    parameters: ParameterSet
    local: np.ndarray | None
    steps: np.ndarray | None = None
    motion: Callable[[], Iterator[np.ndarray]] | None = None

    def guesses(self) -> Iterator[np.ndarray] | None:
        """First guesses of every simulated frame, None where there are none  # (n_nodes, dim) mm"""
        return None if self.motion is None else self.motion()


@dataclass(frozen=True, eq=False)
class BetterModel:
    """What a model is compared with at a point.

    local : (n_frames, m) mm, its frame-local unknowns; difference : of the motion of the two in a frame, that of the
    model first, (n_nodes, dim) mm on the mesh of the model; begins_alike : whether the motions of the model are its
    first guesses, of the same mesh: those carried to a finer one cost more iterations than they save
    """

    experiment: Experiment
    local: np.ndarray | None
    difference: Difference
    begins_alike: bool = False


@dataclass(frozen=True, eq=False)
class ErrorInFrames:
    """An error in some frames, linear in between.

    frames : (k,) the reference, where it is zero, and later ones; u : (k, n_nodes, components) mm; channels :
    (k, n_channels)
    """

    frames: np.ndarray
    u: np.ndarray
    channels: np.ndarray

    def at(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Motion and channels of a frame up to the last known one  # (n_nodes, components) mm, (n_channels,)"""
        k = int(np.searchsorted(self.frames, frame))
        if self.frames[k] == frame:
            return self.u[k], self.channels[k]
        share = (frame - self.frames[k - 1]) / (self.frames[k] - self.frames[k - 1])
        return (share * self.u[k] + (1.0 - share) * self.u[k - 1],
                share * self.channels[k] + (1.0 - share) * self.channels[k - 1])

    def in_every_frame(self, n_frames: int) -> MotionError:
        """Zero outside of the known frames."""
        u, channels = np.zeros((n_frames, *self.u.shape[1:])), np.zeros((n_frames, *self.channels.shape[1:]))
        for frame in range(self.frames[0], self.frames[-1] + 1):
            u[frame], channels[frame] = self.at(frame)
        return MotionError(u, channels)


def error_in_every_frame(point: ModelPoint, better: BetterModel) -> MotionError | None:
    """What the simulation at a point lacks of a better one, loosely solved; None where one of them finds no
    equilibrium."""
    experiment = point.experiment
    u = np.zeros((experiment.model.n_frames, *experiment.model.mesh.nodes.shape))
    channels = np.zeros((experiment.model.n_frames, len(experiment.model.channels)))
    steps = compared_increments(point)
    try:
        pair = (replace(_forward(test), control=LOOSE).march(point.parameters, (), local, steps, False,
                                                             point.guesses() if begins else None, may_cut=True)
                for test, local, begins in ((experiment, point.local, True),
                                            (better.experiment, better.local, better.begins_alike)))
        for state, better_state in zip(*pair, strict=True):
            frame = experiment.model.reference + state.frame
            u[frame] = better.difference(state, better_state)
            channels[frame] = better_state.channels - state.channels
    except NotConverged:
        return None
    return MotionError(u, channels)


def error_in_frames(point: ModelPoint, better: BetterModel, frames: np.ndarray,
                    *guesses: Iterable[np.ndarray]) -> ErrorInFrames | None:
    """The same in some frames, loosely solved; None where one of them finds no equilibrium.

    frames : the reference and later ones; guesses : (n_nodes, d) mm of each of them, of the model, then of the better
    one
    """
    first, guesses = point.experiment.model.reference, (*guesses, None, None)[:2]
    u, channels = [], []
    try:
        pair = (replace(_forward(test), control=LOOSE).march_at(point.parameters, local, frames - first, guess)
                for (test, local), guess in zip(((point.experiment, point.local), (better.experiment, better.local)),
                                                guesses, strict=True))
        for state, better_state in zip(*pair, strict=True):
            u.append(better.difference(state, better_state))
            channels.append(better_state.channels - state.channels)
    except NotConverged:
        return None
    return ErrorInFrames(frames, np.array(u), np.array(channels))


def compared_increments(point: ModelPoint) -> np.ndarray | None:
    """Ends of the increments of a comparison at a point, s: its own, or a few where it took many.

    A few are one per frame, of a law without time; 2 and 1, extrapolated (`idic.fe.extrapolation`), of another one.
    """
    ends = point.experiment.model.times[point.experiment.model.reference:]
    in_time = any(get_law(material.law).rate_dependent for material in point.experiment.model.materials)
    few = MAX_INCREMENTS if in_time else MAX_INCREMENTS_WITHOUT_TIME
    if point.steps is None or len(point.steps) < (few + 1) * (len(ends) - 1):  # one per frame, some of them cut
        return point.steps
    if not in_time:
        return ends[1:]
    halves = np.column_stack([0.5 * (ends[:-1] + ends[1:]), ends[1:]]).ravel()
    return np.concatenate([halves, ends[1:]])


def _forward(experiment: Experiment) -> ForwardModel:
    forward = build_forward(experiment)
    assert isinstance(forward, ForwardModel)  # an external solver has no better model
    return forward
