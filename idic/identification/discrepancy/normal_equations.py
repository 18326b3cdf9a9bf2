"""The normal equations of parameters and discrepancy together: the amplitudes of its fields are unknowns held at zero.

    [ M  A^T ] [ d lam ]   [ b ]
    [ A  G   ] [   a   ] = [ y ]                                                  (docs/method.md, equation 14.4)

All sums are those of the identification (weights, cameras, frame-local unknowns, the shared noise of the reference),
with the fields of `idic.identification.discrepancy.fields` as further columns.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from idic.correlation import CorrelationContext, FrameResponse, closed_system, frame_system, reduce_systems
from idic.fe import Alternative, Responses, stress_error_responses
from idic.identification.discrepancy.expansion import expanded
from idic.identification.discrepancy.fields import (
    MOTION_LENGTH, N_CHANNEL_COURSES, N_COURSES, STRESS_LENGTH, Hats, course_correlation, courses, field_correlation,
    hats_over, root_of,
)
from idic.identification.step.state import Evaluation
from idic.model import Experiment, ForwardModel, Model
from idic.parameters import ParameterSet
from idic.simulation_error import ErrorInFrames, ModelPoint, can_be_refined, mesh_error_in, strain_error_in

MOTION, STRESS, CHANNEL = "motion", "stress", "channel"
MESH, STRAINS = "mesh", "small strains"  # errors of known size
# of nodal arrays of all unknowns at a time; a factor of as many nodes of a solid takes more
MAX_BYTES, COPIES = 3e9, 12
STRESS_FRAMES = 6  # in which the answer to stress errors is computed; linear in between


@dataclass(frozen=True, eq=False)
class Component:
    """Amplitudes of one kind: fields of one variance.

    name : "motion", "stress" or "channel"; root : (q, q) of their correlation
    """

    name: str
    root: np.ndarray


@dataclass(frozen=True, eq=False)
class DiscrepancySystem:
    """The closed normal equations.

    names : the n parameters; M : (n + q, n + q), b : (n + q,), noise : (n + q, n + q) covariance of b, parameters in
    internal units, then the amplitudes of the components one after the other; motion_px : rms motion of the last frame,
    by the name of the component that it is the unit of; channel_rows : (n_frames, n_channels, n + q) derivatives of the
    simulated channels, None where they are not known; of several experiments: frames and channels of one after the
    other;
    mesh_error : (n + q,) the error of b by the mesh, None where it was not estimated (`idic.simulation_error`);
    mesh_size_only : whether its size alone is known, from a coarser mesh;
    may_be_rough : whether what is finer than the fields may count as noise does. Not on solids whose mesh error, which
    moves parameters by more than noise of that size would, is not estimated
    strain_error : (n + q,) the error of b by small strains, None where the laws have no finite form
    """

    names: tuple[str, ...]
    M: np.ndarray
    b: np.ndarray
    noise: np.ndarray
    components: tuple[Component, ...]
    motion_px: Mapping[str, float]
    channel_rows: np.ndarray | None = None
    mesh_error: np.ndarray | None = None
    may_be_rough: bool = True
    strain_error: np.ndarray | None = None
    mesh_size_only: bool = False

    @property
    def n(self) -> int:
        return len(self.names)


def reason_against(experiment: Experiment, point: Evaluation | None) -> str:
    """Why the discrepancy of a model is not estimated, "" where it is."""
    if point is None or point.system is None:
        return "no simulation converged"
    if experiment.recording.quantity == "height":
        return "height images: std counts noise alone"
    if experiment.options.is_two_step:
        return "the second of two steps compares with a measured motion: std counts noise alone"
    if 8.0 * COPIES * experiment.model.mesh.nodes.size * _n_unknowns(experiment.model) > MAX_BYTES:
        return "the mesh has too many nodes for the sums of a discrepancy: std counts noise alone"
    return "" if experiment.correlated_frames(range(experiment.model.n_frames)) else "no frame is compared"


def _n_unknowns(model: Model) -> int:
    """At most."""
    d, hats = model.n_dim, hats_over(model.mesh.nodes)
    return N_COURSES * hats.n * (d + d * (d + 1) // 2) + N_CHANNEL_COURSES * len(model.channels)


def discrepancy_system(context: CorrelationContext, forward: object, local: np.ndarray, u: Iterable[np.ndarray],
                       responses: Iterable[FrameResponse]) -> DiscrepancySystem:
    """Sum the normal equations at the accepted point.

    Parameters
    ----------
    context : of the point, with the weights of its estimator
    local : (n_frames, m) mm
    u : (n_nodes, d) mm of every frame after the reference
    responses : of the correlated frames, with the derivatives by ``context.moving``

    Raises
    ------
    NotConverged
        If the law finds no stress along the path.
    """
    experiment = context.experiment
    frames = experiment.correlated_frames(range(experiment.model.n_frames))
    fields = _Fields.of(context, forward, local, u, frames)
    wide = fields.among(context)
    names = (*context.names, *(f"discrepancy.{i}" for i in range(fields.n_unknowns + len(fields.errors))))
    rms_motion = [0.0]

    def systems() -> Iterator:
        for response in responses:
            rms_motion[0] = _rms_motion(response.u)
            equations = frame_system(wide, fields.beside(response), local[response.frame])
            yield expanded(equations, names, fields.into(len(context.names), response.frame))

    system, gram = closed_system(wide, reduce_systems(systems()))
    noise, rows = system.spread + context.weights.image_noise**2 * gram, [r.channel_columns for r in system.frames]
    size = len(context.names) + fields.n_unknowns  # the errors are columns beyond
    by_error = {name: system.M[:size, size + k] for k, name in enumerate(fields.errors)}
    M, noise = _symmetric(system.M[:size, :size]), _symmetric(noise[:size, :size])
    return DiscrepancySystem(context.names, M, system.b[:size], noise,
                             fields.components, {MOTION: rms_motion[0] / experiment.model.camera.pixel_size},
                             np.array(rows)[..., :size], by_error.get(MESH),
                             experiment.model.n_dim == 2 or MESH in by_error, by_error.get(STRAINS),
                             MESH in by_error and not can_be_refined(experiment.model))


def _symmetric(matrix: np.ndarray) -> np.ndarray:
    """Without what rounding has left beside the symmetry: a RUN keeps one triangle."""
    return 0.5 * (matrix + matrix.T)


def joined(parts: Mapping[str, DiscrepancySystem | str], free_names: Sequence[str],
           names: Mapping[str, Mapping[str, str]]) -> DiscrepancySystem | str:
    """The normal equations of several experiments in the parameters of all; each has a discrepancy of its own.

    Parameters
    ----------
    parts : per experiment, or why it has none
    free_names : parameters of the whole
    names : per experiment, {parameter of the experiment: parameter of the whole}
    """
    missing = [f"{name}: {part}" for name, part in parts.items() if isinstance(part, str)]
    if missing:
        return "; ".join(missing)
    n, systems = len(free_names), {name: part for name, part in parts.items() if not isinstance(part, str)}
    size = n + sum(len(part.b) - part.n for part in systems.values())
    M, noise, b = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size)
    first, components, rows, mesh_error, strains = n, [], [], np.zeros(size), np.zeros(size)
    for name, part in systems.items():
        n_fields = len(part.b) - part.n
        place = np.array([*(free_names.index(names[name][p]) for p in part.names), *range(first, first + n_fields)])
        if part.channel_rows is not None:
            rows.append(np.zeros((*part.channel_rows.shape[:2], size)))
            rows[-1][:, :, place] = part.channel_rows
        M[np.ix_(place, place)] += part.M
        noise[np.ix_(place, place)] += part.noise
        b[place] += part.b
        if part.mesh_error is not None:
            mesh_error[place] += part.mesh_error
        if part.strain_error is not None:
            strains[place] += part.strain_error
        components += [Component(f"{name}.{c.name}", c.root) for c in part.components]
        first += n_fields
    return DiscrepancySystem(tuple(free_names), M, b, noise, tuple(components),
                             {f"{name}.{key}": px for name, part in systems.items()
                              for key, px in part.motion_px.items()},
                             _one_after_the_other(rows) if len(rows) == len(systems) else None,
                             mesh_error if any(part.mesh_error is not None for part in systems.values()) else None,
                             all(part.may_be_rough for part in systems.values()),
                             strains if any(part.strain_error is not None for part in systems.values()) else None,
                             any(part.mesh_size_only for part in systems.values()))


def _one_after_the_other(rows: Sequence[np.ndarray]) -> np.ndarray:
    """Channel rows of several experiments; zero where a frame is not of the channel's experiment."""
    frames, channels = np.cumsum([[0, 0], *([len(block), block.shape[1]] for block in rows)], axis=0).T
    joint_rows = np.zeros((frames[-1], channels[-1], rows[0].shape[2]))
    for k, block in enumerate(rows):
        joint_rows[frames[k]:frames[k + 1], channels[k]:channels[k + 1]] = block
    return joint_rows


