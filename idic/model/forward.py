"""The forward model: parameters in, nodal displacements, channels and their derivatives out, one frame at a time.

The forward model of an experiment is its finite-element model plus the drives; it keeps nothing between calls, and the
same input gives the same output to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from idic.errors import InputError
from idic.fe import (
    Constraints, Control, Direction, FrameState, Loads, Body, Motion, PathControl, Reaction, Section, StepList,
    dead_pressure, face_area, increments_to_try, march, march_extrapolated, superposed, traction, with_seams,
    without_time_error,
)
from idic.laws import EXPANSION, compile as compile_law
from idic.model.crack import seams_at, tip_change
from idic.model.camera_time import is_camera_time, with_velocities
from idic.model.black_box import ExternalForward, build_external
from idic.model.drives import COMPONENTS, DriveTable
from idic.model.records.experiment import Experiment
from idic.model.records.model import Model
from idic.model.records.options import Options
from idic.model.records.parts import Load
from idic.model.heterogeneity import variation_of, variations_at
from idic.model.loads import LoadHistories, is_follower
from idic.model.readings import Readings, build_readings, controlled, from_reference, path_control
from idic.model.temperature import NodalTemperature, nodal_temperature
from idic.parameters import ParameterSet


@dataclass(frozen=True)
class Solution:
    """A simulation of all frames, in the order of the experiment's frames from the reference on.

    u : (n_frames, n_nodes, dim) mm, of the seen surface with its rise, where that is wanted; channels : (n_frames,
    n_channels) in the channels' units; steps : times of the increments taken (s), to be frozen for a comparison.
    """

    u: np.ndarray
    channels: np.ndarray
    steps: np.ndarray


@dataclass(frozen=True)
class ForwardModel:
    """A model prepared for simulation: the finite-element body and the drives."""

    model: Model
    options: Options
    drives: DriveTable
    body: Body  # with the histories of the model's starting values
    temperature: NodalTemperature | None = None  # None where no material knows it
    readings: Readings | None = None  # None where all channels are reactions
    control: Control | None = None  # None: as `idic.fe` has it

    @property
    def frames(self) -> np.ndarray:
        """Frame numbers that are simulated: the reference and all later ones  # (n_simulated,)"""
        return np.arange(self.model.reference, self.model.n_frames)

    def moves(self, name: str) -> bool:
        """Whether a degree of freedom changes the simulation (and not only camera or channels)."""
        return not name.startswith(("camera.", "channel.")) and (
            name in self.drives.derivatives or name in self.drives.loads.names() or is_camera_time(name)
            or name == "geometry.thickness" or name in self.morphs or tip_change(self.model, name) is not None
            or self._variation(name) is not None
            or self._material(name) is not None or self._expansion(name) is not None
            or (self.temperature is not None and name in self.temperature.knots)
            or (name == "time.offset" and (self._warming(name) is not None or self._late_readings() is not None)))

    @property
    def morphs(self) -> tuple[str, ...]:
        """Degrees of freedom that move the nodes of the mesh."""
        return tuple(morph.name for morph in self.model.morphs)

    def _material(self, name: str) -> tuple[int, int] | None:
        for index, section in enumerate(self.body.sections):
            prefix, _, parameter = name.rpartition(".")
            if prefix == section.name:
                names = section.law.spec.parameter_names
                return (index, names.index(parameter)) if parameter in names else None
        return None

    def _variation(self, name: str) -> tuple[int, str] | None:
        return variation_of(self.model, name)

    def _expansion(self, name: str) -> int | None:
        """The section whose thermal expansion this is, where there is a temperature."""
        names = [f"{section.name}.{EXPANSION.name}" for section in self.body.sections]
        return names.index(name) if self.temperature is not None and name in names else None

    def _warming(self, name: str) -> np.ndarray | None:
        """Derivative of the temperature by `time.offset` (K/s) or a knot of its course  # (n_simulated, n_nodes)"""
        if self.temperature is not None and name in self.temperature.knots:
            hat = self._from_reference(self.temperature.knots[name])
            return np.repeat(hat[:, None], self.model.mesh.n_nodes, axis=1)
        if name != "time.offset" or self.temperature is None or self.temperature.rates is None:
            return None
        return self._from_reference(self.temperature.rates)

    def direction(self, name: str, parameters: ParameterSet) -> Direction:
        """The fe direction, at these parameters, of a degree of freedom that `moves`."""
        if self._expansion(name) is not None:
            return Direction(name, expansion=self._expansion(name))
        if self._variation(name) is not None:
            return Direction(name, variation=self._variation(name))
        if (d_tips := tip_change(self.model, name)) is not None:
            return Direction(name, d_tips=d_tips)
        if name == "geometry.thickness":
            return Direction(name, thickness=True, d_loads=self._load_growth(parameters))
        loads, drives = self.drives.loads, self.drives.derivatives
        parts = {"d_temperature": self._warming(name),
                 "d_readings": self._late_readings() if name == "time.offset" else None,
                 "d_histories": self._from_reference(drives[name]) if name in drives else None,
                 "d_loads": self._load_change(name, parameters) if name in loads.names() else None}
        if any(part is not None for part in parts.values()):
            return Direction(name, **parts)
        return Direction(name, material=self._material(name))

    def body_at(self, parameters: ParameterSet, local: np.ndarray | None = None) -> Body:
        """The finite-element model with drives, mesh, thickness and local values (n_frames, m) of these parameters.

        Raises
        ------
        NotConverged
            If the geometry would flatten an element.
        """
        histories = self._from_reference(self.drives.histories(parameters, local))
        constraints = replace(self.body.constraints, histories=histories)
        thickness, loads = self.body.thickness, self.body.loads
        model = self.model.at_geometry(parameters)
        if model is not self.model and loads.dead is not None:
            loads = _loads(model, self.drives.loads)  # a traction on a rim that moves
        if "geometry.thickness" in parameters:
            thickness = parameters["geometry.thickness"].value
        loads = _with_histories(loads, self._load_values(parameters, local))
        if loads.dead is not None and thickness != self.body.thickness:
            growth = np.where(self._per_thickness(), thickness / self.body.thickness, 1.0)
            loads = replace(loads, dead_histories=loads.dead_histories * growth)
        return replace(self.body, mesh=model.mesh, constraints=constraints, thickness=thickness, loads=loads,
                       control=self._control(parameters), variations=variations_at(model, parameters),
                       seams=seams_at(self.body, model, parameters),
                       **self._thermal(parameters))

    def _thermal(self, parameters: ParameterSet) -> dict[str, Any]:
        """What of the model follows from the temperature: its history, the sections with their expansion."""
        if self.temperature is None:
            return {}
        offset = self.model.log_shift(parameters)
        sections = tuple(
            replace(section, expansion=parameters[name].value)
            if (name := f"{section.name}.{EXPANSION.name}") in parameters else section
            for section in self.body.sections)
        return {"sections": sections, "temperature": self._from_reference(self.temperature.at(offset, parameters)),
                "start_temperature": self.temperature.start}

    def _per_thickness(self) -> np.ndarray:
        """Which dead loads are stresses on an edge, so that their force grows with the thickness  # (n_dead,) bool"""
        dead = [load for load in self.model.loads if not is_follower(load)]
        return np.array([load.kind != "force" for load in dead], dtype=bool)

    def _load_growth(self, parameters: ParameterSet) -> np.ndarray | None:
        """Derivative of the load histories by the thickness (follower pressures know it themselves)."""
        loads = self.body.loads
        if loads.dead is None:
            return None
        values = self._load_values(parameters, None)[:, :loads.dead.shape[1]]
        growth = np.where(self._per_thickness(), values / self.body.thickness, 0.0)
        return np.hstack([growth, np.zeros((len(growth), len(loads.pressure_faces)))])

    def _load_values(self, parameters: ParameterSet, local: np.ndarray | None) -> np.ndarray:
        """Histories of the loads as the solver numbers them, simulated frames  # (n_simulated, n_loads)"""
        loads, of_drives = self.drives.loads, len(self.drives.local)
        values = loads.values(parameters, None if local is None else local[:, of_drives:])
        return values[self.model.reference:, loads.solver_order]

    def _load_change(self, name: str, parameters: ParameterSet) -> np.ndarray:
        loads = self.drives.loads
        return loads.derivative(name, parameters)[self.model.reference:, loads.solver_order]

    def _from_reference(self, histories: np.ndarray) -> np.ndarray:
        """Histories of the simulated frames; at the reference frame nothing has moved."""
        return from_reference(self.model, histories)

    def _late_readings(self) -> np.ndarray | None:
        """Derivative of the readings of the controlling gauge by `time.offset`, mm/s  # (n_simulated,)"""
        drive = controlled(self.model)
        if drive is None or drive.rates is None:
            return None
        return self._from_reference(self.model.rates_since_reference(drive.rates))

    def _control(self, parameters: ParameterSet) -> PathControl | None:
        """The controlling gauge with its readings at these parameters."""
        control, rates = self.body.control, self._late_readings()
        if rates is None or "time.offset" not in parameters:
            return control
        return replace(control, readings=control.readings + self.model.log_shift(parameters) * rates)

    def law_values(self, parameters: ParameterSet) -> dict[str, np.ndarray]:
        """Law parameters per section, in the law's order."""
        return {section.name: np.array([parameters[f"{section.name}.{name}"].value
                                        for name in section.law.spec.parameter_names])
                for section in self.body.sections}

    def march(self, parameters: ParameterSet, names: Sequence[str] = (), local: np.ndarray | None = None,
              steps: np.ndarray | None = None, influence: bool = False, warm_start: Iterable[np.ndarray] | None = None,
              may_cut: bool = False, increments: int | None = None) -> Iterator[FrameState]:
        """Simulate frame by frame.

        Parameters
        ----------
        names : the degrees of freedom to differentiate by (each must `moves`); those that move nodes by one more run on
            a perturbed mesh with the same increments, all others directly
        local : (n_frames, m) values of the local drives, mm
        steps : end times of the increments to follow exactly; None: the frame times, cut where equilibrium needs it
        influence : whether the same-frame influence fields of the local drives are wanted
        warm_start : (n_nodes, d) mm of every simulated frame, of a known solution: first guesses of equilibrium
        may_cut : whether `steps` are halved where equilibrium needs it
        increments : per frame, for extrapolation in time from these and half as many (`idic.fe.extrapolation`); None:
            one simulation with those of the options; `steps` decide where they are given

        Raises
        ------
        NotConverged
            If equilibrium is not found however small the increments.
        """
        if any(map(is_camera_time, names)):
            moving = [name for name in names if not is_camera_time(name)]
            yield from with_velocities(self.march(parameters, moving, local, steps, influence, warm_start, may_cut,
                                                  increments), names, self.model.times[self.model.reference:])
            return
        shape = [name for name in names if name in self.morphs]
        if shape and steps is None:
            for state in self._march(parameters, (), local, None, False, increments=increments):
                steps = np.array(state.steps.times)
        direct = [name for name in names if name not in shape]
        base = self._march(parameters, direct, local, steps, influence, warm_start, may_cut, increments)
        if not shape:
            yield from base
            return
        changes = {name: parameters[name].perturbation(self.options.perturbation) for name in shape}
        perturbed = [self._march(parameters.with_values({name: parameters[name].value + change}), (), local, steps,
                                 False, None, may_cut)
                     for name, change in changes.items()]
        for state, *perturbed_states in zip(base, *perturbed, strict=True):
            du = dict(zip(direct, np.moveaxis(state.du, -1, 0), strict=True))
            dchannels = dict(zip(direct, np.moveaxis(state.dchannels, -1, 0), strict=True))
            d_rise = {} if state.rise is None else dict(zip(direct, state.d_rise.T, strict=True))
            for name, perturbed_state in zip(shape, perturbed_states, strict=True):
                du[name] = (perturbed_state.u - state.u) / changes[name]
                dchannels[name] = (perturbed_state.channels - state.channels) / changes[name]
                if state.rise is not None:
                    d_rise[name] = (perturbed_state.rise - state.rise) / changes[name]
            if state.rise is not None:
                state = replace(state, d_rise=np.stack([d_rise[name] for name in names], axis=-1))
            yield replace(state, du=np.stack([du[name] for name in names], axis=-1),
                          dchannels=np.stack([dchannels[name] for name in names], axis=-1))

    def without_time_error(self, parameters: ParameterSet, local: np.ndarray,
                           simulation: Callable[[], Iterable[Motion]]) -> Iterator[Motion]:
        """Motion of the seen surface and channels of every frame, extrapolated in time from a known simulation of this
        point with one increment per frame and a simulation in steps of two frames (`idic.fe.half_rate`).

        Parameters
        ----------
        local : (n_frames, m) mm; simulation : gives the known simulation anew at every call, the reference first

        Raises
        ------
        NotConverged
            If equilibrium is not found in steps of two frames however small the increments.
        """
        return without_time_error(self.body, len(self.frames), simulation, partial(self.march_at, parameters, local))

    def march_at(self, parameters: ParameterSet, local: np.ndarray | None, frames: np.ndarray,
                 warm_start: Iterable[np.ndarray] | None = None) -> Iterator[FrameState]:
        """Simulate with an increment from each of some frames to the next, without derivatives.

        Parameters
        ----------
        frames : increasing, counted from the reference, which is the first
        warm_start : (n_nodes, d) mm of each of them

        Raises
        ------
        NotConverged
            If equilibrium is not found however small the increments.
        """
        return self._march(parameters, (), local, None, False, warm_start, frames=frames)

    def _march(self, parameters: ParameterSet, names: Sequence[str], local: np.ndarray | None,
               steps: np.ndarray | None, influence: bool, warm_start: Iterable[np.ndarray] | None = None,
               may_cut: bool = False, increments: int | None = None,
               frames: np.ndarray | None = None) -> Iterator[FrameState]:
        """One simulation, differentiated directly; frames : numbers of those that end an increment, None: all."""
        body = self.body_at(parameters, local)
        if influence:
            places = np.argsort(self.drives.loads.solver_order)
            body = replace(body, local_drives=self.drives.local,
                           local_loads=tuple(int(places[load]) for load in self.drives.loads.local))
        directions = tuple(self.direction(name, parameters) for name in names)
        times = self.model.times[self.model.reference:]
        if frames is not None:
            body, times = body.at_frames(frames), times[frames]
        frozen = None if steps is None else StepList(tuple(float(t) for t in steps))
        arguments = (body, self.law_values(parameters), times, directions, frozen)
        ways = {"control": self.control, "warm_start": warm_start, "may_cut": may_cut}
        if frozen.is_extrapolated if frozen is not None else increments is not None:
            states = march_extrapolated(*arguments, increments=increments or 2, **ways)
        else:
            substeps = self.options.substeps or 1
            states = (superposed(*arguments, substeps=substeps, control=self.control)
                      or march(*arguments, substeps=substeps, **ways))
        if frames is not None:
            states = (replace(state, frame=int(frames[state.frame])) for state in states)
        if self.readings is not None:
            states = self._with_readings(states, self.readings, parameters, names, local, influence)
        error, first = self.model.motion_error, self.model.reference
        for state in states:  # the error of a channel is that of the whole reading
            yield state if error is None else error.added(state, first + state.frame)

    def _with_readings(self, states: Iterable[FrameState], readings: Readings, parameters: ParameterSet,
                       names: Sequence[str], local: np.ndarray | None, influence: bool) -> Iterator[FrameState]:
        """The states with the channels that are no reactions."""
        loads, first = self.drives.loads, self.model.reference
        values = loads.values(parameters, None if local is None else local[:, len(self.drives.local):])
        changes = [loads.derivative(name, parameters) if name in loads.names() else np.zeros_like(values)
                   for name in names]
        local_derivatives = np.zeros((len(loads.stems), len(self.drives.local) + len(loads.local) if influence else 0))
        local_derivatives[list(loads.local), len(self.drives.local):] = np.eye(len(loads.local)) if influence else 0.0
        for state in states:
            frame = first + state.frame
            derivatives = np.array([change[frame] for change in changes]).reshape(len(names), len(loads.stems)).T
            yield readings.of(state, values[frame], derivatives, local_derivatives)


