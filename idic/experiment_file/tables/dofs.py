"""The parameters of an experiment: constants of its materials, and the further degrees of freedom of [[dof]]."""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from idic.errors import InputError
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.experiment_file.schema.materials import DofTable, MaterialTable, ParameterTable
from idic.experiment_file.tables.camera_motion import motion_parameters, scanner_parameters
from idic.experiment_file.tables.lens_dofs import lens_dofs, placement_dofs
from idic.experiment_file.tables.solver import foreign_material
from idic.fe import EXTERNAL
from idic.images import AnyCamera, CAMERA_PARAMETERS, PlacedCamera, Scanner
from idic.laws import EXPANSION, KELVIN, LawParameter, LawSpec, law_for
from idic.model import (
    CHANNEL_TERMS, Channel, Column, FurtherCamera, Load, Material, Prescribed, boundary_parameters,
    is_camera_time, load_parameters,
)
from idic.parameters import Parameter
from idic.readers import factor_between

CAMERA_MAX_STEP = 3.5  # units of a camera's scales: 10 px at the corner of the image


# materials --------------------------------------------------------------------------------------------
def material(name: str, table: MaterialTable, file) -> tuple[Material, list[Parameter], list[str]]:
    """The record of one material, its parameters ``NAME.parameter`` in the order of the law, and notes.

    Raises
    ------
    InputError
        The law is unknown, lacks these kinematics, or a parameter is unknown, missing, out of bounds or in a wrong
        unit.
    """
    key = f"material.{name}"
    if table.law == EXTERNAL:
        return foreign_material(name, table, file)
    law = _law(table.law, table.parameters, file, key)
    kinematics = table.kinematics or law.kinematics[0]
    if kinematics not in law.kinematics:
        raise InputError(f"{law.name} does not support these kinematics", file=file, key=f"{key}.kinematics",
                         expected=" or ".join(law.kinematics),
                         found=kinematics, remedy="leave kinematics out")
    stated_entries = {name_: entry for name_, entry in table.parameters.items() if name_ != EXPANSION.name}
    entries, notes = _own_names(law, stated_entries, file, key)
    parameters = []
    for declared in law.parameters:
        entry = entries.get(declared.name)
        if entry is None:
            if declared.null is None:
                raise InputError("a parameter of the law is missing", file=file, key=f"{key}.{declared.name}",
                                 remedy=f"add e.g.  {_example(declared)}",
                                 expected=f"{declared.name} ({declared.description}, {declared.unit})",
                                 found=f"only {', '.join(table.parameters) or 'none'}")
            entry = ParameterTable.model_construct(value=declared.null)  # unchecked: the null may be infinite
            notes.append(f"{key}.{declared.name} not given: {declared.null:g} (no effect)")
        parameters.append(_parameter(f"{name}.{declared.name}", declared, entry, file, f"{key}.{declared.name}"))
    reason = law.why_impossible([parameter.value for parameter in parameters])
    if reason:
        raise InputError("no body has these parameters together", file=file, key=key, found=reason,
                         expected="parameters of a body that resists every strain", remedy="correct the values")
    if EXPANSION.name in table.parameters:
        parameters.append(_parameter(f"{name}.{EXPANSION.name}", EXPANSION, table.parameters[EXPANSION.name], file,
                                     f"{key}.{EXPANSION.name}"))
    return Material(name, law.name, kinematics), parameters, notes


def _law(name: str, parameters: Iterable[str], file, key) -> LawSpec:
    try:
        return law_for(name, parameters)
    except InputError as error:
        raise InputError(error.what, file=file, key=f"{key}.law", expected=error.expected, found=error.found,
                         remedy=error.remedy) from None


def _example(declared: LawParameter) -> str:
    value = f"{declared.default:g}" if declared.default is not None else "1.0"
    unit = f', unit = "{declared.unit}"' if declared.unit not in ("-", "") else ""
    return f"{declared.name} = {{ value = {value}{unit}, identify = true }}"


def _own_names(law: LawSpec, entries: Mapping[str, ParameterTable], file,
               key) -> tuple[dict[str, ParameterTable], list[str]]:
    """The given parameters under the law's own names; other pairs of elastic constants are converted."""
    unknown = [name for name in entries if name not in law.parameter_names]
    if not unknown:
        return dict(entries), []
    for names, convert in law.alternatives.items():
        other_names = [name for name in entries if name not in names]
        if set(names) <= set(entries) and set(unknown) <= set(names) and set(other_names) <= set(law.parameter_names):
            return _converted(law, entries, names, convert, other_names, file, key)
    matches = difflib.get_close_matches(unknown[0], law.parameter_names, n=1, cutoff=0.5)
    pairs = "".join(f"; or {', '.join(names)}" for names in law.alternatives)
    raise InputError(f"{law.name} has no such parameter", file=file, key=f"{key}.{unknown[0]}",
                     expected=", ".join(law.parameter_names) + pairs,
                     found=unknown[0], remedy=f"did you mean {matches[0]}?" if matches
                     else "remove it, or choose another law:  idic laws")


