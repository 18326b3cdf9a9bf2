"""Which continuation of a test tells two models apart: both are simulated through a menu, the first that tells wins.

Both models are fitted to the recording in hand, where they do alike. The programme of the test is carried on, and what
they show then, less what the parameters of one of them could still imitate, is counted as chi-square with the weights
of the recording:

    D = min over steps d of |shown by one - shown by the other - J d|^2

D = 25 (five standard deviations) tells them apart reliably (T-optimality: Atkinson & Fedorov 1975,
doi 10.1093/biomet/62.1.57). The menu is in the order of effort.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from idic.correlation import FrameResponse, channel_equations, global_columns, turned_response
from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.residual.evidence import Columns, Evidence
from idic.diagnose.residual.residual_evidence import CameraResidual, ResidualEvidence, residual_evidence
from idic.diagnose.residual.score import null_model, score
from idic.errors import InputError, NotConverged
from idic.identification import Identification
from idic.images import Camera
from idic.model import (
    CORRECTION_TERMS, Column, Controlled, Correction, Experiment, Measured, Model, Parametrised, Temperature,
    TemperatureField, build_forward,
)

MIN_SEPARATING_CHI2 = 25.0  # D of a reliable separation: five standard deviations
MIN_REPORTED_CHI2 = 1.0  # below, no simulated continuation is recommended
MAX_SIMULATED_MODELS = 3  # of an indistinguishable group
MAX_UNLOADED_SHARE = 0.1  # of the largest motion or load


@dataclass(frozen=True)
class Continuation:
    """New frames: motion as a factor of the largest one of the programme, seconds in parts of the test's duration."""

    words: str
    motion: tuple[float, ...]
    seconds: tuple[float, ...]


def menu(final_motion: float) -> tuple[Continuation, ...]:
    """What may follow a test that ends at `final_motion` (of its largest motion), by effort."""
    down, up = (tuple(np.linspace(final_motion, end, 5)[1:]) for end in (0.0, 1.3 * np.sign(final_motion or 1.0)))
    back = tuple(np.linspace(final_motion, -np.sign(final_motion or 1.0), 7)[1:])
    return (Continuation("hold the last motion for as long as the test lasted", (final_motion,) * 4, (0.25,) * 4),
            Continuation("unload to zero once", down, (0.05,) * 4),
            Continuation("unload to zero and wait there for as long as the test lasted", (*down, 0.0, 0.0),
                         (0.05,) * 4 + (0.5,) * 2),
            Continuation("load on to 1.3 times the largest motion", up, (0.1,) * 4),
            Continuation("unload, then load again ten times as fast", (*down, 0.5, 1.0), (0.05,) * 4 + (0.01,) * 2),
            Continuation("reverse the load as far as it went", back, (0.05,) * 6))


@dataclass(frozen=True)
class Separation:
    """A continuation and the chi-square by which it tells the models apart (the smaller way round)."""

    words: str
    D: float


@dataclass(frozen=True, eq=False)
class SeparatedModel:
    """A fitted model with its residual on the recording in hand."""

    name: str
    identification: Identification
    residual: ResidualEvidence


def next_experiment(members: Sequence[FittedModel]) -> str | None:
    """The cheapest continuation that separates the members of an indistinguishable group; None where none is simulated.

    Parameters
    ----------
    members : models with one candidate each, under its name
    """
    try:
        models = [_simulated(member) for member in members[:MAX_SIMULATED_MODELS] if member.fit.usable]
        pairs = [{t.words: t.D for t in separations(base, rival)} for base, rival in combinations(models, 2)]
    except (NotConverged, InputError):
        return None
    if not pairs:
        return None
    common = [Separation(words, min(pair[words] for pair in pairs)) for words in pairs[0]
              if all(words in pair for pair in pairs)]
    best = recommended(common)
    if best is None or best.D < MIN_REPORTED_CHI2:
        return None
    names = " and ".join(model.name.replace("_", " ") for model in models)
    if best.D < MIN_SEPARATING_CHI2:
        return (f"{best.words}: of the simulated tests it separates {names} best, but not reliably "
                f"(expected chi-square {best.D:.2g})")
    return f"{best.words}: it separates {names} (expected chi-square {best.D:.3g})"


def _simulated(member: FittedModel) -> SeparatedModel:
    identified = member.identification()
    return SeparatedModel(member.fit.name, identified, residual_evidence(identified))