def build_forward(experiment: Experiment) -> ForwardModel | ExternalForward:
    """The forward model of an experiment: the built-in one, or that of its external solver.

    Raises
    ------
    InputError
        If sets are missing, a body is unconstrained, or a force is compared without a thickness.
    """
    model = experiment.model
    if model.solver is not None:
        return build_external(experiment)
    drives = DriveTable.of(experiment)
    mesh = model.mesh
    sections = tuple(
        Section(material.element_set, compile_law(material.law, material.kinematics),
                np.asarray(mesh.element_sets[material.element_set]))
        for material in model.materials)
    histories = drives.histories(model.parameters)[model.reference:].copy()
    histories[0] = 0.0
    body = Body(
        mesh=mesh, kind=model.kind, sections=sections,
        constraints=Constraints(drives.dofs, drives.basis, histories),
        thickness=model.thickness or 1.0, loads=_loads(model, drives.loads),
        channels=_reactions(model),
        locking=experiment.options.locking, surface_side=experiment.surface_side,
        control=path_control(model, drives))
    body.validate(len(histories))
    warmed = any(f"{section.name}.{EXPANSION.name}" in model.parameters
                 or section.law.spec.temperature is not None
                 for section in sections)
    forward = ForwardModel(model, experiment.options, drives, body, nodal_temperature(model) if warmed else None,
                           build_readings(model, drives.loads))
    return _cracked(forward) if model.cracks else forward


