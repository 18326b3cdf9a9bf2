"""The identified laws at one point: uniaxial tension with the band of the parameter covariance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from idic.errors import NotConverged
from idic.fe import EXTERNAL, green_strain, nodal_deformation
from idic.laws import compile, get_law, uniaxial
from idic.model import Experiment, Material, Model
from idic.parameters import ParameterSet
from idic.report.result.record import LawCurve

CURVE_STEPS = 120
STRAIN_PERCENTILE = 99.0  # percent of the nodes: the few at corners of the mesh strain more than anything that was seen
MIN_CURVE_STRAIN = 1e-5
MAX_PUSH = 0.9  # of the length: nothing is left at one
NOTHING = np.zeros(0)


def law_curves(experiment: Experiment, parameters: ParameterSet, result: Mapping,
               motions: np.ndarray) -> tuple[LawCurve, ...]:
    """One curve per material with a free parameter.

    Parameters
    ----------
    parameters : the identified values, internal units
    motions : (n_frames, n_nodes, dim) mm
        Simulated displacement of some frames, from which the largest strain is taken.
    """
    return tuple(_curves(experiment, parameters, result, motions))


def _curves(experiment: Experiment, parameters: ParameterSet, result: Mapping,
            motions: np.ndarray) -> Iterator[LawCurve]:
    model = experiment.model
    for material in model.materials:
        if material.law == EXTERNAL:
            continue
        names = [f"{material.element_set}.{name}" for name in get_law(material.law).parameter_names]
        entries = [result["parameters"].get(name, {}) for name in names]
        if not any(entry.get("free") for entry in entries):
            continue
        missing = tuple(name for name, entry in zip(names, entries, strict=True)
                        if entry.get("free") and entry.get("std") is None)
        seconds = float(model.times[-1] - model.times[model.reference])
        empty = LawCurve(material.element_set, material.law, NOTHING, NOTHING, NOTHING, NOTHING, seconds, missing)
        if missing:
            yield empty
            continue
        axis, sign = _direction(model, material, motions)
        strain = sign * min(_largest_strain(model, material, motions), MAX_PUSH if sign < 0 else np.inf)
        curve = _curve(experiment, material, names, parameters, result, strain, axis)
        if curve is not None:
            yield curve


def _curve(experiment, material: Material, names, parameters: ParameterSet, result: Mapping,
           strain: float, axis: int) -> LawCurve | None:
    """The curve up to `strain` along an axis; None where the point finds no equilibrium there."""
    model = experiment.model
    law = compile(material.law, material.kinematics)
    seconds = float(model.times[-1] - model.times[model.reference])
    path, times = np.linspace(0.0, strain, CURVE_STEPS), np.linspace(0.0, seconds, CURVE_STEPS)
    try:
        identified, started = (uniaxial(law, [values[name].value for name in names], path, times=times, axis=axis)
                          for values in (parameters, model.parameters))
    except NotConverged:
        return None
    table = result["correlation"]
    determined = [i for i, name in enumerate(names) if name in table["names"]]
    at = [table["names"].index(names[i]) for i in determined]
    stds = np.array([result["parameters"][names[i]]["std"] * abs(parameters[names[i]].factor) for i in determined])
    covariance = np.asarray(table["matrix"], dtype=float)[np.ix_(at, at)] * np.outer(stds, stds)
    slopes = identified.dP[:, determined, axis, axis]  # (m, n) MPa per unit
    variance = np.einsum("mi,ij,mj->m", slopes, covariance, slopes)
    return LawCurve(material.element_set, material.law, path, identified.P[:, axis, axis],
                    np.sqrt(np.maximum(variance, 0.0)),
                    started.P[:, axis, axis], seconds, axis="xyz"[axis])


def _direction(model: Model, material: Material, motions: np.ndarray) -> tuple[int, int]:
    """Axis of the mesh nearest to the largest mean strain of the set, and whether it is stretched (1) or pressed
    (-1)."""
    mesh, largest, direction = model.mesh, 0.0, (0, 1)
    nodes = nodes_of(mesh, mesh.element_sets[material.element_set])
    for u in motions:
        F = nodal_deformation(mesh, u[:, :mesh.n_dim])[nodes]
        mean = green_strain(F[np.isfinite(F).all(axis=(1, 2))]).mean(axis=0)
        values, vectors = np.linalg.eigh(mean)
        k = int(np.argmax(np.abs(values)))
        if abs(values[k]) > largest:
            largest, direction = abs(values[k]), (int(np.argmax(np.abs(vectors[:, k]))), 1 if values[k] > 0 else -1)
    return direction


def _largest_strain(model: Model, material: Material, motions: np.ndarray) -> float:
    """The largest change of length, as a part of it, that nearly all nodes of the set stay within."""
    mesh, largest = model.mesh, MIN_CURVE_STRAIN
    nodes = nodes_of(mesh, mesh.element_sets[material.element_set])
    for u in motions:
        F = nodal_deformation(mesh, u[:, :mesh.n_dim])[nodes]
        stretch = np.linalg.svd(F[np.isfinite(F).all(axis=(1, 2))], compute_uv=False)
        largest = max(largest, float(np.percentile(np.abs(stretch - 1.0).max(axis=1), STRAIN_PERCENTILE)))
    return largest


def nodes_of(mesh, elements: np.ndarray) -> np.ndarray:
    """The nodes of some elements, each once."""
    nodes_of_blocks = []
    for block in mesh.blocks:
        inside = (elements >= block.first) & (elements < block.first + len(block.connectivity))
        nodes_of_blocks.append(block.connectivity[elements[inside] - block.first].ravel())
    return np.unique(np.concatenate(nodes_of_blocks))
