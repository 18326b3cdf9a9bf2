"""From the variants of candidates to columns: the change of images and channels by each.

Changes of law, load and motion are answered by one Newton step along the identified model's own path
(`idic.fe.response`), camera and channels by their derivatives. Where the enriched law at its null is not exactly the
identified one (a finite-strain law over a small-strain one), the null embedding is subtracted: a column shows the
physics and nothing else.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from idic.correlation import CorrelationContext, FrameResponse, channel_equations, global_columns, turned_response
from idic.diagnose.locate.freedoms import in_images
from idic.diagnose.physics.candidate import Candidate, Variant
from idic.diagnose.residual.evidence import Columns, joined, of_grey_values
from idic.diagnose.residual.grey_value_effects import columns_of_kind
from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.diagnose.screen.course_columns import timed, times_courses, unit_values
from idic.errors import NotConverged
from idic.fe import Alternative, Responses, first_responses
from idic.identification import Identification
from idic.model import Experiment, ForwardModel, Model, build_forward, is_camera_time

Load = Callable[[Mapping[str, Any]], Experiment]  # edits of experiment.toml -> the experiment
Gradients = dict[tuple[int, int], np.ndarray]  # deformation gradient at the nodes by frame and camera


@dataclass(frozen=True)
class ScoreColumn:
    """A column of the screening: which candidate, which of its variants, which of the variant's unknowns."""

    candidate: Candidate
    variant: Variant
    name: str


def score_columns(identification: Identification, residual: ResidualEvidence,
                  trials: Sequence[tuple[Candidate, Variant]],
                  load: Load) -> tuple[tuple[ScoreColumn, ...], Columns]:
    """The columns of all variants; direct ones have one per new degree of freedom, the others one.

    A variant whose law finds no answer along the path is left out.

    Raises
    ------
    NotConverged
        If the identified law finds none.
    """
    stepped = [(c, v) for c, v in trials if not v.direct and v.pixels is None]
    straight = [(c, v) for c, v in trials if v.direct and v.pixels is None]
    labels, parts = [], []
    gradients: Gradients = {}
    if stepped:
        stepped_labels, columns = _stepped(identification, residual, stepped, load, gradients)
        labels += stepped_labels
        parts += columns
    for c, v in straight:
        labels += [ScoreColumn(c, v, name) for name in v.new]
        parts.append(_direct(identification, residual, v, load, gradients))
    for c, v in trials:
        if v.pixels is not None and (columns := _of_grey_values(residual, v)).n:
            labels += [ScoreColumn(c, v, name) for name in columns.names]
            parts.append(columns)
    return tuple(labels), joined(*parts)


def _of_grey_values(residual: ResidualEvidence, variant: Variant) -> Columns:
    """One column per hat of the variant's kind and course in time; none where grey values take no part."""
    evidence, (kind, courses) = residual.evidence, variant.pixels
    if not evidence.pixel_names:
        return residual.null.pick([])
    mean = float(np.mean([camera.grey_values.mean() for camera in residual.cameras]))
    ways = columns_of_kind(evidence.pixel_names, kind, mean)
    pixels = np.einsum("ct,kn->tkcn", courses[:, evidence.frames], ways).reshape(len(evidence.frames), len(ways), -1)
    names = tuple(f"{variant.label}, place {i + 1} of {ways.shape[1]}" for _ in courses for i in range(ways.shape[1]))
    return of_grey_values(names, len(evidence.seen), residual.channels.shape[1], pixels)