_ALTERNATIVE_UNITS = {"nu": "-"}  # K, G, E, lam, mu are moduli


def _converted(law, entries, names, convert, other_names, file, key):
    values = []
    for name in names:
        entry = entries[name]
        if entry.bounds is not None or entry.prior is not None:
            raise InputError(f"bounds and priors belong to {', '.join(law.parameter_names[:2])}", file=file,
                             key=f"{key}.{name}",
                             expected=f"{name} with value, unit, identify only", found="bounds or prior",
                             remedy=f"give {', '.join(law.parameter_names[:2])} instead")
        unit = _ALTERNATIVE_UNITS.get(name, "MPa")
        values.append(entry.value * (factor_between(entry.unit, unit, file=file, key=f"{key}.{name}.unit")
                                     if entry.unit else 1.0))
    arguments = dict(zip(names, values, strict=True))
    with np.errstate(all="ignore"):
        by_name = set(inspect.signature(convert).parameters) == set(names)
        constants = convert(**arguments) if by_name else convert(*values)
    identify = any(entries[name].identify for name in names)
    converted_entries = {name: entries[name] for name in other_names}
    converted_entries |= {name: ParameterTable.model_construct(value=float(value), unit=None, identify=identify,
                                                               bounds=None, prior=None)
                          for name, value in constants.items()}
    values_text = ", ".join(f"{name} = {value:g}" for name, value in constants.items())
    return converted_entries, [f"{key}: {', '.join(names)} were converted to {values_text}"]


def _parameter(name: str, declared: LawParameter, entry: ParameterTable, file, key) -> Parameter:
    if declared.unit == "C" and entry.unit == "K":
        raise InputError("a temperature in K", file=file, key=f"{key}.unit", expected=f"{declared.description}, in °C",
                         found=f"{entry.value:g} K", remedy=f'write {{ value = {entry.value - KELVIN:g}, unit = "C" }}')
    factor = factor_between(entry.unit, declared.unit, file=file, key=f"{key}.unit") if entry.unit is not None else 1.0
    value = entry.value * factor
    low, high = declared.bounds
    if entry.bounds is not None:
        low, high = max(low, entry.bounds[0] * factor), min(high, entry.bounds[1] * factor)
    open_below = declared.positive and low == 0.0 and value != declared.null
    allowed = low <= value <= high and not (open_below and value == 0.0)
    if not ((np.isfinite(value) or value == declared.null) and allowed):
        raise InputError(f"{declared.description}: the value is out of range", file=file, key=key,
                         expected=f"{low / factor:g} … {high / factor:g} {entry.unit or declared.unit}",
                         found=f"{entry.value:g}", remedy="correct the value, or its unit")
    log = declared.positive and value > 0.0 and low >= 0.0
    if entry.identify and declared.positive and not log:
        raise InputError("a positive parameter cannot start at zero", file=file, key=key,
                         expected="a start value above zero", found=f"{entry.value:g}",
                         remedy="start from a small value, or lock it with identify = false")
    prior = entry.prior
    return Parameter(name, value, entry.unit or ("" if declared.unit == "-" else declared.unit), entry.identify,
                     (low, high),
                     None if prior is None else prior.mean * factor, None if prior is None else prior.std * factor,
                     "log" if log else "linear", _scale(declared, value), factor, declared.max_step,
                     declared.start_values, declared.stabilising_factor, declared.activation_factor, entry.shared)


def _scale(declared: LawParameter, value: float) -> float:
    if declared.unit == "deg":
        return 10.0
    if declared.unit == "-" and not declared.positive and np.isfinite(declared.bounds).all():
        return 0.3  # Poisson's ratio and similar; the longest step is a third of this
    if declared is EXPANSION:
        return max(abs(value), 1e-4)  # steps of up to 3e-5/K for any start value: a few reach metals and polymers
    if declared.unit == "-" and not declared.positive and declared.bounds[0] == 0.0:
        return 1.0  # a weight, of which many are zero
    return abs(value) if value else abs(declared.default or 1.0)


