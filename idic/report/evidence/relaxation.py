"""Identified free relaxation spectra: shear modulus over time with its band, weights, and the classical forms."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from idic.laws import FORMS, classical_fits, grid, grid_covariance, relaxing, times_of, weight_names
from idic.model import Model
from idic.parameters import ParameterSet
from idic.report.evidence.hardening import covariance_of, smoothness_of
from idic.report.result.record import RelaxationCurve

POINTS_BETWEEN = 4  # of the drawn curve, between the points that are compared with the classical forms


def relaxation_curves(model: Model, parameters: ParameterSet,
                      result: Mapping) -> tuple[RelaxationCurve, ...]:
    """One curve per material with a free spectrum of which something was identified, over the times of the frames.

    Parameters
    ----------
    parameters : the identified values, internal units
    """
    return tuple(_curves(model, parameters, result))


def _curves(model: Model, parameters: ParameterSet, result: Mapping) -> Iterator[RelaxationCurve]:
    times = model.times[model.reference:]
    for material in model.materials:
        n = times_of(material.law)
        if n == 0 or len(times) < 2:
            continue
        stem = material.element_set
        names = [f"{stem}.E", f"{stem}.nu", *(f"{stem}.{name}" for name in weight_names(n))]
        E, nu, *weights = (parameters[name].value for name in names)
        entries = [result["parameters"].get(name) or {} for name in names]
        determined = [i for i, entry in enumerate(entries)
                 if entry.get("std") and names[i] in result["correlation"]["names"]]
        if not any(i > 1 for i in determined):
            continue
        taus = grid(parameters[f"{stem}.shortest"].value, parameters[f"{stem}.longest"].value, n)
        compared = np.geomspace(np.diff(times).min(), times[-1] - times[0], n + 2)
        at = POINTS_BETWEEN * np.arange(n + 2)
        t = np.exp(np.interp(np.arange(at[-1] + 1), at, np.log(compared)))
        G, loss = E / (2.0 * (1.0 + nu)), relaxing(t, taus)
        modulus = G * (1.0 - loss @ weights)
        J = np.column_stack([modulus / E, -modulus / (1.0 + nu), -G * loss])[:, determined]
        parameter_covariance = covariance_of(result, parameters, [names[i] for i in determined])
        covariance = J @ parameter_covariance @ J.T + G**2 * grid_covariance(t, taus, np.array(weights))
        std = np.full(len(names), np.nan)
        std[determined] = np.sqrt(np.diag(parameter_covariance))
        yield RelaxationCurve(stem, t, modulus, np.sqrt(np.maximum(np.diag(covariance), 0.0)), taus, np.array(weights),
                              std[2:], classical_fits(t, modulus, covariance, at, FORMS),
                              smoothness_of(model, names[2]).strength)
