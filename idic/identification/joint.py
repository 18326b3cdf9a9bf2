"""Several experiments at once: one set of parameters, the normal equations of all experiments added.

Parameters of a material are shared by every experiment that has a material of that name (``SPECIMEN.E``), except
directions (in degrees) that the experiments state differently, and what says ``shared = false``; these and everything
else (camera, boundary, channels, geometry, time, heterogeneities) belong to their experiment and carry its name in
front:
``short.camera.rotation_deg``, ``off_axis.SPECIMEN.angle``. With P_k the columns that experiment k's parameters have
among all,

    M = sum_k P_k M_k P_k^T,   b = sum_k P_k b_k,   Cov(b) = sum_k P_k Cov(b_k) P_k^T

as no two experiments share an image. Frame-local unknowns stay inside their experiment.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy

from idic.correlation import CorrelationSystem, FrameRecord
from idic.errors import InputError
from idic.identification.step.estimator import check_estimator
from idic.identification.step.increments import n_intervals
from idic.identification.step.schedule import is_preliminary
from idic.identification.step.stages import check_images
from idic.identification.step.state import Evaluation, LoopState
from idic.model import Experiment, Model, Stage
from idic.parameters import Parameter, ParameterSet
from idic.readers import parse_unit

LOOP_OPTIONS = ("estimator", "weighting", "interpolation", "schedule", "max_iterations", "tolerance", "step_limit",
                "trial_steps", "substeps")


@dataclass(frozen=True)
class Joint:
    """Experiments that are identified together, or a single one, which is its own whole.

    Attributes
    ----------
    experiments : {name: Experiment}
    names : {name: {parameter of the experiment: parameter of the whole}}
    whole : the experiment of the loop: the first one with the parameters, schedule, channels and loads of all
    """

    experiments: Mapping[str, Experiment]
    names: Mapping[str, Mapping[str, str]]
    whole: Experiment

    @property
    def single(self) -> bool:
        """Whether it is one experiment alone."""
        return len(self.experiments) == 1

    @property
    def identity(self) -> str:
        """What all experiments say, as a digest; that of the experiment where it is a single one."""
        if self.single:
            return self.whole.recording.identity
        return hashlib.sha256("\n".join(f"{name} {experiment.recording.identity}" for name, experiment in
                                        self.experiments.items()).encode()).hexdigest()

    def reason(self, reasons: Mapping[str, str]) -> str:
        """Why the whole failed, out of the reasons of the experiments; "" where none of them did."""
        return "; ".join(reason if self.single else f"{name}: {reason}" for name, reason in reasons.items() if reason)

    def values_of(self, name: str, values: Mapping[str, float]) -> dict[str, float]:
        """One experiment's parameters out of those of the whole."""
        return {key: values[joint] for key, joint in self.names[name].items()}

    def state_of(self, name: str, state: LoopState) -> LoopState:
        """The state of the whole as one experiment sees it."""
        if self.single:
            return state
        part = partial(self.values_of, name)
        parallel = tuple(replace(trial, values=part(trial.values)) for trial in state.trial.parallel)
        chosen = {key: value and part(value) for key in ("coarser", "change")
                  for value in (getattr(state.increments, key),)}
        history = tuple(entry | {"values": part(entry["values"])} for entry in state.history)
        return replace(state, trial=replace(state.trial, values=part(state.trial.values), parallel=parallel),
                       accepted=state.accepted and replace(state.accepted, values=part(state.accepted.values)),
                       history=history, increments=replace(state.increments, **chosen))

    def channels_of(self, name: str) -> np.ndarray:
        """Which channels of the whole are one experiment's  # (n_channels,) bool"""
        return np.concatenate([np.full(len(experiment.model.channels), owner == name)
                               for owner, experiment in self.experiments.items()])

    @property
    def intervals(self) -> int:
        """Intervals between the simulated frames of all experiments."""
        return sum(n_intervals(experiment.model) for experiment in self.experiments.values())

    def combine(self, evaluations: Mapping[str, Evaluation], image_noise: Mapping[str, float]) -> Evaluation:
        """The evaluation of the whole; its image noise is that of the first experiment.

        A single one is returned as it is.
        """
        first_part = next(iter(evaluations.values()))
        if self.single:
            return first_part
        number = first_part.number
        if any(part.system is None for part in evaluations.values()):
            reason = self.reason({name: part.message for name, part in evaluations.items()})
            return Evaluation(number, None, None, reason, parts=evaluations)
        names = self.whole.model.parameters.free
        first = image_noise[next(iter(self.experiments))]
        gram, systems = np.zeros((len(names), len(names))), []
        for name, part in evaluations.items():
            place = [names.index(self.names[name][key]) for key in part.system.names]
            gram[np.ix_(place, place)] += (image_noise[name] / first) ** 2 * part.reference_gram
            systems.append(_among(part.system, names, place, self.channels_of(name)))
        increments = sum(part.increments for part in evaluations.values())
        return Evaluation(number, _sum(systems), gram, increments=increments, intervals=self.intervals,
                          parts=evaluations)

    @classmethod
    def of(cls, experiments: Mapping[str, Experiment]) -> Joint:
        """The experiments as one; a single one keeps its names.

        Raises
        ------
        InputError
            If materials of one name differ in law, in what is identified, or in values that are not.
        """
        if len(experiments) == 1:
            (name, experiment), = experiments.items()
            return cls(experiments, {name: {parameter: parameter for parameter in experiment.model.parameters}},
                       experiment)
        names = joint_names(experiments)
        parameters: dict[str, Parameter] = {}
        notes = []
        for name, experiment in experiments.items():
            for key, parameter in experiment.model.parameters.items():
                joint = names[name][key]
                if joint not in parameters:
                    parameters[joint] = replace(parameter, name=joint)
                elif parameters[joint].value != parameter.value:
                    notes.append(f"{joint} starts from {parameters[joint].shown:g} {parameter.unit}, as in the first "
                                 f"experiment; {name} says {parameter.shown:g}")
        joint_priors = list(dict.fromkeys(  # that of a shared curve counts once
            prior.renamed(names[name]) for name, experiment in experiments.items()
            for prior in experiment.model.parameters.joint))
        first = next(iter(experiments.values()))
        every = list(experiments.values())
        _check_options(experiments)
        union = replace(first, model=replace(first.model, parameters=ParameterSet(parameters.values(), joint_priors),
                                             prescribed=tuple(entry for e in every for entry in e.model.prescribed),
                                             materials=tuple({m.element_set: m for e in reversed(every)
                                                              for m in e.model.materials}.values()),
                                             loads=tuple(load for e in every for load in e.model.loads),
                                             channels=tuple(replace(c, column=f"{name}.{c.column}", times=e.model.times)
                           for name, e in experiments.items() for c in e.model.channels)),
                        title=" + ".join(e.title for e in every), stages=_stages(experiments, names), cameras=(),
                        notes=tuple(dict.fromkeys([*(f"{name}: {note}" for name, e in experiments.items()
                                                     for note in e.notes),
                                       *notes])))
        return cls(experiments, names, union)


