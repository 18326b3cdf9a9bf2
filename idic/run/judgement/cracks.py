"""Length, stress intensity factors and J of every crack in every frame, with standard deviations from the covariance of
the parameters: ``cracks`` of result.json.

A value depends on the motion, on the stiffness and on the place of the tip, all of which follow the parameters: its
derivatives are difference quotients along the stored sensitivities of the motion.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from idic.fe import ring_around
from idic.laws import point_tangents
from idic.model import Crack, ForwardModel
from idic.parameters import ParameterSet
from idic.report import covariance_of
from idic.run.prepared.context import RunContext
from idic.run.prepared.motion_columns import motion_columns, stored_frame
from idic.run.store.layout import BASE

MPA_SQRT_M = 1000.0**0.5  # MPa sqrt(mm) in one MPa sqrt(m)
STEP_SHARE = 1e-3  # of a standard deviation: step of a difference quotient, each way
# what the mesh adds to noise (tests/fe/test_crack_tip.py, tests/twins/test_cracked_sheet.py)
TIP_STD_ELEMENTS = 0.06  # edges of the path: rms error of 14 tips in sheets by CalculiX (0.003 to 0.13)
MESH_STD_SHARES = np.array([0.005, 0.005, 0.01])  # of K_I, K_II and J
ISOTROPIC = 1e-6  # relative: how far a tangent may be from that of an isotropic material
NOT_LINEAR = "K and J need a law of small strains that is linear (elastic, orthotropic)"
NOT_EVEN = "K and J need a stiffness without [[heterogeneity]], and a test without a temperature"
NO_ROOM = "no room for a ring of two elements around the tip, away from edges, corners of the path and other materials"


def crack_results(context: RunContext, evaluation: int, values: Mapping[str, float], result: Mapping) -> dict[str, Any]:
    """The entry of result.json: per crack ``frames``, ``length_mm``, ``K_I``, ``K_II`` (MPa sqrt(m)), ``J`` (N/mm), the
    same with ``_std``, and ``why_not`` ("" where K and J are known); null where a value is not known.
    """
    forward = context.forward
    assert isinstance(forward, ForwardModel)  # cracks of an external solver are refused
    parameters = context.experiment.model.parameters.with_values(values)
    correlated = result["correlation"]["names"]
    names = [name for name in context.moving if name in correlated and result["parameters"][name]["std"]]
    columns = [context.moving.index(name) for name in names]
    open_names = tuple(name for name, entry in result["parameters"].items() if entry["free"] and not entry["std"])

    def motion(image: int) -> tuple[np.ndarray, np.ndarray]:
        u = stored_frame(context, evaluation, BASE, "u", image)[:, :2].astype(float)
        du = motion_columns(context, evaluation, image, parameters) if names else np.zeros((*u.shape, 0))
        return u, du[:, :2, columns].astype(float)

    return entries_of(Tips(forward, parameters, names, covariance_of(result, parameters, names), open_names, motion))


def entries_of(tips: Tips) -> dict[str, Any]:
    """The same entry, of any model with cracks."""
    return {crack.name: tips.entry(k, crack) for k, crack in enumerate(tips.forward.model.cracks)}


@dataclass(frozen=True, eq=False)
class Tips:
    """What the tips of a fitted model are judged by.

    names : identified parameters that count; covariance : of them, internal units; open_names : identified ones that
    the data leave open; motion : number of an image -> u (n_nodes, 2) mm and its derivatives by the names (n_nodes, 2,
    n); None of one that was not simulated
    """

    forward: ForwardModel
    parameters: ParameterSet
    names: list[str]
    covariance: np.ndarray
    open_names: tuple[str, ...]
    motion: Callable[[int], tuple[np.ndarray, np.ndarray] | None]

    def entry(self, number: int, crack: Crack) -> dict[str, Any]:
        model = self.forward.model
        lengths = model.tips_at(self.parameters)[:, number]
        slopes = np.array([crack.hats[crack.names.index(name)][model.reference:] if name in crack.names
                           else np.zeros(len(lengths)) for name in self.names]).reshape(len(self.names), -1)
        why_not = self._why_not()
        rows = np.full((len(lengths), 3), np.nan)
        stds = np.full_like(rows, np.nan)
        for k in range(1, len(lengths)) if not why_not else ():
            loads = self._loads(number, crack, k, float(lengths[k]), slopes[:, k])
            if loads is not None:
                rows[k], stds[k] = loads
                if self._is_open(crack, model.reference + k):
                    stds[k] = np.nan
        if not why_not and np.isnan(rows[1:]).all():
            why_not = NO_ROOM
        known_stds = np.sqrt(np.einsum("it,ij,jt->t", slopes, self.covariance, slopes))
        of_mesh = TIP_STD_ELEMENTS * float(np.median(np.diff(crack.cut.place)))
        stds = np.hypot(stds, MESH_STD_SHARES * np.abs(rows))
        entry = {"frames": [model.reference + k for k in range(len(lengths))], "length_mm": _listed(lengths),
                 "length_mm_std": _listed(np.where(known_stds > 0.0, np.hypot(known_stds, of_mesh), np.nan)),
                 "why_not": why_not}
        for i, (name, unit) in enumerate((("K_I", MPA_SQRT_M), ("K_II", MPA_SQRT_M), ("J", 1.0))):
            entry |= {name: _listed(rows[:, i] / unit), f"{name}_std": _listed(stds[:, i] / unit)}
        return entry

    def _is_open(self, crack: Crack, image: int) -> bool:
        """Whether a parameter that the loads of this frame go with has no value: they have no error then."""
        return any(name not in crack.names or crack.hats[crack.names.index(name)][image] != 0.0
                   for name in self.open_names)

    def _why_not(self) -> str:
        body = self.forward.body
        if any(not (section.law.small and section.law.spec.linear) for section in body.sections):
            return NOT_LINEAR
        return NOT_EVEN if self.forward.model.heterogeneities or self.forward.model.temperatures else ""

    def _loads(self, number: int, crack: Crack, frame: int, length: float,
               slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """K_I, K_II and J of a simulated frame, and their standard deviations."""
        body = self.forward.body
        ring = ring_around(body.mesh, crack.cut, length, [section.elements for section in body.sections])
        if ring is None:
            return None
        moved = self.motion(self.forward.model.reference + frame)
        if moved is None:
            return None
        u, du = moved
        value = self._load(ring, u, {})
        if not self.names:
            return value, np.full(3, np.nan)
        J = np.zeros((3, len(self.names)))
        for i, name in enumerate(self.names):
            step = STEP_SHARE * float(np.sqrt(self.covariance[i, i]))
            ways = [self._load(ring.shifted(sign * step * slopes[i]),
                               u + sign * step * du[..., i], {name: sign * step})
                    for sign in (1.0, -1.0)]
            J[:, i] = (ways[0] - ways[1]) / (2.0 * step)
        return value, np.sqrt(np.einsum("ki,ij,kj->k", J, self.covariance, J))

    def _load(self, ring, u: np.ndarray, changes: Mapping[str, float]) -> np.ndarray:
        parameters = self.parameters.with_values({name: self.parameters[name].value + change
                                                  for name, change in changes.items()})
        tangent = _tangent(self.forward, parameters, ring.section)
        load = ring.tip_load(u, tangent, _isotropic(tangent, self.forward.body.kind), self.forward.body.kind)
        return np.array([load.K_I, load.K_II, load.J])


def _tangent(forward: ForwardModel, parameters: ParameterSet, section: int) -> np.ndarray:
    """In-plane stress by strain of a material, all that a linear law has  # (2, 2, 2, 2) MPa"""
    body, law = forward.body, forward.body.sections[section].law
    values = forward.law_values(parameters)[body.sections[section].name]
    state = np.asarray(law.initial_state(body.mode))[None]
    return point_tangents(law, body.mode, np.eye(2)[None], state, values, 1.0)[2][0].reshape(2, 2, 2, 2)


def _isotropic(tangent: np.ndarray, kind: str) -> tuple[float, float] | None:
    """E (MPa) and nu of a tangent, None of one that is not isotropic."""
    stiff, across, shear = tangent[0, 0, 0, 0], tangent[0, 0, 1, 1], tangent[0, 1, 0, 1]
    differences = [tangent[1, 1, 1, 1] - stiff, 2.0 * shear - (stiff - across), tangent[0, 0, 0, 1],
                   tangent[1, 1, 0, 1]]
    if np.abs(differences).max() > ISOTROPIC * stiff:
        return None
    ratio = across / stiff
    nu = ratio if kind == "plane_stress" else ratio / (1.0 + ratio)
    return float(2.0 * shear * (1.0 + nu)), float(nu)


def _listed(values: np.ndarray) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]