# [[dof]] ------------------------------------------------------------------------------------------------
def degrees_of_freedom(config: ExperimentFile, camera: AnyCamera, channels: tuple[Channel, ...],
                       prescribed: tuple[Prescribed, ...], thickness: float | None, times: np.ndarray | None,
                       length_unit: str, image_shape, materials: list[Parameter], file,
                       cameras: tuple[FurtherCamera, ...] = (), holes: tuple[Parameter, ...] = (),
                       loads: tuple[Load, ...] = (), calibrated: tuple[str, ...] = (),
                       knots: Sequence[Parameter] = ()) -> list[Parameter]:
    """The parameters of [[dof]] and those of drives, loads and camera motions.

    camera, image_shape : of the main camera; cameras : the further cameras; holes : parameters of `tables.geometry`;
    calibrated : values of a calibration that are degrees of freedom without a [[dof]]; knots : of a temperature.

    Raises
    ------
    InputError
        A name is unknown in this experiment or given twice, a unit is wrong, or friction has no motion.
    """
    catalogue = {p.name: p for p in boundary_parameters(prescribed, camera.pixel_size, length_unit)}
    uncertain = {p.name: p for p in load_parameters(loads)}
    # in order: every process numbers alike
    known_by_drive = (*catalogue, *(p.name for p in uncertain.values() if p.free))
    catalogue |= uncertain
    main = "camera" if config.camera is None else config.camera.name
    moves = motion_parameters(main, camera, image_shape)
    if isinstance(camera, Scanner):
        moves += scanner_parameters(camera, image_shape, config.scanner is not None and config.scanner.motion == "free")
    for view in cameras:
        moves += motion_parameters(view.name, view.camera, view.stack.shape)
    seen_by = {main: (camera, image_shape)} | {view.name: (view.camera, view.stack.shape) for view in cameras}
    placed = [(c, shape) for c, shape in seen_by.values() if isinstance(c, PlacedCamera)]
    of_placement, motions = placement_dofs(*placed[0]) if placed else ({}, [])
    moves += motions
    catalogue |= {p.name: p for p in moves}
    known_by_drive = (*known_by_drive, *(p.name for p in moves if p.free))
    for name, (by, shape) in () if isinstance(camera, Scanner) else seen_by.items():
        catalogue |= (lens_dofs(name, by, shape) if isinstance(by, PlacedCamera)
                      else _camera_dofs(name, by, length_unit, shape))
    catalogue |= of_placement | _camera_times(config, cameras, times)
    of_channels = _channel_dofs(channels, times, prescribed)
    _require_way(channels, of_channels, prescribed, file)
    catalogue |= of_channels
    known_by_drive = (*known_by_drive, *(p.name for p in of_channels.values() if p.free))
    catalogue |= {p.name: p for p in knots}
    known_by_drive = (*known_by_drive, *(p.name for p in knots))
    catalogue |= _other_dofs(thickness, times, length_unit) | {p.name: p for p in holes}
    parameters = {name: catalogue[name] for name in known_by_drive}
    parameters |= {name: replace(catalogue[name], free=True) for name in calibrated}
    material_names = {p.name for p in materials}
    names: set[str] = set()
    for number, entry in enumerate(config.dof):
        key = f"dof[{number}].name"
        if entry.name in names or entry.name in material_names:
            place = "in [material]" if entry.name in material_names else "in another [[dof]]"
            raise InputError("a degree of freedom is given twice", file=file, key=key, expected="every name once",
                             found=f"{entry.name}, also {place}", remedy="leave one of them out")
        names.add(entry.name)
        if entry.name not in catalogue:
            raise _unknown(entry.name, catalogue, material_names, file, key)
        parameters[entry.name] = _dof(catalogue[entry.name], entry, file, f"dof[{number}]")
        if is_camera_time(entry.name) and not entry.identify and parameters[entry.name].value:
            raise InputError("a time offset of a camera that is not identified", file=file,
                             key=f"dof[{number}].identify", found="false",
                             expected="true: the images show it better than a clock",
                             remedy="leave identify out; prior = { mean = …, std = … } holds it near a value")
    return list(parameters.values())


def _camera_times(config: ExperimentFile, cameras: Sequence[FurtherCamera],
                  times: np.ndarray | None) -> dict[str, Parameter]:
    """How much later than the main camera each further one takes its images: in s, in frames without times."""
    interval, unit = (1.0, "") if times is None or len(times) < 2 else (float(np.median(np.diff(times))), "s")
    return {} if config.solver is not None else {
        name: Parameter(name, 0.0, unit, scale=interval) for name in (view.time_offset for view in cameras)}


def start_of_time_offset(config: ExperimentFile, file) -> float:
    """The start value of ``time.offset`` (s), 0 where the file gives none."""
    for number, entry in enumerate(config.dof):
        if entry.name == "time.offset" and entry.value is not None:
            factor = factor_between(entry.unit, "s", file=file, key=f"dof[{number}].unit") if entry.unit else 1.0
            return entry.value * factor
    return 0.0