@dataclass(frozen=True, eq=False)
class _Fields:
    """The fields of an experiment, frame by frame.

    answers : per frame, the answer to stress errors, None with an external solver; errors : of known size, by name, as
    far as they are estimated
    """

    experiment: Experiment
    hats: Hats
    frames: Sequence[int]
    answers: dict[int, Responses] | None
    errors: Mapping[str, ErrorInFrames]

    @classmethod
    def of(cls, context: CorrelationContext, forward: object, local: np.ndarray, u: Iterable[np.ndarray],
           frames: Sequence[int]) -> _Fields:
        experiment = context.experiment
        hats = hats_over(experiment.model.mesh.nodes)
        answers, errors = None, {}
        if isinstance(forward, ForwardModel):
            spread = np.linspace(0, len(frames) - 1, min(STRESS_FRAMES, len(frames))).round().astype(int)
            chosen, motion = np.array(frames)[np.unique(spread)], {}
            answers = _stress_responses(forward, context.parameters, local,
                                        _recorded(u, experiment.model.reference + 1, set(chosen.tolist()), motion),
                                        chosen, hats)
            errors = errors_of_known_size(ModelPoint(replace(experiment, model=replace(experiment.model,
                                                                                       motion_error=None)),
                                                     context.parameters, local),
                                          motion)
        return cls(experiment, hats, frames, answers,
                   {name: error for name, error in errors.items() if error is not None})

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Numbers of motion fields, stress fields and channels."""
        d = self.experiment.model.n_dim
        return d * self.hats.n, (d * (d + 1) // 2 * self.hats.n if self.answers
                                 else 0), len(self.experiment.model.channels)

    @property
    def n_unknowns(self) -> int:
        motion, stress, channels = self.sizes
        return N_COURSES * (motion + stress) + N_CHANNEL_COURSES * channels

    @property
    def components(self) -> tuple[Component, ...]:
        d, (_, stress, channels) = self.experiment.model.n_dim, self.sizes
        components = [Component(MOTION, root_of(field_correlation(self.hats, d, MOTION_LENGTH)))]
        if stress:
            components.append(Component(STRESS, root_of(field_correlation(self.hats, d * (d + 1) // 2, STRESS_LENGTH))))
        if channels:
            alike = np.kron(np.eye(channels), course_correlation(N_CHANNEL_COURSES))
            components.append(Component(CHANNEL, root_of(alike)))
        return tuple(components)

    def among(self, context: CorrelationContext) -> CorrelationContext:
        """The context with a column per field and channel."""
        extra = tuple(f"discrepancy.{i}" for i in range(sum(self.sizes) + len(self.errors)))
        wide = replace(context, names=(*context.names, *extra), moving=(*context.moving, *extra))
        return replace(wide, others=tuple(replace(camera_context, names=wide.names, moving=wide.moving)
                                          for camera_context in context.others))

    def beside(self, response: FrameResponse) -> FrameResponse:
        """A frame with the fields as further derivatives."""
        (motion, stress, channels), (nodes, components), d = self.sizes, response.u.shape, self.experiment.model.n_dim
        fields, readings = np.zeros((nodes, components, sum(self.sizes))), np.zeros((channels, sum(self.sizes)))
        for axis in range(d):
            fields[:, axis, axis * self.hats.n:(axis + 1) * self.hats.n] = _rms_motion(response.u) * self.hats.values
        if stress:
            fields[:, :d, motion:motion + stress], readings[:, motion:motion + stress] = self._stress(response.frame)
        readings[:, motion + stress:] = np.diag(response.channels)
        for error in self.errors.values():
            u, reading = error.at(response.frame)
            fields, readings = np.concatenate([fields, u[..., None]], axis=2), np.hstack([readings, reading[:, None]])
        return replace(response, du=np.concatenate([response.du, fields], axis=2),
                       dchannels=np.hstack([response.dchannels, readings]))

    def _stress(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """The answer to stress errors, linear between the frames where it is known, zero in the reference."""
        frames = sorted(self.answers)
        later = next(k for k in frames if k >= frame)
        previous = max((k for k in frames if k < frame), default=self.experiment.model.reference)
        share = (frame - previous) / (later - previous)
        du, dchannels = share * self.answers[later].du, share * self.answers[later].dchannels
        if previous in self.answers:
            weight = 1.0 - share
            du = du + weight * self.answers[previous].du
            dchannels = dchannels + weight * self.answers[previous].dchannels
        return du, dchannels

    def into(self, n: int, frame: int) -> sparse.csc_array:
        """The amplitudes of a frame's columns of a unit of each unknown  # (n + fields, n + unknowns)"""
        motion, stress, channels = self.sizes
        at = self.frames.index(frame) / max(len(self.frames) - 1, 1)
        blocks = [sparse.eye_array(n),
                  sparse.kron(sparse.eye_array(motion + stress), courses(np.array([at]), N_COURSES))]
        if channels:
            blocks.append(sparse.kron(sparse.eye_array(channels), courses(np.array([at]), N_CHANNEL_COURSES)))
        if self.errors:
            blocks.append(sparse.eye_array(len(self.errors)))
        return sparse.csc_array(sparse.block_diag(blocks))