def joint_names(experiments: Mapping[str, Experiment], separator: str = ".",
                any_unit: bool = False) -> dict[str, dict[str, str]]:
    """{experiment: {its parameter: parameter of the whole}}.

    separator : behind the name of an experiment
    any_unit : experiments may state a shared parameter in several units of one dimension

    Raises
    ------
    InputError
        If materials of one name differ in law, in what is identified, or in values that are not.
    """
    own_directions = _own_directions(experiments)

    def shared(parameter: Parameter, experiment: Experiment) -> bool:
        return of_material(parameter.name,
                           experiment.model) and parameter.shared and parameter.name not in own_directions

    names = {name: {key: key if shared(parameter, experiment) else f"{name}{separator}{key}"
                    for key, parameter in experiment.model.parameters.items()}
             for name, experiment in experiments.items()}
    statements: dict[str, Parameter] = {}
    for name, experiment in experiments.items():
        _check_laws(experiments, name)
        for key, parameter in experiment.model.parameters.items():
            first = statements.setdefault(names[name][key], parameter)
            if first is not parameter:
                _check_alike(first, parameter, experiment, any_unit)
    return names


def of_material(name: str, model: Model) -> bool:
    """Whether a degree of freedom belongs to a material rather than to the test."""
    element_set, _, parameter = name.partition(".")
    return any(element_set == material.element_set for material in model.materials) and "." not in parameter