def _dof(parameter: Parameter, entry: DofTable, file, key) -> Parameter:
    factor = factor_between(entry.unit, parameter.unit, file=file, key=f"{key}.unit") if entry.unit is not None else 1.0
    value = parameter.value if entry.value is None else entry.value * factor
    low, high = parameter.bounds
    if entry.bounds is not None:
        low, high = max(low, entry.bounds[0] * factor), min(high, entry.bounds[1] * factor)
    if not low <= value <= high:
        raise InputError("the start value is outside its bounds", file=file, key=f"{key}.value",
                         expected=f"{low / factor:g} … {high / factor:g} {entry.unit or parameter.unit}",
                         found=f"{value / factor:g}", remedy="move the value or the bounds")
    prior = entry.prior
    return replace(parameter, value=value, unit=entry.unit or parameter.unit, free=entry.identify, bounds=(low, high),
                   prior_mean=None if prior is None else prior.mean * factor,
                   prior_std=None if prior is None else prior.std * factor, factor=factor)


def _camera_dofs(camera_name: str, camera: AnyCamera, length_unit: str, image_shape) -> dict[str, Parameter]:
    """Degrees of freedom of a camera; a unit step moves the mesh at the image corner by about three pixels.

    The longest step is ten pixels. It moves reference and deformed positions alike: the compared grey values shift only
    by the step times the motion relative to the image size.
    """
    half = 0.5 * float(np.hypot(*image_shape))  # px from the middle to a corner
    size, values = camera.pixel_size, camera.values()
    dofs = {}
    for name, kind in CAMERA_PARAMETERS.items():
        bounds = (1e-3 * size, 1e3 * size) if name == "pixel_size" else (-np.inf, np.inf)
        dofs[f"{camera_name}.{name}"] = Parameter(
            f"{camera_name}.{name}", values[name], kind.unit.replace("mm", length_unit), bounds=bounds,
            scale=kind.scale(half, size), max_step=CAMERA_MAX_STEP)
    return dofs


def _channel_dofs(channels: tuple[Channel, ...], times: np.ndarray | None,
                  prescribed: tuple[Prescribed, ...]) -> dict[str, Parameter]:
    return {parameter.name: parameter for channel in channels for term in CHANNEL_TERMS
            for parameter in term.parameters(channel, times, prescribed)}


def _require_way(channels: tuple[Channel, ...], catalogue: Mapping[str, Parameter], prescribed: tuple[Prescribed, ...],
                 file) -> None:
    undirected = [(number, term.course) for term in CHANNEL_TERMS if term.course and term.course.is_directed
                  for number, channel in enumerate(channels)
                  if any(channel.dof(name) not in catalogue for name in channel.hats_of(term.course.stem))]
    for number, course in undirected[:1]:
        logged = [entry.drive.column for entry in prescribed if isinstance(entry.drive, Column)]
        raise InputError(f"{course.stem} without a logged motion", file=file, key=f"channel[{number}].{course.knots}",
                         expected=f"a boundary that a column of the log moves: {course.stem} opposes its direction",
                         found=f"{', '.join(logged)} without motion" if logged else "none",
                         remedy=f'leave {course.knots} out, or drive a [[boundary]] with {{ column = "grip_mm" }}')


def _other_dofs(thickness: float | None, times: np.ndarray | None, length_unit: str) -> dict[str, Parameter]:
    dofs = {}
    if thickness is not None:
        dofs["geometry.thickness"] = Parameter("geometry.thickness", thickness, length_unit, bounds=(0.0, np.inf),
                                               transform="log", scale=thickness)
    if times is not None and len(times) > 1:
        dofs["time.offset"] = Parameter("time.offset", 0.0, "s", scale=float(np.median(np.diff(times))))
    return dofs


def _unknown(name: str, catalogue: Mapping[str, Parameter], material_names: set[str], file, key) -> InputError:
    reason = ""
    if name.startswith("geometry.hole"):
        reason = "holes have hole_x, hole_y, hole_radius, of several holes [1], [2], ...; "
    elif name == "geometry.thickness":
        reason = "thickness_mm is not given; "
    elif name == "time.offset" or name.endswith(".drift"):
        reason = "the frames have no times; "
    matches = difflib.get_close_matches(name, catalogue, n=1, cutoff=0.6)
    return InputError("no such degree of freedom in this experiment", file=file, key=key,
                      expected=f"one of {', '.join(catalogue)}", found=repr(name),
                      remedy=reason + (f"did you mean {matches[0]}?" if matches else "remove the entry"))
