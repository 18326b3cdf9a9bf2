"""How well a planned test would tell models apart: the expected log-odds between each two, before a frame is taken.

Both models are simulated through the plan. What one shows beyond what the other could show with any values of its
parameters is the squared distance of the difference d of their data from the span of its sensitivities J,

    D = min over s of |d - J s|^2 in units of the noise,      expected log-odds = D / 2

with the noise of images (that of the reference in every frame), channels and logged motions, gain and offset of every
frame, and measured edges eliminated as in an identification: d is one more column beside J in the same sums. Of both
ways round the smaller D counts. D grows with every frame (T-optimality: Atkinson & Fedorov 1975,
doi 10.1093/biomet/62.1.57).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from idic.correlation import (
    CorrelationContext, CorrelationSystem, FrameResponse, build_experiment_reference, camera_at, channel_values,
    closed_system, frame_system, reduce_systems, view_of, with_all_cameras,
)
from idic.identification.judgement.basis import load_of_frames
from idic.identification.plan.planned_test import Plan
from idic.identification.weights import noise_weights
from idic.model import ForwardModel, build_forward, shown_value

LOG_ODDS_WANTED = float(np.log(99.0))  # 99:1
STOPS = 24  # numbers of frames at which the odds are evaluated
MAX_ROUNDING = 1e-6  # of the squared difference itself, in sums of single precision: no distance
MIN_EIGENVALUE = 1e-9  # of the scaled Gram of the parameters: a direction that the plan does not see


@dataclass(frozen=True)
class PairOdds:
    """Expected log-odds between two models after so many frames.

    names : of the two; frames : (k,) numbers of compared frames; log_odds : (k,) natural logarithm; load : (k,) share
    of the plan's largest load that these frames reach, None where nothing is logged
    """

    names: tuple[str, str]
    frames: np.ndarray
    log_odds: np.ndarray
    load: np.ndarray | None

    def content(self) -> dict:
        """For design.json: the odds of the whole plan, and the first frames that reach `LOG_ODDS_WANTED`."""
        reached = np.flatnonzero(self.log_odds >= LOG_ODDS_WANTED)
        at = int(reached[0]) if len(reached) else None
        return {"members": list(self.names), "log_odds": float(self.log_odds[-1]),
                "frames": None if at is None else int(self.frames[at]),
                "load": None if at is None or self.load is None else float(self.load[at]),
                "more_frames": None if at is not None or not self.log_odds[-1] > 0.0
                else float(LOG_ODDS_WANTED / self.log_odds[-1])}


def expected_odds(plans: Mapping[str, Plan]) -> list[PairOdds]:
    """The odds between each two models of one planned test.

    Parameters
    ----------
    plans : by the name of the model, each with its parameters at the values that it was fitted with; times, images and
        channels are the same

    Raises
    ------
    NotConverged
        If a model does not get through the plan.
    """
    members = {name: _Member.of(plan, [rival for rival in plans if rival != name]) for name, plan in plans.items()}
    experiment = next(iter(members.values())).context.experiment
    frames = experiment.correlated_frames(range(experiment.model.n_frames))
    stops = {frames[i] for i in np.linspace(0, len(frames) - 1, min(STOPS, len(frames))).astype(int)}
    totals: dict[str, CorrelationSystem] = {}
    distances: dict[tuple[str, str], list[float]] = {}
    for states in zip(*(member.march() for member in members.values()), strict=True):
        frame = states[0].frame + experiment.model.reference
        if frame not in frames:
            continue
        responses = {name: _response(frame, state) for name, state in zip(members, states, strict=True)}
        for name, member in members.items():
            system = member.system(responses, members)
            totals[name] = system if name not in totals else reduce_systems([totals[name], system])
            if frame in stops:
                for rival, distance in member.distances(totals[name]).items():
                    distances.setdefault((name, rival), []).append(distance)
    counts = np.array([n for n, frame in enumerate(frames, 1) if frame in stops])
    load = load_of_frames(experiment)
    reached = None if load is None else np.maximum.accumulate(load[frames])[counts - 1]
    return [PairOdds(pair, counts, 0.5 * np.minimum(distances[pair], distances[pair[::-1]]), reached)
            for pair in combinations(members, 2)]


def _response(frame: int, state) -> FrameResponse:
    return FrameResponse(frame, state.seen_u, state.channels, state.seen_du, state.dchannels, state.seen_local_du,
                         state.local_dchannels)


@dataclass(frozen=True, eq=False)
class _Member:
    """A model in the plan; context : with a column for the difference of each rival behind those of the parameters."""

    context: CorrelationContext
    forward: ForwardModel
    moving: tuple[str, ...]
    rivals: tuple[str, ...]
    local: np.ndarray

    @classmethod
    def of(cls, plan: Plan, rivals: list[str]) -> _Member:
        experiment = plan.experiment
        parameters = experiment.model.parameters
        forward = build_forward(experiment)
        moving = tuple(name for name in parameters.free if forward.moves(name))
        experiment = experiment.at_geometry(parameters)
        weights, camera = noise_weights(experiment), camera_at(experiment, parameters)
        if experiment.recording.quantity == "grey":  # elsewhere frames are weighed as independent
            weights = weights.as_generalised()
        columns = tuple(f"difference of {rival}" for rival in rivals)
        context = with_all_cameras(CorrelationContext(
            experiment, parameters, (*parameters.free, *columns), (*moving, *columns), camera,
            build_experiment_reference(experiment, camera), weights, forward.drives.local_precision,
            local_scatter=forward.drives.local_scatter))
        return cls(context, forward, moving, tuple(rivals), plan.local)

    def march(self) -> Iterator:
        return self.forward.march(self.context.parameters, self.moving, self.local,
                                  influence=self.forward.drives.n_local > 0)

    def system(self, responses: Mapping[str, FrameResponse], members: Mapping[str, _Member]) -> CorrelationSystem:
        """The sums of one frame, with the differences as columns."""
        base = next(responses[name] for name, member in members.items() if member is self)
        differences = [self._difference(base, members[rival], responses[rival]) for rival in self.rivals]
        response = replace(base, du=np.concatenate([base.du, *(u[..., None] for u, _ in differences)], axis=2),
                           dchannels=np.column_stack([base.dchannels, *(reading for _, reading in differences)]))
        return frame_system(self.context, response, self.local[base.frame])

    def _difference(self, base: FrameResponse, rival: _Member,
                    response: FrameResponse) -> tuple[np.ndarray, np.ndarray]:
        """What a rival shows less what this model shows, as motion (n_nodes, dim) mm and as readings (n_channels,)
        before the measuring chain of this model."""
        experiment, parameters = self.context.experiment, self.context.parameters
        readings = channel_values(experiment, parameters, base.channels, base.frame)
        of_rival = channel_values(rival.context.experiment, rival.context.parameters, response.channels, base.frame)
        slopes = np.array([shown_value(experiment, channel, parameters, base.frame, float(force)).slope
                           for channel, force in zip(experiment.model.channels, base.channels, strict=True)])
        return self._motion(base, rival, response), (of_rival - readings) / slopes.reshape(readings.shape)

    def _motion(self, base: FrameResponse, rival: _Member, response: FrameResponse) -> np.ndarray:
        """The motion that this camera would show as the difference in the image; in space with several cameras, and of
        heights."""
        gap = response.u - base.u
        view = view_of(self.context.experiment, self.context.camera).at(base.frame)
        if self.context.others or view.n_components != 2:
            return gap
        nodes = self.context.experiment.model.mesh.nodes
        rival_view = view_of(rival.context.experiment, rival.context.camera).at(base.frame)
        image_gap = rival_view.motion(nodes, response.u) - view.motion(nodes, base.u)  # (n_nodes, 2) px
        projected = view.columns(nodes, base.u, gap[:, :, None]).reshape(-1, 2)
        jacobian = np.asarray(view.jacobian(nodes, base.u))[:, :, :2]
        gap[:, :2] += np.linalg.solve(jacobian, (image_gap - projected)[:, :, None])[:, :, 0]
        return gap

    def distances(self, total: CorrelationSystem) -> dict[str, float]:
        """Squared distance of each rival's data from what the parameters of this model can show."""
        M = closed_system(self.context, total)[0].M
        n = len(M) - len(self.rivals)
        size = np.sqrt(np.maximum(np.diagonal(M)[:n], 1e-300))
        inverse = np.linalg.pinv(M[:n, :n] / np.outer(size, size), rcond=MIN_EIGENVALUE, hermitian=True)
        squares = {}
        for k, rival in enumerate(self.rivals, n):
            scaled = M[:n, k] / size
            square = M[k, k] - scaled @ inverse @ scaled
            squares[rival] = float(square) if square > MAX_ROUNDING * M[k, k] else 0.0
        return squares