def _check_options(experiments: Mapping[str, Experiment]) -> None:
    """Refuse experiments whose options of the common loop differ, or that do not allow the estimator."""
    (first, reference), *later_experiments = experiments.items()
    check_estimator(reference)
    for name, experiment in later_experiments:
        check_estimator(experiment)
        for key in LOOP_OPTIONS:
            reference_value, value = getattr(reference.options, key), getattr(experiment.options, key)
            if reference_value != value:
                raise InputError("experiments that are identified together share one schedule",
                                 file=experiment.folder, key=f"[options] {key}",
                                 expected=f"{_stated(reference_value)}, as in {first}",
                                 found=f"{_stated(value)} in {name}",
                                 remedy=f"make them equal, or use --set options.{key}=...")


def _stated(option: object) -> str:
    return "none given" if option is None else repr(option)


def _own_directions(experiments: Mapping[str, Experiment]) -> frozenset[str]:
    """Directions of a material, in degrees, that the experiments state differently: specimens cut along several
    axes."""
    statements: dict[str, set[tuple[float, bool]]] = {}
    for experiment in experiments.values():
        for name, p in experiment.model.parameters.items():
            if p.unit == "deg" and of_material(name, experiment.model):
                statements.setdefault(name, set()).add((p.value, p.free))
    return frozenset(name for name, ways in statements.items() if len(ways) > 1)


def _check_laws(experiments: Mapping[str, Experiment], name: str) -> None:
    for material in experiments[name].model.materials:
        for owner, record in experiments.items():
            for rival in record.model.materials:
                if rival.element_set == material.element_set and (rival.law, rival.kinematics) != (
                        material.law, material.kinematics):
                    raise InputError(f"the material {material.element_set} has another law in {owner} than in {name}",
                                     key=f"[material.{material.element_set}] law",
                                     expected=f"{material.law} ({material.kinematics})",
                                     found=f"{rival.law} ({rival.kinematics})",
                                     remedy="give both the same law, or the sets different names")


def _check_alike(first: Parameter, second: Parameter, experiment: Experiment, any_unit: bool) -> None:
    """Refuse two statements of a shared parameter that differ in more than its start."""
    first_statement, other_statement = (
        (p.free, p.transform, _dimension(p.unit) if any_unit else p.unit,
         *map(_without_rounding, (*p.bounds, p.prior_mean, p.prior_std, 0.0 if p.free else p.value)))
        for p in (first, second))
    if first_statement != other_statement:
        raise InputError(f"{first.name} is shared, but stated in two ways", file=experiment.folder, key=first.name,
                         expected=f"as in the first experiment: {_statement(first)}", found=_statement(second),
                         remedy="make value (if it is not identified), unit, identify, bounds and prior the same, or "
                                "give the element sets different names, or write shared = false")


def _without_rounding(value: float | None) -> float | None:
    """Of a conversion from another unit."""
    return value and float(f"{value:.12g}")


def _dimension(unit: str) -> object:
    parsed = parse_unit(unit)
    return unit if parsed is None else parsed.powers


def _statement(p: Parameter) -> str:
    prior = f", prior {p.prior_mean:g} ± {p.prior_std:g}" if p.prior_std else ""
    return (f"{p.shown:g} {p.unit}, {'identified' if p.free else 'not identified'}, bounds {p.bounds[0]:g} to "
            f"{p.bounds[1]:g}{prior}")


