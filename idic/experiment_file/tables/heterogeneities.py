"""Converts [[heterogeneity]] into records and parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.errors import InputError
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.experiment_file.schema.materials import HeterogeneityTable, ParameterTable
from idic.fe import Mesh
from idic.model import Heterogeneity, nodes_of
from idic.parameters import Parameter
from idic.readers import factor_between

VOID_STIFFNESS_RATIO = 1e-3  # stiffness of a void: small, and still solvable
GRADIENT_BOUNDS = (-0.95, 0.95)  # the stiffness stays positive along one axis
SPOT_BOUNDS = (1e-4, 1e3)
SHARE_BOUNDS = (0.05, 0.95)  # of the stiff layers in a period
DIRECTION_SCALE_DEG = 10.0


def heterogeneities(config: ExperimentFile, mesh: Mesh, length_unit: str,
                    file) -> tuple[tuple[Heterogeneity, ...], list[Parameter]]:
    """All of [[heterogeneity]]; length_unit : "mm", or "px" where no scale is known.

    Raises
    ------
    InputError
        A set has no material, a name is taken, a spot touches no element of its set, or a unit is wrong.
    """
    records, parameters = [], []
    for number, table in enumerate(config.heterogeneity):
        key, name = f"heterogeneity[{number}]", table.name or table.form
        if table.set not in config.material:
            raise InputError("a heterogeneity of a set without a material", file=file, key=f"{key}.set",
                             expected=f"one of {', '.join(config.material)}", found=table.set, remedy="correct the set")
        if any((earlier.element_set, earlier.name) == (table.set, name) for earlier in records):
            raise InputError("two heterogeneities of one name", file=file, key=f"{key}.name",
                             expected="different names within one set", found=name,
                             remedy='add e.g. name = "second"')
        record = Heterogeneity(table.set, name, table.form)
        records.append(record)
        amounts = (_gradient(table, mesh, key, file) if table.form == "gradient"
                   else _layers(table, mesh, length_unit, key, file) if table.form == "layers"
                   else _spot(table, record, mesh, length_unit, key, file))
        parameters += [_named(f"{table.set}.{name}.{suffix}", parameter) for suffix, parameter in amounts.items()]
    return tuple(records), parameters


def _spot(table: HeterogeneityTable, record: Heterogeneity, mesh: Mesh, length_unit: str, key: str,
          file) -> dict[str, Parameter]:
    amount = table.thickness if table.form == "thickness" else table.stiffness
    if amount is None:
        void = table.form == "void"
        amount = ParameterTable(value=VOID_STIFFNESS_RATIO) if void else ParameterTable(value=1.0, identify=True)
    parameters = {record.amount: _parameter(amount, "", f"{key}.{record.amount}", file, SPOT_BOUNDS, "log")}
    radius = _parameter(table.radius_mm, length_unit, f"{key}.radius_mm", file, (0.0, np.inf), "log")
    centre = np.array(table.centre_mm)
    if len(centre) > mesh.n_dim:
        raise InputError("the centre has more coordinates than the model", file=file, key=f"{key}.centre_mm",
                         expected="[x, y]", found=str(table.centre_mm), remedy="leave out the third coordinate")
    places = mesh.nodes[nodes_of(mesh, table.set), :len(centre)]
    if not np.linalg.norm(places - centre, axis=1).min() < 2.0 * radius.value:
        raise InputError("a heterogeneity outside the body", file=file, key=f"{key}.centre_mm",
                         expected=f"a centre in {table.set}", found=str(table.centre_mm),
                         remedy="correct the centre or the radius")
    parameters["radius"] = radius
    for axis, value in zip("xyz", centre, strict=False):
        parameters[axis] = Parameter("", float(value), length_unit, table.identify_centre, scale=radius.value)
    return parameters


def _gradient(table: HeterogeneityTable, mesh: Mesh, key: str, file) -> dict[str, Parameter]:
    parameters = {}
    for axis in "xyz":
        slope = getattr(table, f"along_{axis}")
        if slope is not None and "xyz".index(axis) >= mesh.n_dim:
            raise InputError("a gradient along z in a plane model", file=file, key=f"{key}.along_{axis}",
                             expected="along_x or along_y", found=f"along_{axis}", remedy="leave it out")
        if slope is not None:
            parameters[f"along_{axis}"] = _parameter(slope, "", f"{key}.along_{axis}", file, GRADIENT_BOUNDS, "linear",
                                                     0.3)
    return parameters


def _layers(table: HeterogeneityTable, mesh: Mesh, length_unit: str, key: str, file) -> dict[str, Parameter]:
    """The period is at most the size of the set: wider layers are a gradient."""
    nodes = mesh.nodes[nodes_of(mesh, table.set), :2]
    size = float(np.linalg.norm(np.ptp(nodes, axis=0)))
    ratio = table.stiffness_ratio or ParameterTable(value=1.0, identify=True)
    parameters = {"stiffness_ratio": _parameter(ratio, "", f"{key}.stiffness_ratio", file, SPOT_BOUNDS, "log"),
                  "period": _parameter(table.period_mm, length_unit, f"{key}.period_mm", file, (1e-6 * size, size),
                                       "log"),
                  "direction": _parameter(table.direction_deg, "deg", f"{key}.direction_deg", file, (-np.inf, np.inf),
                                          "linear", DIRECTION_SCALE_DEG)}
    offset = table.offset_mm or ParameterTable(value=0.0)
    parameters["offset"] = _parameter(offset, length_unit, f"{key}.offset_mm", file, (-np.inf, np.inf), "linear",
                                      0.25 * parameters["period"].value)
    share = table.share or ParameterTable(value=0.5)
    return parameters | {"share": _parameter(share, "", f"{key}.share", file, SHARE_BOUNDS, "linear", 0.2)}


def _parameter(entry: ParameterTable, unit: str, key: str, file, bounds: tuple[float, float], transform: str,
               scale: float = 1.0) -> Parameter:
    """The value with its bounds; the name comes later."""
    factor = factor_between(entry.unit, unit, file=file, key=f"{key}.unit") if entry.unit is not None else 1.0
    low, high = bounds if entry.bounds is None else (max(bounds[0], entry.bounds[0] * factor),
                                                     min(bounds[1], entry.bounds[1] * factor))
    value, prior = entry.value * factor, entry.prior
    if not low <= value <= high or (transform == "log" and value <= 0.0):
        raise InputError("the value is out of range", file=file, key=key,
                         expected=f"{low / factor:g} … {high / factor:g}", found=f"{entry.value:g}",
                         remedy="correct the value, or its unit")
    return Parameter("", value, entry.unit or unit, entry.identify, (low, high),
                     None if prior is None else prior.mean * factor, None if prior is None else prior.std * factor,
                     transform, scale, factor)


def _named(name: str, parameter: Parameter) -> Parameter:
    return replace(parameter, name=name)
