"""The fields of a test over its frames: motion simulated and measured, its noise, stress and state of the law."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from idic.errors import InputError
from idic.fe import FrameState, Body, nodal_field, nodal_state
from idic.measure.fields.strain import principal, rotated, strain, von_mises
from idic.measure.fields.surface import Surface

_TENSOR_STATE = re.compile(r"\d\d(-1)?$")  # a component of an inner tensor: of no use by itself


@dataclass(frozen=True, eq=False)
class FieldSeries:
    """Fields on the seen surface in some frames.

    Attributes
    ----------
    frames : tuple of int
    simulated : (m, n, 2) mm
    measured : (m, n, 2) mm or None
        Of a free FE-DIC; NaN where a frame is lost or a node not seen.
    noise : (k, n, 2) mm or None
        What a free FE-DIC makes of image noise alone, in k still images.
    stress : (m, n, 2, 2) MPa or None
        Cauchy stress in the plane of the surface.
    states : {name: (m, n)}
        Scalar state of the laws: ``plastic_strain``, ...
    smoothed : float or None
        Shortest wave that the measurement shows, mm: its regularisation halves it.
    kind : "plane_stress" | "plane_strain" | "solid"
    unit : "mm", or "px" where no scale is known
    stress_unit : "MPa", or the name of a held stress that all are given in
    depth : {"u_z": (m, n), "z": (m, n)} mm
        Simulated displacement out of the plane, and where the surface then is: of a solid, and of a sheet that two
        cameras measure in space; else empty.
    measured_depth : the same, measured by two cameras with a lens; else empty
    depth_noise : (k, n) mm or None
        What image noise alone adds to both.
    """

    surface: Surface
    frames: tuple[int, ...]
    simulated: np.ndarray
    measured: np.ndarray | None = None
    noise: np.ndarray | None = None
    stress: np.ndarray | None = None
    states: Mapping[str, np.ndarray] = field(default_factory=dict)
    smoothed: float | None = None
    kind: str = "plane_stress"
    unit: str = "mm"
    stress_unit: str = "MPa"
    depth: Mapping[str, np.ndarray] = field(default_factory=dict)
    measured_depth: Mapping[str, np.ndarray] = field(default_factory=dict)
    depth_noise: np.ndarray | None = None

    @cached_property
    def F(self) -> np.ndarray:
        """Deformation gradient of the simulation  # (m, n, 2, 2)"""
        return self.surface.deformation(self.simulated)

    @cached_property
    def F_measured(self) -> np.ndarray | None:
        """The same of the measured motion  # (m, n, 2, 2)"""
        return None if self.measured is None else self.surface.deformation(self.measured)

    @cached_property
    def F_noise(self) -> np.ndarray | None:
        """What noise adds to it, less one  # (k, n, 2, 2)"""
        return None if self.noise is None else self.surface.deformation(self.noise) - np.eye(2)

    def strain(self, measure: str = "green_lagrange", angle_deg: float = 0.0, source: str = "simulated") -> np.ndarray:
        """Strain tensor at the nodes in axes that are turned by an angle  # (m, n, 2, 2)

        source : "simulated" | "measured"

        Raises
        ------
        InputError
            An unknown measure, or no measurement.
        """
        F = self.F if source == "simulated" else self.F_measured
        if F is None or source not in ("simulated", "measured"):
            raise InputError("there is no such field", key="source", expected="simulated" + (
                ", measured" if self.measured is not None else ""), found=source, remedy="write one of these names")
        return rotated(strain(F, measure), angle_deg)

    def strain_std(self, component: str, measure: str = "green_lagrange", angle_deg: float = 0.0) -> np.ndarray | None:
        """Standard deviation of a component of the measured strain by image noise; None where it is not known.

        The noise of still images is added to the simulated deformation: it acts through the measure as it is there.

        Returns
        -------
        (m, n)
        """
        if self.F_noise is None:
            return None
        deviations = np.empty(self.F.shape[:2])
        for k, F in enumerate(self.F):
            values = component_of(rotated(strain(F + self.F_noise, measure), angle_deg), component)
            noiseless = component_of(rotated(strain(F, measure), angle_deg), component)
            deviations[k] = np.sqrt(np.mean((values - noiseless) ** 2, axis=0))
        return deviations

    @property
    def floor(self) -> dict[str, float]:
        """Noise of the measurement over all nodes, rms: ``displacement`` (mm) and ``strain`` of a component."""
        if self.noise is None or self.F_noise is None:
            return {}
        small = (self.F_noise + np.swapaxes(self.F_noise, -1, -2)) / 2.0
        parts = small[..., [0, 1, 0], [0, 1, 1]]
        return {"displacement": float(np.sqrt(np.nanmean(self.noise**2))),
                "strain": float(np.sqrt(np.nanmean(parts**2)))}


def component_of(tensor: np.ndarray, component: str) -> np.ndarray:
    """A component or an invariant of plane tensors  # (..., 2, 2) -> (...)

    component : "xx" | "yy" | "xy" (the tensor's, half of gamma) | "1" | "2" (principal) | "max_shear" | "von_mises"
    """
    if component in ("xx", "yy", "xy"):
        return tensor[..., "xy".index(component[0]), "xy".index(component[1])]
    if component == "von_mises":
        return von_mises(tensor)
    values = principal(tensor)
    return (values[..., 0] - values[..., 1]) / 2.0 if component == "max_shear" else values[..., int(component) - 1]


def simulated_states(model: Body, states: Iterable[FrameState], index: np.ndarray,
                     frames: Iterable[int]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Stress and state of the laws at some nodes in some frames of a simulation.

    Parameters
    ----------
    index : (n,) nodes
    frames : increasing frame numbers, counted from the first of the simulation

    Returns
    -------
    stress : (m, n, 2, 2) MPa, in the plane of x and y
    states : {name: (m, n)}
    """
    chosen, names = set(frames), state_names(model)
    stress, histories = [], {name: [] for name in names}
    for state in states:
        if state.frame not in chosen:
            continue
        stress.append(nodal_field(model, state, "stress")[index][:, :2, :2].copy())
        for name in names:
            histories[name].append(nodal_state(model, state, name)[index].copy())
    return np.array(stress), {name: np.array(values) for name, values in histories.items()}


def state_names(model: Body) -> tuple[str, ...]:
    """Scalar states of the laws of a model, each once."""
    names = (name for section in model.sections for name in section.law.spec.state_names)
    return tuple(dict.fromkeys(name for name in names if not _TENSOR_STATE.search(name)))
