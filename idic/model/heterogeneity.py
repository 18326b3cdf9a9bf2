"""Heterogeneities of an experiment as factor fields of the finite-element model."""

from __future__ import annotations

import numpy as np

from idic.fe import Mesh, Variation
from idic.model.records.model import Model
from idic.model.records.parts import Heterogeneity
from idic.parameters import ParameterSet


def variations_at(model: Model, parameters: ParameterSet) -> tuple[Variation, ...]:
    """The factor fields at these parameters, in the order of ``experiment.heterogeneities``."""
    return tuple(_variation(model, entry, parameters) for entry in model.heterogeneities)


def variation_of(model: Model, name: str) -> tuple[int, str] | None:
    """Which factor field and which of its values a degree of freedom is; None for any other."""
    stem, _, suffix = name.rpartition(".")
    for i, entry in enumerate(model.heterogeneities):
        if stem == f"{entry.element_set}.{entry.name}":
            return i, "amount" if suffix == entry.amount and entry.is_spot else suffix
    return None


def _variation(model: Model, entry: Heterogeneity, parameters: ParameterSet) -> Variation:
    stem = f"{entry.element_set}.{entry.name}."
    values = {name.removeprefix(stem): value for name, value in parameters.as_values().items() if name.startswith(stem)}
    if entry.is_spot:
        values["amount"] = values.pop(entry.amount)
        return Variation(entry.element_set, "spot", values)
    mesh = model.mesh
    used = nodes_of(mesh, entry.element_set)
    low, high = mesh.nodes[used].min(axis=0), mesh.nodes[used].max(axis=0)
    return Variation(entry.element_set, entry.form, values, 0.5 * (low + high), 0.5 * (high - low))


def strayed(model: Model, parameters: ParameterSet) -> list[str]:
    """Notes on inclusions whose identified centre lies outside of their element set."""
    notes = []
    for entry in model.heterogeneities:
        centre = [parameters[f"{entry.element_set}.{entry.name}.{axis}"] for axis in "xyz"
                  if f"{entry.element_set}.{entry.name}.{axis}" in parameters]
        if not entry.is_spot or not any(p.free for p in centre):
            continue
        nodes = model.mesh.nodes[nodes_of(model.mesh, entry.element_set)][:, :len(centre)]
        at = np.array([p.value for p in centre])
        if np.any((at < nodes.min(axis=0)) | (at > nodes.max(axis=0))):
            place = ", ".join(f"{p.shown:.4g}" for p in centre)
            notes.append(f"{entry.element_set}.{entry.name}: its centre ({place}) lies outside {entry.element_set}. "
                         "The specimen shows only a slope of it: amount, radius and place cannot be separated")
    return notes


def nodes_of(mesh: Mesh, element_set: str) -> np.ndarray:
    """Nodes of the elements of a set  # (n,)"""
    elements, parts = np.asarray(mesh.element_sets[element_set]), []
    for block in mesh.blocks:
        rows = elements[(elements >= block.first) & (elements < block.first + block.n_elements)] - block.first
        parts.append(block.connectivity[rows].ravel())
    return np.unique(np.concatenate(parts))