def _stepped(identification: Identification, residual: ResidualEvidence, trials: Sequence[tuple[Candidate, Variant]],
             load: Load,
             gradients: Gradients) -> tuple[list[ScoreColumn], list[Columns]]:
    """Columns of the variants that have an answer: one-step responses of their probes less those of their null
    embeddings; of patterns times courses (`idic.diagnose.screen.course_columns`), behind them, one response per
    pattern."""
    answers, moved, untimed, shared, idle = _Answers(identification), [], [], [], {}
    for candidate, variant in trials:
        experiment = load(variant.edits)
        if (timed_variant := timed(experiment, variant)) is not None:
            shared.append((candidate, timed_variant))
            continue
        alike = idle.setdefault((candidate.name, variant.new), {name: variant.null[name] for name in variant.idle})
        untimed.append((candidate, variant, answers.position(experiment, variant.probe),
                        None if variant.exact else answers.position(experiment, {**variant.null, **alike})))
        moved.append(_node_motion(experiment.model, variant))
    first = {timed_variant.pattern: timed_variant for _, timed_variant in reversed(shared)}
    of_patterns = [answers.position(timed_variant.unit, unit_values(timed_variant)) for timed_variant in first.values()]
    start = identification.experiment.model.reference
    frames = [int(k) - start for k in residual.evidence.frames]
    responses = first_responses(answers.base, identification.experiment.model.times[start:], frames, residual.solved_u,
                                answers.others)
    picked = [i for _, _, i, _ in untimed] + of_patterns
    nulls = [k for k, (_, _, _, null) in enumerate(untimed) if null is not None]
    of_nulls = [untimed[k][3] for k in nulls]
    simulations = {k: moved_to for k, (_, variant, _, _) in enumerate(untimed)
                   if not variant.new and (moved_to := _simulated(load(variant.edits), identification)) is not None}
    error = identification.experiment.model.motion_error
    solved = residual.channels if error is None else residual.channels - error.channels[residual.evidence.frames]
    n, n_columns = len(untimed), len(picked)
    fields = np.empty((len(frames), len(residual.evidence.seen), n_columns))
    channels = np.empty((len(frames), residual.channels.shape[1], n_columns))
    answered = np.ones(n_columns, dtype=bool)
    for t, answer in enumerate(responses):
        read = answers.read(int(residual.evidence.frames[t]), answer)
        du, dchannels = answer.du[..., picked], read[:, picked]
        du[..., nulls] -= answer.du[..., of_nulls]
        _to_fixed_points(identification.experiment.model, residual, t, moved, du)
        dchannels[:, nulls] -= read[:, of_nulls]
        for k, (u, readings) in simulations.items():
            du[..., k], dchannels[:, k] = u[frames[t]] - residual.solved_u[t], readings[frames[t]] - solved[t]
        fields[t], channels[t] = in_images(residual, t, du), dchannels
        answered &= ~np.isnan(fields[t].sum(axis=0) + channels[t].sum(axis=0))
    answered_trials = [k for k in range(n) if answered[k]]
    of_trials = slice(n) if len(answered_trials) == n else answered_trials
    labels = [ScoreColumn(untimed[k][0], untimed[k][1], untimed[k][1].label) for k in answered_trials]
    columns = _with_recording(identification, residual, [untimed[k][1] for k in answered_trials], load, Columns(
        tuple(label.name for label in labels), fields[..., of_trials], channels[..., of_trials]), gradients)
    labels += [ScoreColumn(candidate, timed_variant.variant, name) for candidate, timed_variant in shared
               for name in timed_variant.names]
    if not shared:
        return labels, [columns]
    return labels, [columns, times_courses([timed_variant for _, timed_variant in shared], list(first),
                                           residual.evidence.frames, fields[..., n:], channels[..., n:])]


def _simulated(experiment: Experiment, identification: Identification) -> tuple[np.ndarray, np.ndarray] | None:
    """Motion (n, n_nodes, dim) and channels (n, n_channels) from the reference on, of a model without an unknown of its
    own; None where it finds no answer.

    One Newton step tells three times the stiffening of a beam whose ends cannot approach each other: the model is
    simulated.
    """
    forward = build_forward(replace(experiment, model=replace(experiment.model, motion_error=None)))
    if not isinstance(forward, ForwardModel):
        return None
    values = experiment.model.parameters.own_of(identification.parameters.as_values())
    try:
        states = [(state.u.copy(), state.channels.copy()) for state in forward.march(
            experiment.model.parameters.with_values(values), (), identification.local, identification.steps,
            may_cut=True)]
    except NotConverged:
        return None
    return np.array([u for u, _ in states]), np.array([channels for _, channels in states])


