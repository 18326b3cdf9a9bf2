"""What points, extensometers, lines and circles read from a series of fields, with the noise of the measurement."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from idic.measure.fields.series import FieldSeries, component_of
from idic.measure.fields.strain import strain
from idic.measure.fields.surface import Surface
from idic.model import Gauge

STRAINS = ("xx", "yy", "xy", "1", "2")
_NO_WEIGHT = 1e-12  # of a node in the value of a point: a node that is not seen must not hide it


@dataclass(frozen=True, eq=False)
class Reading:
    """One quantity of one gauge over the frames of a series.

    Attributes
    ----------
    quantity : str
        ``elongation``, ``strain`` (of an extensometer, change of length over length), ``u_x``, ``strain_xx``
        (Green-Lagrange; 1 and 2: principal), ``stress_xx``, ``plastic_strain``, ...
    unit : str
    simulated : (m,) or, of a line, (m, samples)
    measured, std : the same or None
        std : noise of the measurement.
    """

    gauge: Gauge
    quantity: str
    unit: str
    simulated: np.ndarray
    measured: np.ndarray | None = None
    std: np.ndarray | None = None


def readings(series: FieldSeries, gauge: Gauge) -> tuple[Reading, ...]:
    """Everything that a gauge reads; samples of a line outside the surface are NaN."""
    weights = _Weights(series.surface, gauge)
    return tuple(_extensometer(series, gauge, weights) if gauge.kind == "extensometer"
                 else _fields(series, gauge, weights))


class _Weights:
    """From nodal values to the places of a gauge."""

    def __init__(self, surface: Surface, gauge: Gauge):
        weights, self.inside = surface.weights(gauge.places)
        weights.data[np.abs(weights.data) < _NO_WEIGHT] = 0.0
        weights.eliminate_zeros()
        self.matrix, self.kind = weights, gauge.kind

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """(m, n, ...) at nodes -> (m, ...) of a point or circle, (m, places, ...) of a line or extensometer"""
        flat = np.moveaxis(values, 1, 0).reshape(values.shape[1], -1)
        readings = self.matrix @ flat
        readings[~self.inside] = np.nan
        readings = np.moveaxis(readings.reshape(-1, values.shape[0], *values.shape[2:]), 0, 1)
        if self.kind == "probe":
            return readings[:, 0]
        return readings[:, self.inside].mean(axis=1) if self.kind == "circle" else readings


def _extensometer(series: FieldSeries, gauge: Gauge, at: _Weights) -> Iterator[Reading]:
    """Elongation and strain of the straight distance of two points."""
    start = np.diff(np.array(gauge.points_mm), axis=0)[0]
    rest_length = float(np.hypot(*start))

    def length(u: np.ndarray) -> np.ndarray:
        return np.hypot(*(start + np.diff(u, axis=1)[:, 0]).T) - rest_length

    simulated = at(series.simulated)
    elongation = length(simulated)
    measured = None if series.measured is None else length(at(series.measured))
    std = None
    if series.noise is not None and measured is not None:
        noise = at(series.noise)
        std = np.array([_std(length(u + noise), length(u[None])) for u in simulated])
    for quantity, unit, size in (("elongation", series.unit, 1.0), ("strain", "-", rest_length)):
        yield Reading(gauge, quantity, unit, elongation / size, None if measured is None else measured / size,
                      None if std is None else std / size)


def _fields(series: FieldSeries, gauge: Gauge, at: _Weights) -> Iterator[Reading]:
    """Displacement, strain, stress and state of a point, of the points of a line, or as the mean of a circle."""
    u, v = at(series.simulated), None if series.measured is None else at(series.measured)
    noise = None if series.noise is None or v is None else at(series.noise)
    for axis, name in enumerate("xy"):
        std = None if noise is None else np.broadcast_to(_std(noise[..., axis], 0.0), u[..., axis].shape)
        yield Reading(gauge, f"u_{name}", series.unit, u[..., axis], None if v is None else v[..., axis], std)
    for name, values in series.depth.items():
        depth = series.measured_depth.get(name)
        depth_std = None if depth is None or series.depth_noise is None else _std(at(series.depth_noise), 0.0)
        reading = at(values)
        yield Reading(gauge, name, series.unit, reading, None if depth is None else at(depth),
                      None if depth_std is None else np.broadcast_to(depth_std, reading.shape))
    E, E_measured = at(series.strain()), None if v is None else at(series.strain(source="measured"))
    for name in STRAINS:
        yield Reading(gauge, f"strain_{name}", "-", component_of(E, name),
                      None if E_measured is None else component_of(E_measured, name),
                      None if noise is None else _strain_std(series, at, name))
    if series.stress is not None:
        stress = at(series.stress)
        for name in ("xx", "yy", "xy"):
            yield Reading(gauge, f"stress_{name}", series.stress_unit, component_of(stress, name))
    for name, values in series.states.items():
        yield Reading(gauge, name, "-", at(values))


def _strain_std(series: FieldSeries, at: Callable, component: str) -> np.ndarray:
    """See `FieldSeries.strain_std`, at the places of the gauge."""
    deviations = []
    for F in series.F:
        noiseless = component_of(at(strain(F)[None]), component)
        deviations.append(_std(component_of(at(strain(F + series.F_noise)), component), noiseless))
    return np.array(deviations)


def _std(values: np.ndarray, noiseless: np.ndarray | float) -> np.ndarray:
    return np.sqrt(np.mean((values - noiseless) ** 2, axis=0))
