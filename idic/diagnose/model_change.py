"""Change of the model by a diagnosis: parameters over growing windows of frames, stress-strain curves of the laws."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from idic.diagnose.diagnosis import Diagnosis
from idic.diagnose.locate.mismatch import parameters_over_windows
from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.errors import NotConverged
from idic.fe import EXTERNAL, nodal_deformation
from idic.laws import compile, get_law, uniaxial
from idic.model import Model, nodes_of
from idic.parameters import ParameterSet

MIN_STRESS_DIFFERENCE = 0.01  # of the largest stress: two curves that a figure could not tell apart
CURVE_STEPS = 100
STRAIN_PERCENTILE = 99.0  # per cent of the nodes


@dataclass(frozen=True, eq=False)
class WindowCurve:
    """A parameter fitted to frames 1 … t alone, before and after; (T,) each, NaN where these frames leave it open.

    name : full name; final : its value in the last model
    """

    name: str
    value_before: np.ndarray
    std_before: np.ndarray
    value_after: np.ndarray | None
    std_after: np.ndarray | None
    final: float


@dataclass(frozen=True, eq=False)
class LawPair:
    """Nominal stress (MPa) over nominal strain of one point in tension, before and after; laws : their names."""

    name: str
    laws: tuple[str, str]
    strain: np.ndarray
    stress_before: np.ndarray
    stress_after: np.ndarray


def window_curves(diagnosis: Diagnosis) -> tuple[WindowCurve, ...]:
    """Free parameters of both models over growing windows of frames."""
    base_curves = _windows(diagnosis.identified.residual, diagnosis.identification.parameters)
    enriched = diagnosis.enriched
    enriched_curves = {} if enriched is None else _windows(enriched.residual, _parameters(diagnosis))
    final = diagnosis.identification.parameters.as_values() | (
        {} if diagnosis.state.final is None else dict(diagnosis.state.final.fit.values))
    return tuple(WindowCurve(name, *curve, *enriched_curves.get(name, (None, None)), final[name])
                 for name, curve in base_curves.items() if (name in enriched_curves or not enriched_curves)
                 and final[name])


def _windows(residual: ResidualEvidence, parameters: ParameterSet) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    names, steps, stds = parameters_over_windows(residual)
    return {name: (parameters[name].value + steps[:, k], stds[:, k]) for k, name in enumerate(names)}


def _parameters(diagnosis: Diagnosis) -> ParameterSet:
    parameters = diagnosis.last_parameters
    values = diagnosis.enriched.fit.values
    return parameters.with_values({n: v for n, v in values.items() if n in parameters})


def law_pairs(diagnosis: Diagnosis) -> tuple[LawPair, ...]:
    """Stress-strain curves of every material whose law or parameters changed."""
    if diagnosis.enriched is None:
        return ()
    base, enriched = diagnosis.identification.experiment, diagnosis.enriched.residual.context.experiment
    pairs = []
    for material in base.model.materials:
        replacement = enriched.model.material_of(material.element_set)
        if EXTERNAL in (material.law, replacement.law):
            continue
        strain = _largest_strain(base.model, material.element_set,
                                 diagnosis.identified.residual.u[..., :base.model.n_dim])
        base_curve = _curve(base.model, material, diagnosis.identification.parameters.as_values(), strain)
        enriched_curve = _curve(enriched.model, replacement, _parameters(diagnosis).as_values(), strain)
        if base_curve is None or enriched_curve is None:
            continue
        if np.abs(base_curve - enriched_curve).max() < MIN_STRESS_DIFFERENCE * np.abs(enriched_curve).max():
            continue
        pairs.append(LawPair(material.element_set, (_words(material.law), _words(replacement.law)),
                             np.linspace(0.0, strain, CURVE_STEPS), base_curve, enriched_curve))
    return tuple(pairs)


def _largest_strain(model: Model, element_set: str, motions: np.ndarray) -> float:
    """Largest stretch less one over all frames, at `STRAIN_PERCENTILE` of the nodes of a set."""
    nodes, largest = nodes_of(model.mesh, element_set), 0.0
    for u in motions:
        F = nodal_deformation(model.mesh, u)[nodes]
        stretch = np.linalg.svd(F[np.isfinite(F).all(axis=(1, 2))], compute_uv=False)
        largest = max(largest, float(np.percentile(np.abs(stretch - 1.0).max(axis=1), STRAIN_PERCENTILE)))
    return largest


def _words(law: str) -> str:
    return law.replace("_", " ")


def _curve(model: Model, material, values: Mapping[str, float], strain: float) -> np.ndarray | None:
    """Nominal stress (STEPS,) MPa; None where the point finds no equilibrium."""
    seconds = float(model.times[-1] - model.times[model.reference])
    constants = [values.get(f"{material.element_set}.{p.name}", p.null) for p in get_law(material.law).parameters]
    if any(value is None for value in constants):
        return None
    try:
        response = uniaxial(compile(material.law, material.kinematics), constants,
                            np.linspace(0.0, strain, CURVE_STEPS),
                            times=np.linspace(0.0, seconds, CURVE_STEPS))
    except NotConverged:
        return None
    return response.P[:, 0, 0]