class _Answers:
    """The models whose responses are asked for, each once."""

    def __init__(self, identification: Identification):
        self.identification, self.values = identification, identification.parameters.as_values()
        self.base, self.loads = _alternative(identification.experiment, identification, {})
        self.others: list[Alternative] = []
        self.loads_of_others: list[np.ndarray] = []
        self.place: dict[bytes, int] = {}

    def position(self, experiment: Experiment, at: Mapping[str, float]) -> int:
        """Place among the others of an experiment at the identified values and these."""
        model = experiment.model
        values = model.parameters.own_of(self.values)
        parameters = model.parameters.with_values(values | dict(at))
        key = pickle.dumps((model.materials, model.prescribed, model.loads, model.temperatures,
                            model.heterogeneities, model.cracks, sorted(parameters.as_values().items())))
        if key not in self.place:
            self.place[key] = len(self.others)
            alternative, loads = _alternative(experiment, self.identification, parameters.as_values())
            self.others.append(alternative)
            self.loads_of_others.append(loads)
        return self.place[key]

    def read(self, frame: int, answer: Responses) -> np.ndarray:
        """Change of all channels in a frame, extensometers and pressures included  # (n_channels, n_others)"""
        forward = self.identification.forward
        readings = forward.readings if isinstance(forward, ForwardModel) else None
        if readings is None:
            return answer.dchannels
        moved = readings.motion @ answer.du.reshape(readings.motion.shape[1], -1)
        pressed = np.zeros((readings.load.shape[1], len(self.others)))
        for k, loads in enumerate(self.loads_of_others):
            if loads.shape == self.loads.shape:
                pressed[:, k] = loads[frame] - self.loads[frame]
        return answer.dchannels + moved + readings.load @ pressed


def _node_motion(model: Model, variant: Variant) -> np.ndarray | None:
    """Motion of the nodes (n_nodes, dim) mm from a variant's null to its probe; None where its mesh stays."""
    motions = [model.turned(morph.velocity) * (variant.probe[morph.name] - variant.null[morph.name])
               for morph in model.morphs if morph.name in variant.new]
    return np.sum(motions, axis=0) if motions else None


def _to_fixed_points(model: Model, residual: ResidualEvidence, t: int, moved: Sequence[np.ndarray | None],
                     du: np.ndarray) -> None:
    """Responses at nodes that move become those at fixed points of the body, in place (docs/method.md, equation 5.5).

    t : frame of the evidence; du : (n_nodes, dim, n), without the thickness change before a lens
    """
    if all(motion is None for motion in moved):
        return
    gradient = model.nodal_gradient(residual.u[t])
    for k, motion in enumerate(moved):
        if motion is not None:
            du[..., k] -= np.einsum("nij,nj->ni", gradient[:, :du.shape[1]], motion) - motion


def _with_recording(identification: Identification, residual: ResidualEvidence, variants: Sequence[Variant], load: Load,
                    stepped: Columns, gradients: Gradients) -> Columns:
    """What the probes change between simulation and record (camera, scale of a channel, time of the log) on top, in
    place."""
    fields, channels = stepped.fields, stepped.channels
    stems = ("channel.", "time.", *(f"{view.recording.camera_name}." for view in identification.experiment.views))
    for k, variant in enumerate(variants):
        names = tuple(name for name in variant.new if name.startswith(stems))
        if names:
            way = np.array([variant.probe[name] - variant.null[name] for name in names])
            straight = _direct(identification, residual, replace(variant, new=names), load, gradients)
            fields[..., k] += straight.fields @ way
            channels[..., k] += straight.channels @ way
    return stepped


