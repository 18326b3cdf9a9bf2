"""The [material.SET] tables of enriched laws: the identified parameters with their values, and the new ones."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from idic.diagnose.physics.candidate import Situation
from idic.laws import EXPANSION, get_law
from idic.parameters import Parameter

MIN_WAY_BACK = 0.1  # of the largest motion: the test unloads


def materials_with(situation: Situation, *laws: str) -> Iterator[tuple[str, str]]:
    """(element set, law) of every material that has one of these laws."""
    for material in situation.experiment.model.materials:
        if material.law in laws:
            yield material.element_set, material.law


def absent_in_laminates(situation: Situation, parameter: str) -> Iterator[str]:
    """Element sets of orthotropic materials that are strained, and without the effect of this parameter of the law
    `laminate`."""
    for name, law in materials_with(situation, "orthotropic", "laminate"):
        if situation.strain[name] > 0.0 and (law == "orthotropic" or situation.values[f"{name}.{parameter}"] == 0.0):
            yield name


def has_times(situation: Situation) -> bool:
    """Whether the frames have times: without them nothing can depend on a rate."""
    return situation.experiment.model.has_times and situation.duration > 0.0


def comes_back(u: np.ndarray) -> bool:
    """Whether a motion (n_frames, n_nodes, dim) goes back from its largest by more than `MIN_WAY_BACK`."""
    size = np.sqrt(np.mean(u.reshape(len(u), -1) ** 2, axis=1))
    peak = int(np.argmax(size))
    return bool(size[peak:].min() < (1.0 - MIN_WAY_BACK) * size[peak])


def new(value: float, unit: str = "-", identify: bool = True) -> dict[str, Any]:
    """Entry of a parameter that the identified law does not have."""
    return {"value": float(value)} | ({} if unit == "-" else {"unit": unit}) | {"identify": identify}


def locked(value: float, unit: str = "-") -> dict[str, Any]:
    return new(value, unit, identify=False)


def enriched(situation: Situation, name: str, law: str, **entries: Mapping[str, Any]) -> dict[str, Any]:
    """Edits that give the element set `name` another law.

    Parameters that both laws have keep value (as identified), lock, bounds and prior; the constants of neo-Hookean
    elasticity, which the finite-strain laws share, become E and nu.

    Parameters
    ----------
    entries : of the parameters that are new
    """
    names = (*get_law(law).parameter_names, EXPANSION.name)
    table: dict[str, Any] = {"law": law} | _elastic(situation, name, names)
    for parameter in situation.experiment.model.parameters.values():
        key = parameter.name.removeprefix(f"{name}.")
        if parameter.name == f"{name}.{key}" and key in names and key not in entries:
            value = situation.values[parameter.name]
            if np.isfinite(value):
                table[key] = _kept(parameter, value)
    return {f"material.{name}": table | entries}


def _kept(parameter: Parameter, value: float) -> dict[str, Any]:
    """The entry that makes this parameter again, in the user's unit."""
    factor = parameter.factor
    entry: dict[str, Any] = {"value": value / factor}
    if parameter.unit:
        entry["unit"] = parameter.unit
    entry["identify"] = parameter.free
    if np.isfinite(parameter.bounds).any():
        entry["bounds"] = [bound / factor for bound in parameter.bounds]
    if parameter.prior_mean is not None and parameter.prior_std is not None:
        entry["prior"] = {"mean": parameter.prior_mean / factor, "std": parameter.prior_std / factor}
    return entry


def elastic_pair(situation: Situation, name: str) -> tuple[float, float]:
    """Young's modulus (MPa) and Poisson's ratio of small strains, of a law with E and nu or of a neo-Hookean one."""
    values = situation.values
    if f"{name}.E" in values:
        return values[f"{name}.E"], values[f"{name}.nu"]
    G, K = 2.0 * values[f"{name}.C10"], values[f"{name}.kappa"]
    return 9.0 * K * G / (3.0 * K + G), (3.0 * K - 2.0 * G) / (2.0 * (3.0 * K + G))


def _elastic(situation: Situation, name: str, names: tuple[str, ...]) -> dict[str, Any]:
    """E and nu of a neo-Hookean body, where they are wanted."""
    if f"{name}.C10" not in situation.values or "E" not in names:
        return {}
    E, nu = elastic_pair(situation, name)
    parameters = situation.experiment.model.parameters
    return {"E": new(E, "MPa", parameters[f"{name}.C10"].free), "nu": new(nu, "-", parameters[f"{name}.kappa"].free)}


def freed(situation: Situation, name: str, parameter: str, value: float | None = None) -> dict[str, Any] | None:
    """Edits that free a parameter that the file locks; None where it is free, or not there.

    value : start, internal units; default the locked one
    """
    parameters = situation.experiment.model.parameters
    full = f"{name}.{parameter}"
    if full not in parameters or parameters[full].free:
        return None
    law = situation.law(name)
    entry = _kept(parameters[full], parameters[full].value if value is None else value) | {"identify": True}
    edits = enriched(situation, name, law, **{parameter: entry})
    kinematics = situation.experiment.model.material_of(name).kinematics
    edits[f"material.{name}"]["kinematics"] = kinematics
    return edits


def stress_levels(situation: Situation, name: str, levels: tuple[int, ...]) -> list[float]:
    """Some of the quantiles of the largest stress that the points reach, MPa, without repetition."""
    quantiles = situation.stress[name]
    return [float(x) for x in dict.fromkeys(float(quantiles[min(level, len(quantiles) - 1)]) for level in levels)
            if x > 0.0]


def plastic_strain(situation: Situation, name: str) -> float:
    """About the largest plastic strain of the identified model: the strain beyond the elastic strain at yield."""
    E, _ = elastic_pair(situation, name)
    strain = situation.strain[name]
    return max(strain - situation.values.get(f"{name}.yield_stress", 0.0) / E, 0.1 * strain)


def plastic_course(situation: Situation, name: str) -> np.ndarray:
    """About the plastic strain of every frame, with its sign, where the body is strained most  # (n_frames,)

    The motion along that of the frame that moves most stands for the strain; the plastic part follows it at a distance
    of the strain at yield, as under kinematic hardening.
    """
    motion = situation.u.reshape(len(situation.u), -1)
    size = np.einsum("tn,tn->t", motion, motion)
    peak = motion[int(np.argmax(size))]
    if not size.any():
        return np.zeros(len(motion))
    course = situation.strain[name] * (motion @ peak) / size.max()
    reach = situation.values[f"{name}.yield_stress"] / elastic_pair(situation, name)[0]
    plastic, values = 0.0, np.zeros(len(course))
    for frame, strain in enumerate(course):
        plastic = min(max(plastic, strain - reach), strain + reach)
        values[frame] = plastic
    return values