def counts_mesh_error(experiment: Experiment) -> bool:
    """Whether the error of the motion by the mesh is a column, as far as it can be made: of solids. In the plane a
    whole step on the finer mesh is cheap (`idic.identification.systematic.discretisation`)."""
    return experiment.options.weighting == "noise" and experiment.model.n_dim == 3


def errors_of_known_size(point: ModelPoint, displacements: Mapping[int, np.ndarray]) -> dict[str, ErrorInFrames | None]:
    """By the mesh and by small strains, as far as they are made.

    displacements : (n_nodes, d) mm of the frames in which they are computed, the last one included; linear in between
    """
    experiment = point.experiment
    frames = np.array([experiment.model.reference, *sorted(displacements)])
    motions = [np.zeros_like(experiment.model.mesh.nodes),
               *(displacements[frame][:, :experiment.model.n_dim] for frame in sorted(displacements))]
    of_mesh = {MESH: mesh_error_in(point, frames, motions)} if counts_mesh_error(experiment) else {}
    return of_mesh | {STRAINS: strain_error_in(point, frames, motions)}


def _stress_responses(forward: ForwardModel, parameters: ParameterSet, local: np.ndarray, u: Iterable[np.ndarray],
                      frames: np.ndarray, hats: Hats) -> dict[int, Responses]:
    """The answer to stress errors in some frames, other channels than reactions included."""
    start = forward.model.reference
    base = Alternative(forward.body_at(parameters, local), forward.law_values(parameters))
    times = forward.model.times[start:]
    responses = {}
    numbers = [int(frame) - start for frame in frames]
    in_plane = (frame_u[:, :forward.model.n_dim] for frame_u in u)
    for number, response in zip(numbers, stress_error_responses(base, times, in_plane, numbers, hats.values),
                                strict=True):
        if forward.readings is not None:
            moved = forward.readings.motion @ response.du.reshape(-1, response.du.shape[2])
            response = replace(response, dchannels=response.dchannels + moved)
        responses[start + number] = response
    return responses


def _recorded(u: Iterable[np.ndarray], first: int, frames: set[int],
              into: dict[int, np.ndarray]) -> Iterator[np.ndarray]:
    """The motion of the frames from `first` on as it is, with that of some of them written down."""
    for frame, motion in enumerate(u, start=first):
        if frame in frames:
            into[frame] = motion
        yield motion


def _rms_motion(u: np.ndarray) -> float:
    """Root mean square of a motion less its mean, mm  # (n_nodes, d)"""
    return float(np.sqrt(np.mean((u - u.mean(axis=0)) ** 2)))
