"""Histories of the loads: the log, its noise, and the scale and offset of an uncertain load.

    value(t_k) = scale (logged(t_k) + time.offset d logged/dt) + offset + w_k,      w_k ~ N(0, noise_std)

``w_k`` is an unknown of its frame alone (the noise of the log); scale and offset are the degrees of freedom
``boundary.EDGES.pressure.scale`` and ``.offset`` (``boundary.EDGES.force.x.scale`` for a force along x).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.model.records.model import Model
from idic.model.records.parts import Column, Constant, Load
from idic.parameters import Parameter, ParameterSet

UNITS = {"pressure": "MPa", "traction": "MPa", "force": "N"}


@dataclass(frozen=True)
class LoadHistories:
    """Every load in the order of the experiment.

    stems : their names; columns, rates : (n_frames, n_loads) logged values and their rates (1/s; zero where there are
    no times); follower : (n_loads,) bool, follower pressures; local : loads whose value of every frame is an unknown;
    local_precision : (m, m) prior of those unknowns.
    """

    stems: tuple[str, ...]
    columns: np.ndarray
    rates: np.ndarray
    follower: np.ndarray
    local: tuple[int, ...]
    local_precision: np.ndarray

    @property
    def solver_order(self) -> np.ndarray:
        """Loads as the solver numbers them: dead ones first, then follower pressures  # (n_loads,)"""
        return np.argsort(self.follower, kind="stable")

    def values(self, parameters: ParameterSet, local: np.ndarray | None = None) -> np.ndarray:
        """Histories at these parameters; local (n_frames, m)  # (n_frames, n_loads) MPa or N"""
        scales, offsets = self._per_load(parameters, "scale", 1.0), self._per_load(parameters, "offset", 0.0)
        values = scales * (self.columns + _value(parameters, "time.offset", 0.0) * self.rates) + offsets
        if local is not None and self.local:
            values[:, list(self.local)] += local
        return values

    def names(self) -> set[str]:
        """Degrees of freedom that change a load."""
        late = {"time.offset"} if np.any(self.rates) else set()
        return {f"{stem}.{kind}" for stem in self.stems for kind in ("scale", "offset")} | late

    def derivative(self, name: str, parameters: ParameterSet) -> np.ndarray:
        """d values / d name  # (n_frames, n_loads)"""
        if name == "time.offset":
            return self._per_load(parameters, "scale", 1.0) * self.rates
        selection = np.array([name.rpartition(".")[0] == stem for stem in self.stems], dtype=float)
        if name.endswith(".offset"):
            return selection * np.ones_like(self.columns)
        return selection * (self.columns + _value(parameters, "time.offset", 0.0) * self.rates)

    def _per_load(self, parameters: ParameterSet, kind: str, default: float) -> np.ndarray:
        return np.array([_value(parameters, f"{stem}.{kind}", default) for stem in self.stems])


def build_loads(model: Model) -> LoadHistories:
    """The load histories of an experiment."""
    columns, rates = np.zeros((2, model.n_frames, len(model.loads)))
    local, stds = [], []
    for i, load in enumerate(model.loads):
        logged = isinstance(load.drive, Column)
        columns[:, i] = load.drive.values if logged else _constant(load)
        if logged and load.drive.rates is not None and "time.offset" in model.parameters:
            rates[:, i] = load.drive.rates
            columns[:, i] -= model.log_offset * rates[:, i]  # of an offset of zero
        if logged and load.drive.noise_std > 0:
            local.append(i)
            stds.append(load.drive.noise_std)
    follower = np.array([is_follower(load) for load in model.loads], dtype=bool)
    return LoadHistories(tuple(load.stem for load in model.loads), columns, rates, follower, tuple(local),
                         np.diag(np.array(stds, dtype=float) ** -2.0))


def is_follower(load: Load) -> bool:
    return load.kind == "pressure" and load.follower


def load_parameters(loads: tuple[Load, ...]) -> tuple[Parameter, ...]:
    """Scale and offset of every load; free where the load asks for it."""
    parameters = {}
    for load in loads:
        stem, logged = load.stem, isinstance(load.drive, Column)
        size = float(np.abs(load.drive.values).max()) if logged else abs(_constant(load))
        parameters[f"{stem}.scale"] = Parameter(f"{stem}.scale", 1.0, "", load.identify_scale, (0.0, np.inf),
                                                transform="log")
        parameters[f"{stem}.offset"] = Parameter(f"{stem}.offset", 0.0, UNITS[load.kind],
                                                 logged and load.drive.identify_offset, scale=0.1 * (size or 1.0))
    return tuple(parameters.values())


def _constant(load: Load) -> float:
    """The value of a load that is not logged; zero of one that a gauge controls: the solver finds it."""
    return load.drive.value if isinstance(load.drive, Constant) else 0.0


def _value(parameters: ParameterSet, name: str, default: float) -> float:
    return parameters[name].value if name in parameters else default
