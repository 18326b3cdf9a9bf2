"""Identified temperature dependence of laws: every factor over the temperatures of the test, with its band."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from idic.laws import PRODUCT_SIGN, STEP, factor, get_law, terms_of
from idic.model import Model, nodal_temperature
from idic.parameters import ParameterSet
from idic.report.evidence.hardening import covariance_of
from idic.report.result.record import TemperatureFactor

POINTS = 60  # of a curve


def temperature_factors(model: Model, parameters: ParameterSet,
                        result: Mapping) -> tuple[TemperatureFactor, ...]:
    """One record per temperature term of every material; none where the experiment has no temperature."""
    field = nodal_temperature(model)
    if field is None:
        return ()
    temperatures = field.start + field.values[model.reference:]
    return tuple(_factors(model, parameters, result, np.linspace(temperatures.min(), temperatures.max(), POINTS)))


def _factors(model: Model, parameters: ParameterSet, result: Mapping,
             T: np.ndarray) -> Iterator[TemperatureFactor]:
    for material in model.materials:
        dependence = get_law(material.law).temperature if "(" in material.law else None
        if dependence is None:
            continue
        names = get_law(material.law).parameter_names
        values = {name: parameters[f"{material.element_set}.{name}"].value for name in names}
        written = [term for term in terms_of(material.law, values) or () if term.term.group == "temperature"]
        reference = values["reference_temperature"]
        for dependent, term in zip(dependence.factors, written, strict=True):
            constants = np.array(list(term.values.values()))
            full = [f"{material.element_set}.{name}" for name in term.names.values()]
            determined = [i for i, name in enumerate(full)
                     if (result["parameters"].get(name) or {}).get("std") and name in result["correlation"]["names"]]
            steps = 1j * STEP * np.eye(len(constants))
            slopes = np.array([factor(dependent.kind, constants + steps[i], reference, T + 0j).imag / STEP
                               for i in determined])
            variance = np.zeros(len(T))
            if determined:
                covariance = covariance_of(result, parameters, [full[i] for i in determined])
                variance = np.einsum("it,ij,jt->t", slopes, covariance, slopes)
            kind, *targets = term.kind.split(PRODUCT_SIGN)
            yield TemperatureFactor(material.element_set, kind, tuple(targets), dict(term.values), reference, T,
                                    factor(dependent.kind, constants, reference, T), np.sqrt(np.maximum(variance, 0.0)))
