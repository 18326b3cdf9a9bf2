"""The temperature of every node in every frame, from the recording: columns on node sets, fields on the mesh.

Later records win where they overlap. Nodes that no record covers get their temperature by steady conduction from the
others (`idic.fe.conduction`): two thermocouples make a linear course between two grips, one makes a uniform body.
Thermal expansion needs only the change since the reference frame, for which K and °C are the same; laws whose
parameters depend on the temperature take °C.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from idic.errors import InputError
from idic.fe import conducted
from idic.model.records.model import Model
from idic.model.records.parts import Column
from idic.model.records.free_course import TEMPERATURE, knot_name
from idic.parameters import ParameterSet


@dataclass(frozen=True)
class NodalTemperature:
    """values : (n_frames, n_nodes) K, change since the reference frame; rates : its derivative by a time shift of the
    log (``time.offset``), K/s; None where no logged column takes part; start : (n_nodes,) °C at the reference frame,
    which no shift changes; knots : of a course that the data give, by the names of its degrees of freedom, alike at all
    nodes  # name -> (n_frames,)"""

    values: np.ndarray
    rates: np.ndarray | None
    start: np.ndarray
    knots: Mapping[str, np.ndarray] = field(default_factory=dict)

    def unchanged(self, n_frames: int) -> NodalTemperature:
        """The temperature of the reference frame, kept for so many frames."""
        nothing = np.zeros((n_frames, len(self.start)))
        return NodalTemperature(nothing, None if self.rates is None else nothing, self.start,
                                dict.fromkeys(self.knots, nothing[:, 0]))

    def at(self, time_offset: float, parameters: ParameterSet) -> np.ndarray:
        """Change of temperature with the log shifted by so many seconds, and the knots  # (n_frames, n_nodes)"""
        values = self.values if self.rates is None else self.values + time_offset * self.rates
        for name, hat in self.knots.items():
            values = values + parameters[name].value * hat[:, None]
        return values


def nodal_temperature(model: Model) -> NodalTemperature | None:
    """Change of temperature of an experiment; None where it has no temperatures.

    Raises
    ------
    InputError
        Values of another size than frames and nodes, or a piece of the mesh that no temperature reaches.
    """
    if not model.temperatures:
        return None
    shape = (model.n_frames, model.mesh.n_nodes)
    values, rates, shifts = np.full(shape, np.nan), np.full(shape, np.nan), False
    above = np.zeros(shape)  # °C
    for entry in model.temperatures:
        nodes = np.arange(shape[1]) if entry.nodes is None else np.asarray(model.mesh.node_sets[entry.nodes])
        if isinstance(entry.drive, Column):
            nodal_values = np.broadcast_to(np.asarray(entry.drive.values, float)[:, None], (shape[0], len(nodes)))
            rate = entry.drive.rates
        else:
            _require_shape(entry.drive.values, shape, entry.drive.source)
            nodal_values, rate = entry.drive.values[:, nodes], None  # one image per frame: no clock of its own
        has_value = ~np.isnan(nodal_values)
        values[:, nodes] = np.where(has_value, nodal_values, values[:, nodes])
        above[:, nodes] = np.where(has_value, entry.above_celsius, above[:, nodes])
        slope = np.zeros(shape[0]) if rate is None else rate
        rates[:, nodes] = np.where(has_value, slope[:, None], rates[:, nodes])
        shifts = shifts or rate is not None
    reference = model.reference
    start = conducted(model.mesh, (values - above)[reference][None])[0]
    values = conducted(model.mesh, values)
    rates = conducted(model.mesh, rates) if shifts else None
    knots = {knot_name(TEMPERATURE, frame): hat for entry in model.temperatures
             for frame, hat in zip(entry.knots, () if entry.hats is None else entry.hats, strict=True)}
    return NodalTemperature(values - values[reference], None if rates is None else rates - rates[reference], start,
                            knots)


def _require_shape(values: np.ndarray, shape: tuple[int, int], source: str) -> None:
    if np.shape(values) != shape:
        raise InputError("a temperature field of another size", key=source, expected=f"{shape}: frames, nodes",
                         found=str(np.shape(values)),
                         remedy="give one row per frame and one column per node of the mesh")