def separations(base: SeparatedModel, rival: SeparatedModel) -> tuple[Separation, ...]:
    """D of every continuation that both models get through, in the order of the menu.

    None where a motion is not a logged one (`reason_against_continuation`).
    """
    experiment, tried = base.identification.experiment, []
    if any(reason_against_continuation(model.identification.experiment.model) for model in (base, rival)):
        return ()
    course = _programme(experiment.model)
    for continuation in menu(float(course[-1])):
        try:
            tried.append(Separation(continuation.words, separation_chi2(base, rival, continuation)))
        except (NotConverged, InputError):
            continue
    return tuple(tried)


def separation_chi2(base: SeparatedModel, rival: SeparatedModel, continuation: Continuation) -> float:
    """D of one continuation, the smaller way round, at the nodes that both models see.

    A lens or a hole that differs takes pixels from some nodes and gives them to others.

    Raises
    ------
    NotConverged, InputError
        If one of the models does not get through the continuation.
    """
    dofs = np.intersect1d(base.residual.evidence.seen, rival.residual.evidence.seen)
    first, second = (_shown(model, continuation, dofs) for model in (base, rival))
    return min(_apart(base.residual.evidence.at(dofs), first, second, continuation),
               _apart(rival.residual.evidence.at(dofs), second, first, continuation))


def reason_against_continuation(model: Model) -> str | None:
    """Why the programme of a test cannot be continued in a simulation, None where it can.

    Images that were never taken say nothing of how a measured edge or a virtual boundary would move.
    """
    edges = sorted({f"{entry.nodes} along {entry.component}" for entry in model.prescribed
                    if isinstance(entry.drive, Measured | Parametrised)})
    if edges:
        return f"the motion of {', '.join(edges)} is known from images alone"
    return "no motion or load of the test is logged" if _programme(model) is None else None


def unloads(model: Model) -> bool | None:
    """Whether the logged motion or load came back to zero after its largest value; None where none is logged."""
    course = _programme(model)
    if course is None:
        return None
    return bool((np.abs(course[np.argmax(np.abs(course)):]) < MAX_UNLOADED_SHARE).any())


def recommended(tried: Sequence[Separation]) -> Separation | None:
    """The first that tells reliably, else the one that tells most."""
    return next((t for t in tried if t.D >= MIN_SEPARATING_CHI2), max(tried, key=lambda t: t.D, default=None))


def _programme(model: Model) -> np.ndarray | None:
    """The largest logged motion or load over its largest value  # (n_frames,)"""
    moving = [drive.values for drive in model.logged_drives if np.abs(drive.values).max() > 0.0]
    if not moving:
        return None
    largest = max(moving, key=lambda values: np.abs(values).max())
    return largest / largest[np.argmax(np.abs(largest))]


def continued(experiment: Experiment, continuation: Continuation) -> Experiment:
    """The experiment with the frames of a continuation behind its own; their measurements are zero."""
    model = experiment.model
    n, course = len(continuation.motion), _programme(model)
    times = model.times[-1] + np.cumsum(continuation.seconds) * (model.times[-1] - model.times[0])
    peak, factors = int(np.argmax(np.abs(course))), np.array(continuation.motion)

    def scaled(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values, factors * values[peak]])

    def held(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values, np.repeat(values[-1:], n, axis=0)])

    def steady(rates: np.ndarray | None) -> np.ndarray | None:
        return None if rates is None else np.concatenate([rates, np.zeros(n)])

    def correction(entry: Correction) -> Correction:
        stays = CORRECTION_TERMS[entry.kind].stays or entry.knot is not None
        return replace(entry, course=(held if stays else scaled)(entry.course))

    def carried(entry):
        drive = entry.drive
        changes: dict[str, Any] = {}
        if hasattr(drive, "corrections"):
            changes["corrections"] = tuple(correction(c) for c in drive.corrections)
        if isinstance(drive, Column):
            values = (held if isinstance(entry, Temperature) else scaled)(drive.values)
            changes |= {"values": values, "rates": steady(drive.rates)}
        elif isinstance(drive, Controlled):
            changes |= {"course": scaled(drive.course), "rates": steady(drive.rates)}
        elif isinstance(drive, TemperatureField):
            changes |= {"values": held(drive.values)}
        return replace(entry, drive=replace(drive, **changes)) if changes else entry

    channels = tuple(replace(c, values=np.concatenate([c.values, np.zeros(n)]), rates=steady(c.rates),
                             hats={name: held(hat) for name, hat in c.hats.items()})
                     for c in model.channels)
    prescribed = tuple(carried(entry) for entry in model.prescribed)
    return replace(experiment, recording=replace(experiment.recording, labels=(*experiment.recording.labels,
                                                                               *(f"next {k}" for k in range(n)))),
                   model=replace(model, motion_error=None, times=np.concatenate([model.times, times]),
                                 camera=_held(model.camera, n), channels=channels, prescribed=prescribed,
                                 loads=tuple(carried(entry) for entry in model.loads),
                                 temperatures=tuple(replace(carried(entry), hats=_further(entry.hats, n))
                                      for entry in model.temperatures),
                                 cracks=tuple(replace(crack, hats=_further(crack.hats, n)) for crack in model.cracks)))