def _cracked(forward: ForwardModel) -> ForwardModel:
    """The model with the seams of its cracks; they keep the stiffness of the starting values."""
    model = forward.model
    body = with_seams(forward.body_at(model.parameters), [crack.cut for crack in model.cracks],
                      model.tips_at(model.parameters), forward.law_values(model.parameters),
                      model.times[model.reference:])
    return replace(forward, body=replace(forward.body, seams=body.seams))


def tried_increments(forward: ForwardModel | ExternalForward, times: np.ndarray, increments: int | None,
                     steps: Sequence[float] | None) -> list[tuple[float, ...] | None]:
    """Lists of increments to try; see `idic.fe.extrapolation.increments_to_try` and `ForwardModel.march`.

    An external solver is tried once: it chooses its own.
    """
    if not isinstance(forward, ForwardModel):
        return [None]
    per_frame = increments or forward.options.substeps or 1
    return increments_to_try(forward.body, times, per_frame, steps, extrapolated=increments is not None)


def solve(forward: ForwardModel, parameters: ParameterSet, local: np.ndarray | None = None,
          steps: np.ndarray | None = None, increments: int | None = None) -> Solution:
    """All frames at once (memory grows with the number of frames; long runs use `ForwardModel.march`).

    local, steps, increments : as for `ForwardModel.march`
    """
    u, channels, state = [], [], None
    for state in forward.march(parameters, local=local, steps=steps, increments=increments):
        u.append(state.seen_u.copy())
        channels.append(state.channels.copy())
    return Solution(np.array(u), np.array(channels), np.array(state.steps.times))


