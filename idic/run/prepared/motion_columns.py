"""Derivatives of a stored motion by the parameters, from the derivatives of the equilibrium or from simulations."""

from __future__ import annotations

import numpy as np

from idic.errors import InputError
from idic.parameters import ParameterSet
from idic.run.prepared.context import RunContext
from idic.run.store.arrays import FrameArrays
from idic.run.store.layout import BASE, group_name
from idic.run.store.schemas.groups import StoredSimulation


def motion_columns(context: RunContext, point: int, frame: int, parameters: ParameterSet) -> np.ndarray:
    """du/dparameter of one frame, by whichever way it was computed  # (n_nodes, dim, n_moving) mm per unit"""
    base = context.store.group(group_name(point, BASE))
    if (base / "du").exists():
        return stored_frame(context, point, BASE, "du", frame)
    u = stored_frame(context, point, BASE, "u", frame)
    columns = []
    for name in context.moving:
        change = _changed_value(context, point, name) - parameters[name].value
        columns.append((stored_frame(context, point, name, "u", frame) - u) / change)
    return np.stack(columns, axis=-1)


def _changed_value(context: RunContext, point: int, name: str) -> float:
    """The value of a parameter in the simulation that changes it."""
    folder = context.store.group(group_name(point, name))
    values = context.store.ident(folder, StoredSimulation)["values"]
    if name not in values:
        raise InputError("a stored simulation belongs to other parameters", file=folder, expected=name,
                         found=", ".join(values) or "none", remedy="identify the experiment again into a new RUN")
    return float.fromhex(values[name])


def stored_frame(context: RunContext, point: int, label: str, name: str, frame: int) -> np.ndarray:
    """An array of a simulation in one frame of the recording."""
    k = frame - context.experiment.model.reference
    return FrameArrays.open(context.store.group(group_name(point, label)), name).read(k, k + 1)[0]