def _further(hats: np.ndarray | None, n: int) -> np.ndarray | None:
    """Courses (n_knots, n_frames) that stay as they are in n further frames."""
    return None if hats is None else np.hstack([hats, np.repeat(hats[:, -1:], n, axis=1)])


def _held(camera: Camera, n: int) -> Camera:
    """Where it was in the last image; a camera without motion parameters does not move."""
    return camera if camera.motion is None else replace(camera, motion=camera.motion.extended(n))


@dataclass(frozen=True, eq=False)
class _Shown:
    """Of the compared frames, then the new ones: columns; fields (T, n_seen) px; channel residual (T, n_channels).

    n_seen : image dofs that both models see
    """

    columns: Columns
    fields: np.ndarray
    channel_residual: np.ndarray


def _shown(model: SeparatedModel, continuation: Continuation, dofs: np.ndarray) -> _Shown:
    evidence, context = model.residual.evidence, model.residual.context
    experiment = continued(context.experiment, continuation)
    forward = build_forward(experiment)
    cameras = [_later(camera, experiment, len(continuation.motion)) for camera in model.residual.cameras]
    local = np.vstack([model.identification.local,
                       np.zeros((len(continuation.motion), model.identification.local.shape[1]))])
    recorded_frames = {int(k) for k in evidence.frames}
    fields, channels, motion, channel_residual = [], [], [], []
    for at in forward.march(context.parameters, context.moving, local, None, forward.drives.n_local > 0):
        frame = at.frame + experiment.model.reference
        is_new = frame >= context.experiment.model.n_frames
        if is_new or frame in recorded_frames:
            response = FrameResponse(frame, at.seen_u, at.channels, at.seen_du, at.dchannels, at.seen_local_du,
                                     at.local_dchannels)
            rows = channel_equations(cameras[0].context, response)
            seen_by = [(camera, turned_response(camera.context.experiment.model, response)) for camera in cameras]
            fields.append(np.concatenate([global_columns(camera.context, camera_response)
                                          for camera, camera_response in seen_by])[dofs])
            channels.append(rows.d_global)
            motion.append(np.concatenate([
                camera.view.at(frame).motion(camera.context.experiment.model.mesh.nodes, camera_response.u).ravel()
                for camera, camera_response in seen_by
            ])[dofs])
            channel_residual.append(rows.residual)
    return _Shown(Columns(context.names, np.array(fields), np.array(channels)), np.array(motion),
                  np.array(channel_residual))


def _later(camera: CameraResidual, experiment: Experiment, n: int) -> CameraResidual:
    """A camera before `n` further frames; experiment : the continued one."""
    held_camera = _held(camera.context.camera, n)
    camera_experiment = next(view for view in experiment.views
                             if view.recording.camera_name == camera.context.experiment.recording.camera_name)
    return replace(camera, context=replace(camera.context, experiment=camera_experiment, camera=held_camera),
                   view=replace(camera.view, camera=held_camera))


def _apart(evidence: Evidence, base: _Shown, rival: _Shown, continuation: Continuation) -> float:
    """What the parameters of `base` leave of the difference, in chi-square."""
    n = len(continuation.motion)
    parts = evidence.parts
    longer = replace(evidence, frames=np.arange(len(parts) + n), kappa=np.concatenate(
        [evidence.kappa, np.full(n, evidence.kappa[-1])]), back=np.concatenate([evidence.back, np.repeat(
            evidence.back[-1:], n, axis=0)]), parts=parts + (parts[-1],) * n)
    difference = Columns(("difference",), (rival.fields - base.fields)[..., None],
                         (base.channel_residual - rival.channel_residual)[..., None])
    scores = score(longer, null_model(longer, base.columns), difference)
    return float(scores.own[0])
