"""Heterogeneities of an experiment as factor fields of the finite-element model."""

from __future__ import annotations

import numpy as np

from idic.experiment import Experiment, Heterogeneity
from idic.fe.mesh import Mesh
from idic.fe.variation import Variation
from idic.parameters import ParameterSet


def variations_at(experiment: Experiment, parameters: ParameterSet) -> tuple[Variation, ...]:
    """The factor fields at these parameters, in the order of ``experiment.heterogeneities``."""
    return tuple(_variation(experiment, entry, parameters) for entry in experiment.heterogeneities)


def variation_of(experiment: Experiment, name: str) -> tuple[int, str] | None:
    """Which factor field and which of its values a degree of freedom is; None for any other."""
    stem, _, last = name.rpartition(".")
    for i, entry in enumerate(experiment.heterogeneities):
        if stem == f"{entry.element_set}.{entry.name}":
            return i, "amount" if last == entry.amount and entry.form != "gradient" else last
    return None


def _variation(experiment: Experiment, entry: Heterogeneity, parameters: ParameterSet) -> Variation:
    stem = f"{entry.element_set}.{entry.name}."
    values = {name.removeprefix(stem): value for name, value in parameters.as_values().items() if name.startswith(stem)}
    if entry.form != "gradient":
        values["amount"] = values.pop(entry.amount)
        return Variation(entry.element_set, "spot", values)
    mesh = experiment.mesh
    used = nodes_of(mesh, entry.element_set)
    low, high = mesh.nodes[used].min(axis=0), mesh.nodes[used].max(axis=0)
    return Variation(entry.element_set, "gradient", values, 0.5 * (low + high), 0.5 * (high - low))


def nodes_of(mesh: Mesh, element_set: str) -> np.ndarray:
    """Nodes of the elements of a set  # (n,)"""
    elements, found = np.asarray(mesh.element_sets[element_set]), []
    for block in mesh.blocks:
        own = elements[(elements >= block.first) & (elements < block.first + block.n_elements)] - block.first
        found.append(block.connectivity[own].ravel())
    return np.unique(np.concatenate(found))