def _stages(experiments: Mapping[str, Experiment], names: Mapping[str, Mapping[str, str]]) -> tuple[Stage, ...]:
    """Stage k frees the union of the parameters of stage k of the experiments (the last one, where there are fewer).

    Its images are those of the first experiment whose stage k is preliminary.
    """
    count = max(len(experiment.stages) for experiment in experiments.values())
    stages = []
    for k in range(count):
        free_names: dict[str, None] = {}
        limits, images = [], Stage("all")
        for name, experiment in experiments.items():
            stage = experiment.stages[min(k, len(experiment.stages) - 1)] if experiment.stages else Stage("all")
            shared = set(names[name].values()) - {f"{name}.{n}" for n in names[name]}
            listed = experiment.model.parameters.free if stage.free == "all" else stage.free
            # an experiment without a schedule does not free shared parameters
            stage_names = [names[name][n] for n in listed if experiment.stages or names[name][n] not in shared]
            free_names |= dict.fromkeys(stage_names)
            limits += [stage.max_iterations] if stage.max_iterations is not None else []
            images = stage if is_preliminary(stage) and not is_preliminary(images) else images
        for experiment in experiments.values():
            check_images(experiment, images, k)
        stages.append(replace(images, free=tuple(free_names), max_iterations=max(limits) if limits else None))
    return tuple(stages)


def _among(system: CorrelationSystem, unknowns: Sequence[str], place: Sequence[int],
           channels: np.ndarray) -> CorrelationSystem:
    """The system of one experiment in the parameters and channels of all; the channels of others are not compared."""
    n, grid = len(unknowns), np.ix_(place, place)

    def spread(matrix: np.ndarray) -> np.ndarray:
        joint_matrix = np.zeros((n, n))
        joint_matrix[grid] = matrix
        return joint_matrix

    def among_channels(record: FrameRecord) -> FrameRecord:
        residual, columns = np.full(len(channels), np.nan), np.zeros((len(channels), 0))
        kept_shares = np.ones(len(channels))
        residual[channels] = record.channel_residual
        if len(record.channel_kept):
            kept_shares[channels] = record.channel_kept
        if record.channel_columns.shape[1] == len(place):
            columns = np.zeros((len(channels), n))
            columns[np.ix_(channels, place)] = record.channel_columns
        return replace(record, channel_residual=residual, channel_columns=columns, channel_kept=kept_shares)

    b, retention = np.zeros(n), None
    b[place] = system.b
    if system.retention is not None:
        retention = np.tile(np.eye(len(system.frames)), (len(channels), 1, 1))
        retention[channels] = system.retention
    return replace(system, names=tuple(unknowns), M=spread(system.M), b=b, spread=spread(system.spread),
                   shared=np.zeros((0, n)), sums=None, frames=tuple(among_channels(record) for record in system.frames),
                   retention=retention,
                   predicted=None if system.predicted is None else spread(system.predicted),
                   end_noise=None if system.end_noise is None else spread(system.end_noise))


def _sum(systems: Sequence[CorrelationSystem]) -> CorrelationSystem:
    """The sum in the given order; systems without a prediction of generalised least squares add their M to it."""
    predicted = None
    if any(system.predicted is not None for system in systems):
        predicted = sum(system.M if system.predicted is None else system.predicted for system in systems)
    end_noises = [system.end_noise for system in systems if system.end_noise is not None]
    return replace(systems[0], M=sum(s.M for s in systems), b=sum(s.b for s in systems),
                   phi=sum(s.phi for s in systems), phi_image=sum(s.phi_image for s in systems),
                   spread=sum(s.spread for s in systems), frames=tuple(r for s in systems for r in s.frames),
                   generalised=any(s.generalised for s in systems), predicted=predicted,
                   end_noise=sum(end_noises) if end_noises else None, retention=_joint_retention(systems))


def _joint_retention(systems: Sequence[CorrelationSystem]) -> np.ndarray | None:
    """`CorrelationSystem.retention` over the frames of all experiments; every system has the channels of all"""
    if all(system.retention is None for system in systems):
        return None
    count = len(systems[0].frames[0].channel_residual)
    return np.array([scipy.linalg.block_diag(*(system.retention_of(k) for system in systems))
                     for k in range(count)])
