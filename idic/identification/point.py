"""From the simulated frames of a point to its M and b: one way, whether the frames come from memory or from a RUN.

A run adds the frames of a chunk in one task and the chunks in their order; in memory the frames are added in the same
groups, so that both end with the same bits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import chain, groupby

import numpy as np

from idic.correlation import (
    CorrelationContext, CorrelationSystem, FrameResponse, Reference, Weights, camera_at, closed_system, frame_system,
    reduce_systems, with_all_cameras,
)
from idic.errors import InputError, NotConverged
from idic.identification.noise.end_noise import with_end_noise
from idic.identification.step.state import Evaluation
from idic.images import Camera
from idic.model import Experiment, ForwardModel
from idic.parameters import ParameterSet

Attach = Callable[[Experiment, Camera], Reference]  # the reference of a view where its camera is


def point_context(experiment: Experiment, parameters: ParameterSet, forward: ForwardModel, moving: Sequence[str],
                  weights: Weights, attach: Attach) -> CorrelationContext:
    """The record that all frames of a point share: cameras and mesh where the parameters put them.

    moving : the free parameters that change the simulation

    Raises
    ------
    NotConverged
        If these parameters flatten an element, or a camera at its trial place does not see the mesh.
    """
    placed = experiment.at_geometry(parameters)
    camera = camera_at(placed, parameters)
    try:
        return with_all_cameras(CorrelationContext(
            placed, parameters, experiment.model.parameters.free, tuple(moving), camera, attach(placed, camera),
            weights, forward.drives.local_precision, local_scatter=forward.drives.local_scatter), attach)
    except InputError as error:  # that the start sees it was checked: it is the trial that is impossible
        raise NotConverged(f"{error.what}: {error.found}") from None


def chunk_frames(n_frames: int) -> int:
    """Frames that are added at a time; it depends only on the number of frames, so that the sums do not depend on the
    number of workers."""
    return int(np.clip(-(-n_frames // 16), 1, 16))


def chunk_system(context: CorrelationContext, responses: Iterable[FrameResponse],
                 local: np.ndarray) -> CorrelationSystem | None:
    """The sum over the correlated frames of a chunk; None where none of them is.

    local : (n_frames, m) mm, frame-local unknowns of all frames
    """
    systems = (frame_system(context, response, local[response.frame]) for response in responses
               if context.experiment.correlated_frames([response.frame]))
    first = next(systems, None)
    return None if first is None else reduce_systems(chain((first,), systems))


def streamed_system(context: CorrelationContext, responses: Iterable[FrameResponse],
                    local: np.ndarray) -> CorrelationSystem:
    """The sum over all frames, which come one at a time in their order; local : as of `chunk_system`"""
    size = chunk_frames(context.experiment.model.n_frames)
    sums = []
    for _, chunk in groupby(responses, lambda response: response.frame // size):
        system = chunk_system(context, chunk, local)
        if system is not None:
            sums.append(system)
    return reduce_systems(sums)


def closed_evaluation(number: int, context: CorrelationContext, forward: ForwardModel, system: CorrelationSystem,
                      increments: int) -> Evaluation:
    """The evaluation of a point out of the sum over its frames; increments : how many its simulation took

    Raises
    ------
    NotConverged
        As `with_end_noise`.
    """
    closed, gram = closed_system(context, system)
    return Evaluation(number, with_end_noise(closed, context, forward), gram, increments=increments)