def _reactions(model: Model) -> tuple[Reaction, ...]:
    forces = [channel for channel in model.channels if channel.kind == "reaction"]
    if forces and model.kind != "solid" and model.thickness is None:
        raise InputError("a force is compared but no thickness is given", file="experiment.toml",
                         key="[experiment] thickness_mm", expected="the thickness of the specimen", found="nothing",
                         remedy="add thickness_mm, or take the [[channel]] out")
    return tuple(
        Reaction(model.node_set(channel.nodes) * model.n_dim + COMPONENTS.index(channel.component),
                 channel.factor) if channel.kind == "reaction" else Reaction(np.zeros(0, dtype=int))
        for channel in model.channels)  # other channels than reactions are read elsewhere (`idic.model.readings`)


def _loads(model: Model, histories: LoadHistories) -> Loads:
    """Follower pressures on their faces, everything else as dead nodal forces."""
    edges = model.mesh.edge_sets
    faces = tuple(edges[load.edges] for load in model.loads if is_follower(load))
    dead = [_dead_load(model, load, edges[load.edges]) for load in model.loads if not is_follower(load)]
    loads = Loads(dead=np.array(dead).T if dead else None, pressure_faces=faces)
    values = histories.values(model.parameters)[model.reference:, histories.solver_order]
    return _with_histories(loads, values)


def _with_histories(loads: Loads, values: np.ndarray) -> Loads:
    """The loads with these histories (n_simulated, n_loads), dead ones first."""
    n_dead = 0 if loads.dead is None else loads.dead.shape[1]
    return replace(loads, dead_histories=values[:, :n_dead] if n_dead else None,
                   pressure_histories=values[:, n_dead:] if loads.pressure_faces else None)


def _dead_load(model: Model, load: Load, edges: np.ndarray) -> np.ndarray:
    """Nodal forces (n_dof,) per unit of the load's history."""
    mesh, thickness = model.mesh, model.thickness or 1.0
    if load.kind == "pressure":
        return dead_pressure(mesh, edges, thickness)
    vector = np.eye(model.n_dim)[COMPONENTS.index(load.component)]
    if load.kind == "force":
        vector = load.share * vector / face_area(mesh, edges, thickness)
    return traction(mesh, edges, vector, thickness)
