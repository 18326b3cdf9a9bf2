"""What a candidate looks at before it places its variants: how far the identified model stresses and strains the
body."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from idic.diagnose.locate.stiffness_score import stiffness_score
from idic.diagnose.physics.candidate import Situation
from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.errors import NotConverged
from idic.fe import PointValues
from idic.identification import Identification
from idic.model import Model

STRESS_QUANTILES = (0.50, 0.60, 0.70, 0.80, 0.90, 0.95, 0.98)  # quantiles over the points of a set


def situation(identification: Identification, residual: ResidualEvidence, document: Mapping[str, Any]) -> Situation:
    """March the identified model once and keep the largest stress and strain of every point.

    Parameters
    ----------
    document : the tables of experiment.toml with the run's overrides
    """
    experiment = identification.experiment
    names = [section.name for section in identification.forward.body.sections]
    stress = {name: np.zeros(0) for name in names}
    strain = dict.fromkeys(names, 0.0)
    for state in identification.march():
        reached: dict[str, list[np.ndarray]] = {name: [] for name in names}
        for points in state.points:
            name = names[points.section]
            reached[name].append(equivalent_stress(points, experiment.model, name,
                                                   identification.parameters.as_values()))
            strain[name] = max(strain[name], float(equivalent_strain(points.F, experiment.model.kind).max(initial=0.0)))
        for name, parts in reached.items():
            values = np.concatenate(parts)
            stress[name] = values if not len(stress[name]) else np.maximum(stress[name], values)
    return Situation(document, experiment, identification.parameters.as_values(),
                     {name: np.quantile(values, STRESS_QUANTILES) for name, values in stress.items()}, strain,
                     residual.u, residual.channels, cache(lambda: _stiffness_score(identification, residual)))


def _stiffness_score(identification: Identification, residual: ResidualEvidence) -> np.ndarray | None:
    try:
        return stiffness_score(identification, residual)
    except NotConverged:
        return None


def equivalent_stress(points: PointValues, model: Model, name: str,
                      values: Mapping[str, float]) -> np.ndarray:
    """Von Mises stress at the points, of the Kirchhoff stress P F^T in finite strain  # (n_points,) MPa

    In plane strain the stress along the third direction is nu times the trace of the others.
    """
    finite = model.material_of(name).kinematics == "finite"
    tau = np.einsum("nij,nkj->nik", points.P, points.F) if finite else points.P
    tensor = np.zeros((len(tau), 3, 3))
    d = tau.shape[1]
    tensor[:, :d, :d] = 0.5 * (tau + tau.transpose(0, 2, 1))
    if model.kind == "plane_strain" and d == 2:
        tensor[:, 2, 2] = values.get(f"{name}.nu", 0.5) * (tau[:, 0, 0] + tau[:, 1, 1])
    deviator = tensor - np.trace(tensor, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
    return np.sqrt(1.5 * np.einsum("nij,nij->n", deviator, deviator))


def equivalent_strain(F: np.ndarray, kind: str) -> np.ndarray:
    """sqrt(2/3 E':E') of the Green-Lagrange strain; in plane stress the volume is taken as kept  # (n_points,)"""
    d = F.shape[1]
    E = np.zeros((len(F), 3, 3))
    E[:, :d, :d] = 0.5 * (np.einsum("nki,nkj->nij", F, F) - np.eye(d))
    if kind == "plane_stress" and d == 2:
        E[:, 2, 2] = -E[:, 0, 0] - E[:, 1, 1]
    deviator = E - np.trace(E, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
    return np.sqrt(2.0 / 3.0 * np.einsum("nij,nij->n", deviator, deviator))
