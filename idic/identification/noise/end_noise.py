"""Measured ends of a linear body: the part of M that the noise of the ends makes (docs/method.md, section 8).

The motion of measured ends is estimated in every frame and bears noise. A derivative of the motion is linear in it, so
that M of noisy ends exceeds M of exact ones by N = sum_t tr[A^T P A Cov(e_t)], where A e is the derivative for the ends
e and P the weight less what frame-local unknowns take. N is found by the derivatives for ends that are drawn from
Cov(e).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from idic.correlation import (
    CorrelationContext, CorrelationSystem, FrameResponse, frame_equations, frame_system, local_covariance,
)
from idic.model import ForwardModel

N_DRAWS = 16  # N is known within 10 % then: a dozen shapes of the ends matter
DRAWN_SHARE = 1e-3  # of the diagonal of the body: the largest motion that is simulated; N is scaled back


def with_end_noise(system: CorrelationSystem, context: CorrelationContext, forward: object) -> CorrelationSystem:
    """The system of all frames with N, where measured fields tell the motion of ends of a linear body.

    Raises
    ------
    NotConverged
        If the body finds no equilibrium.
    """
    experiment = context.experiment
    if not (isinstance(forward, ForwardModel) and experiment.recording.quantity == "displacement" and context.moving
            and forward.drives.measured.any() and not experiment.model.loads and forward.body.is_linear
            and experiment.options.weighting == "noise"):
        return system
    frames = experiment.correlated_frames(range(experiment.model.n_frames))
    drawn = np.resize(np.array(frames)[np.linspace(0, len(frames) - 1, min(N_DRAWS, len(frames))).round().astype(int)],
                      N_DRAWS)
    around = _responses(forward, context, np.zeros((1, forward.drives.n_local)), frames[:1], None)[0]
    n = len(context.moving)
    around = replace(around, du=np.zeros((*around.u.shape, n)), dchannels=np.zeros((len(around.channels), n)))
    ends = _drawn_ends(context, around, drawn)
    size = DRAWN_SHARE * float(np.linalg.norm(np.ptp(experiment.model.mesh.nodes, axis=0))) / np.abs(ends).max()
    total = np.zeros_like(system.M)
    for response in _responses(forward, context, size * ends, drawn, around):
        total += frame_system(context, response, np.zeros(ends.shape[1])).M / size**2
    moves = np.isin(context.names, context.moving)
    total[~moves] = total[:, ~moves] = 0.0
    return replace(system, end_noise=len(frames) / N_DRAWS * total)


def _drawn_ends(context: CorrelationContext, around: FrameResponse, frames: Sequence[int]) -> np.ndarray:
    """Noise of the frame-local unknowns, a draw for each of these frames  # (n, m) mm"""
    rng = np.random.default_rng(0)
    drawn = []
    for frame in frames:
        equations = frame_equations(context, replace(around, frame=int(frame)), np.zeros(around.local_du.shape[2]))[1]
        values, vectors = np.linalg.eigh(local_covariance(equations, context.weights, len(context.names)))
        noise = vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(len(values)))
        drawn.append(noise[:around.local_du.shape[2]])
    return np.array(drawn)


def _responses(forward: ForwardModel, context: CorrelationContext, ends: np.ndarray, frames: Sequence[int],
               around: FrameResponse | None) -> list[FrameResponse]:
    """The answers, as of these frames, where nothing but the ends moves.

    ends : (n, m) mm; around : with the influence of the ends, None: find it
    """
    drives, n = forward.drives, len(ends) + 1
    nothing = np.zeros((n, drives.columns.shape[1]))
    still = replace(drives, columns=nothing, derivatives=dict.fromkeys(drives.derivatives, nothing),
                    loads=replace(drives.loads, columns=nothing[:, :0], rates=nothing[:, :0]))
    model = replace(forward.model, times=np.arange(n, dtype=float), reference=0, motion_error=None)
    temperature = None if forward.temperature is None else forward.temperature.unchanged(n)
    ends_only = replace(forward, model=model, drives=still, temperature=temperature)
    names = () if around is None else context.moving
    states = ends_only.march(context.parameters, names, np.vstack([0.0 * ends[:1], ends]), None, around is None)
    next(states)
    responses = []
    for frame, state in zip(frames, states, strict=True):
        local_du, local_dchannels = ((state.seen_local_du, state.local_dchannels) if around is None
                                     else (around.local_du, around.local_dchannels))
        responses.append(FrameResponse(int(frame), state.seen_u, state.channels, state.seen_du, state.dchannels,
                                       local_du, local_dchannels))
    return responses