def _alternative(experiment: Experiment, identification: Identification,
                 values: Mapping[str, float]) -> tuple[Alternative, np.ndarray]:
    """A model whose response is asked for, and the histories of its loads  # (n_frames, n_loads)"""
    forward = build_forward(experiment)
    parameters = experiment.model.parameters.with_values(values or identification.parameters.as_values())
    local = identification.local if forward.drives.n_local == identification.local.shape[1] else None
    return (Alternative(forward.body_at(parameters, local), forward.law_values(parameters)),
            forward.drives.loads.values(parameters))


def _direct(identification: Identification, residual: ResidualEvidence, variant: Variant, load: Load,
            gradients: Gradients) -> Columns:
    """Derivatives of camera and channels at the null values."""
    experiment = load(variant.edits)
    values = experiment.model.parameters.own_of(identification.parameters.as_values())
    parameters = experiment.model.parameters.with_values(values | dict(variant.null))
    base = replace(identification.experiment, model=replace(identification.experiment.model, parameters=parameters,
                                                            channels=experiment.model.channels))
    late = tuple(name for name in variant.new if is_camera_time(name))
    contexts = [replace(_with_motion(camera.context, base, experiment), moving=late) for camera in residual.cameras]
    n_seen, n_channels = len(residual.evidence.seen), residual.channels.shape[1]
    fields = np.zeros((len(residual.u), n_seen, len(variant.new)))
    channels = np.zeros((len(residual.u), n_channels, len(variant.new)))
    for t, frame in enumerate(residual.evidence.frames):
        shape = residual.u[t].shape
        nothing = np.zeros((len(residual.channels[t]), 0))
        velocities = np.repeat(_velocity(residual, t)[..., None], len(late), axis=-1)
        response = FrameResponse(int(frame), residual.u[t], residual.channels[t], velocities,
                                 np.zeros((len(nothing), len(late))), np.zeros((*shape, 0)), nothing)
        places = [i for i, name in enumerate(variant.new) if _concerns(name, int(frame))]
        names = tuple(variant.new[i] for i in places)
        columns = []
        for number, context in enumerate(contexts):
            camera_response = turned_response(context.experiment.model, response)
            if (t, number) not in gradients and any(name.startswith(f"{context.experiment.recording.camera_name}.")
                                                    for name in names):
                gradients[t, number] = context.experiment.model.nodal_gradient(camera_response.u)
            columns.append(global_columns(replace(context, names=names), camera_response, gradients.get((t, number))))
        fields[t][:, places] = np.concatenate(columns)[residual.evidence.seen]
        channels[t][:, places] = channel_equations(replace(contexts[0], names=names), response).d_global
    return Columns(variant.new, fields, channels)


def _velocity(residual: ResidualEvidence, t: int) -> np.ndarray:
    """Of the nodes, since the frame that is compared before, or the reference  # (n_nodes, dim) mm/s"""
    model, frames = residual.context.experiment.model, residual.evidence.frames
    earlier, u = (frames[t - 1], residual.u[t - 1]) if t else (model.reference, np.zeros_like(residual.u[t]))
    return (residual.u[t] - u) / (model.times[frames[t]] - model.times[earlier])


def _with_motion(context: CorrelationContext, base: Experiment, enriched: Experiment) -> CorrelationContext:
    """The context of a camera with the parameters and channels of `base`, and the motion that `enriched` gives it."""
    name = context.experiment.recording.camera_name
    view_of_camera = next(view for view in base.views if view.recording.camera_name == name)
    motion = next(view.model.camera.motion for view in enriched.views if view.recording.camera_name == name)
    return replace(context, camera=replace(context.camera, motion=motion), experiment=view_of_camera,
                   parameters=base.model.parameters, moving=())


def _concerns(name: str, frame: int) -> bool:
    """Whether a degree of freedom acts in this frame: `camera.col_at[3]` acts in frame 3 alone."""
    return "_at[" not in name or name.endswith(f"_at[{frame}]")
