"""The design of a test: its standard deviations from sensitivities, pattern and noise, without a single frame.

    M = sum_t (dU_t)^T H_t (dU_t),      Cov = M^-1 [ spread + sigma^2 S^T H S ] M^-1

Neither contains a residual (Neggers et al. 2015, Eqs 6 and 16): the reference image, the simulated motion and the
noise of images and channels are enough, in the same functions as an identification. It would report these standard
deviations if the assumed values are right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from idic.correlation import (
    CorrelationContext, CorrelationSystem, FrameResponse, View, build_experiment_reference, camera_at, closed_system,
    frame_system, reduce_systems, view_of, with_all_cameras,
)
from idic.errors import InputError
from idic.identification.joint import joint_names, of_material
from idic.identification.result import Analysis
from idic.identification.step.estimator import with_final_weights
from idic.identification.step.state import Evaluation
from idic.identification.weights import noise_weights
from idic.model import Experiment, ForwardModel, build_forward
from idic.parameters import Parameter, ParameterSet

GROWTH_POINTS = 24  # frame counts at which the standard deviations are evaluated
MIN_MOTION_PX = 1e-3  # below this nothing is seen to move at all
PLAN_SEPARATOR = "/"  # behind the name of a plan, before that of a parameter of its own


@dataclass(frozen=True)
class Field:
    """Sensitivity field of one parameter in the frame in which it is largest.

    phi : (n_nodes, n_components) change of the image motion for a change by `step`, px; largest : max |phi|, px;
    step : the parameter's own value (its scale where the value is zero), internal units.
    """

    name: str
    frame: int
    phi: np.ndarray
    largest: float
    step: float


@dataclass(frozen=True)
class Design:
    """The predicted outcome of one planned test.

    Attributes
    ----------
    full : Analysis
        From images and channels; `image` from the images alone, None where there are no channels.
    materials : Analysis or None
        The parameters of materials if boundary, camera, channel, geometry and time were known; None where none is free.
    alike : (n, n) cosine between the sensitivity fields as the images see them.
    fields : one per parameter that moves the simulation.
    growth_frames, growth : (k,), (k, n) standard deviations from the first frames alone, NaN: not determined.
    motion_px : (n_frames,) largest image motion of each simulated frame.
    channel_peak : (n_channels,) largest simulated value of each channel.
    """

    name: str
    experiment: Experiment
    evaluation: Evaluation
    full: Analysis
    image: Analysis | None
    materials: Analysis | None
    alike: np.ndarray
    fields: tuple[Field, ...]
    growth_frames: np.ndarray
    growth: np.ndarray
    motion_px: np.ndarray
    channel_peak: np.ndarray
    channel_noise: np.ndarray
    image_noise: float
    n_pixels: int
    notes: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        return self.full.names

    @property
    def parameters(self) -> ParameterSet:
        return self.full.parameters

    @classmethod
    def of(cls, name: str, experiment: Experiment, local: np.ndarray | None = None,
           notes: Sequence[str] = ()) -> Design:
        """Simulate a planned test and predict its standard deviations.

        Parameters
        ----------
        experiment : Experiment
            Its stack needs the reference image only: whatever it gives for later frames enters neither M nor the noise.
        local : (n_frames, m) mm, optional
            Motion of measured edges; zero without it.

        Raises
        ------
        InputError
            No free parameter, image noise not known, or a plan in which nothing moves.
        NotConverged
            If the simulation does not reach the end.
        """
        names = experiment.model.parameters.free
        if not names:
            raise InputError("no parameter is to be identified", file="experiment.toml", key="[material]",
                             expected="identify = true at one parameter or more", found="none",
                             remedy="write for instance  E = { value = 70e3, identify = true }")
        forward = build_forward(experiment)
        moving = tuple(name for name in names if forward.moves(name))
        parameters, weights = experiment.model.parameters, noise_weights(experiment)
        experiment = experiment.at_geometry(parameters)
        camera = camera_at(experiment, parameters)
        context = with_all_cameras(CorrelationContext(
            experiment, parameters, names, moving, camera, build_experiment_reference(experiment, camera), weights,
            forward.drives.local_precision, local_scatter=forward.drives.local_scatter))
        walk = _Walk(context, forward, view_of(experiment, camera))
        local = np.zeros((experiment.model.n_frames, forward.drives.n_local)) if local is None else local
        walk.run(local)
        if walk.motion_px.max(initial=0.0) < MIN_MOTION_PX:
            raise InputError("nothing moves in this plan", file="experiment.toml", key="[[boundary]]",
                             expected="a boundary or a load that moves the specimen in the images",
                             found=f"at most {walk.motion_px.max(initial=0.0):.2g} px",
                             remedy="give the motion as a column, with its course under [design.program]")
        return walk.design(name, tuple(notes))


@dataclass(frozen=True)
class JointDesign:
    """All plans identified together: what `idic.identification.joint` shares has one name."""

    full: Analysis
    notes: tuple[str, ...]

    @classmethod
    def of(cls, designs: Sequence[Design]) -> JointDesign:
        """The plans as one identification: M and its noise add for the parameters that experiments share.

        Directions that differ, what says ``shared = false`` and what belongs to one test only (boundary, camera,
        channel, geometry, time) keep their own unknown, named ``PLAN/boundary...``. The names of the plans differ.

        Raises
        ------
        InputError
            As `idic.identification.Joint.of`, but for options.
        """
        own_names = joint_names({design.name: design.experiment for design in designs}, PLAN_SEPARATOR, any_unit=True)
        renamed = [tuple(own_names[design.name][name] for name in design.names) for design in designs]
        names = tuple(dict.fromkeys(name for group in renamed for name in group))
        M, noise, b = np.zeros((len(names),) * 2), np.zeros((len(names),) * 2), np.zeros(len(names))
        parameters: dict[str, Parameter] = {}
        notes = []
        for design, group in zip(designs, renamed, strict=True):
            place = np.ix_(*[[names.index(name) for name in group]] * 2)
            system = design.evaluation.system
            M[place] += system.M
            noise[place] += system.spread + design.image_noise**2 * design.evaluation.reference_gram
            for name_in_plan, name in zip(design.names, group, strict=True):
                parameter = replace(design.parameters[name_in_plan], name=name)
                if not np.isclose(parameters.setdefault(name, parameter).value, parameter.value, rtol=1e-12, atol=0.0):
                    notes.append(f"{name}: the plans assume {parameters[name].shown:g} and {parameter.shown:g} "
                                 f"{parameter.unit}")
        joint = list(dict.fromkeys(prior.renamed(dict(zip(design.names, group, strict=True)))
                                   for design, group in zip(designs, renamed, strict=True)
                                   for prior in design.parameters.joint))
        system = CorrelationSystem(names, M, b, 0.0, 0.0, noise, np.zeros((0, len(names))), ())
        with_force = next((d.experiment for d in designs if d.experiment.model.channels), designs[0].experiment)
        nothing_more = np.zeros_like(M)  # the reference images' noise is in `noise` already: every plan has its own
        analysis = Analysis(with_force, ParameterSet(parameters.values(), joint), Evaluation(0, system, nothing_more),
                            0.0)
        return cls(analysis, tuple(dict.fromkeys(notes)))


class _Walk:
    """One march through the planned test, summing the contributions of the frames; nothing per frame is kept."""

    def __init__(self, context: CorrelationContext, forward: ForwardModel, view: View):
        self.context, self.forward, self.view = context, forward, view
        self.experiment = context.experiment
        self.total: CorrelationSystem | None = None
        self.image_only: CorrelationSystem | None = None
        self.fields: dict[str, Field] = {}
        self.motion: list[float] = []
        self.peak = np.zeros(len(self.experiment.model.channels))
        self.growth: list[tuple[int, np.ndarray]] = []
        self.seen = context.reference.pixel_map.visible_nodes

    @property
    def motion_px(self) -> np.ndarray:
        return np.array(self.motion)

    def run(self, local: np.ndarray) -> None:
        experiment, context = self.experiment, self.context
        frames = experiment.correlated_frames(range(experiment.model.n_frames))
        stops = {frames[i] for i in np.linspace(0, len(frames) - 1, min(GROWTH_POINTS, len(frames))).astype(int)}
        silent = replace(context, weights=replace(context.weights, channels=0.0 * context.weights.channels))
        influence = self.forward.drives.n_local > 0
        for state in self.forward.march(context.parameters, context.moving, local, influence=influence):
            frame = state.frame + experiment.model.reference
            self._look(frame, state)
            if frame not in frames:
                continue
            response = FrameResponse(frame, state.seen_u, state.channels, state.seen_du, state.dchannels,
                                     state.seen_local_du,
                                     state.local_dchannels)
            self.total = _added(self.total, frame_system(context, response, local[frame]))
            if experiment.model.channels:
                self.image_only = _added(self.image_only, frame_system(silent, response, local[frame]))
            if frame in stops:
                self.growth.append((frame, self._stds(self.total)))

    def _look(self, frame: int, state) -> None:
        """Image motion of a frame and where each parameter moves it most."""
        nodes = self.experiment.model.mesh.nodes
        moved = self.view.motion(nodes, state.seen_u)[self.seen]
        self.motion.append(float(np.linalg.norm(moved, axis=1).max()))
        self.peak = np.maximum(self.peak, np.abs(state.channels))
        columns = self.view.columns(nodes, state.seen_u, state.seen_du).reshape(len(nodes), self.view.n_components, -1)
        for i, name in enumerate(self.context.moving):
            parameter = self.context.parameters[name]
            step = abs(parameter.value) or parameter.scale
            largest = float(np.linalg.norm(columns[self.seen, :, i], axis=1).max() * step)
            if name not in self.fields or largest > self.fields[name].largest:
                self.fields[name] = Field(name, frame, columns[:, :, i] * step, largest, step)

    def _evaluation(self, system: CorrelationSystem) -> Evaluation:
        """The sums, weighed as an identification would weigh them in the end."""
        ordinary = Evaluation(0, *closed_system(self.context, system))
        return with_final_weights(ordinary, self.experiment, system.names, self.context.weights.image_noise)

    def _analysis(self, evaluation: Evaluation, experiment: Experiment) -> Analysis:
        return Analysis(experiment, self._parameters(), evaluation, self.context.weights.image_noise, planned=True)

    def _parameters(self) -> ParameterSet:
        """Offsets and drifts of channels are scaled by the predicted readings, as with a measured log."""
        experiment, scaled = self.experiment, {}
        for channel, peak in zip(experiment.model.channels, self.peak, strict=True):
            size = 0.1 * (peak or 1.0)
            scaled[f"channel.{channel.column}.offset"] = size
            scaled[f"channel.{channel.column}.drift"] = size / (float(np.ptp(experiment.model.times)) or 1.0)
        return ParameterSet((replace(p, scale=scaled.get(p.name, p.scale)) for p in self.context.parameters.values()),
                            self.context.parameters.joint)

    def _stds(self, system: CorrelationSystem) -> np.ndarray:
        analysis = self._analysis(self._evaluation(system), self.experiment)
        return np.array([np.nan if (std := analysis.std(name)) is None else std for name in analysis.names])

    def design(self, name: str, notes: tuple[str, ...]) -> Design:
        context, experiment = self.context, self.experiment
        evaluation = self._evaluation(self.total)
        full = self._analysis(evaluation, experiment)
        image = materials = None
        if self.image_only is not None:
            image = self._analysis(self._evaluation(self.image_only),
                                   replace(experiment, model=replace(experiment.model, channels=())))
        indices = [i for i, parameter in enumerate(context.names) if of_material(parameter, experiment.model)]
        if 0 < len(indices) < len(context.names):
            part = Evaluation(0, evaluation.system.restrict([context.names[i] for i in indices]),
                              evaluation.reference_gram[np.ix_(indices, indices)])
            materials = self._analysis(part, experiment)
        picture = evaluation.system if self.image_only is None else self.image_only
        length = np.sqrt(np.maximum(np.diagonal(picture.M), 1e-300))
        return Design(
            name=name, experiment=experiment, evaluation=evaluation, full=full, image=image, materials=materials,
            alike=np.where(np.outer(length, length) > 1e-290, picture.M / np.outer(length, length), 0.0),
            fields=tuple(self.fields.values()), growth_frames=np.array([frame for frame, _ in self.growth]),
            growth=np.array([stds for _, stds in self.growth]), motion_px=self.motion_px, channel_peak=self.peak,
            channel_noise=context.weights.channel_noise, image_noise=context.weights.image_noise,
            n_pixels=context.reference.pixel_map.n_pixels, notes=notes)


def _added(total: CorrelationSystem | None, system: CorrelationSystem) -> CorrelationSystem:
    return reduce_systems([system] if total is None else [total, system])

