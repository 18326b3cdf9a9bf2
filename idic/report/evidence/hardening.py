"""Identified free hardening curves: flow stress over plastic strain with its band, and the classical forms beside
it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise

import numpy as np

from idic.laws import Smoothness, basis, between_knots, classical_fits, knots, knots_of, level_names
from idic.measure import FieldSeries
from idic.model import Model
from idic.parameters import ParameterSet
from idic.report.result.record import HardeningCurve

POINTS_BETWEEN = 8  # of the drawn curve, between the points that are compared with the classical forms
REACHED_PERCENTILE = 99.0  # percent of the nodes: the few at notches of the mesh flow more than anything that was seen
MIN_REACHED = 1e-4  # plastic strain below which there is no curve to draw


def hardening_curves(model: Model, parameters: ParameterSet, result: Mapping,
                     series: FieldSeries | None) -> tuple[HardeningCurve, ...]:
    """One curve per material with a free hardening curve of which something was identified.

    Parameters
    ----------
    parameters : the identified values, internal units
    series : fields of the simulation, with the plastic strain that the specimen has reached
    """
    return tuple(_curves(model, parameters, result, series))


def _curves(model: Model, parameters: ParameterSet, result: Mapping,
            series: FieldSeries | None) -> Iterator[HardeningCurve]:
    state = None if series is None else series.states.get("plastic_strain")
    for material in model.materials:
        n = knots_of(material.law)
        if n == 0:
            continue
        names = level_names(material.law, material.element_set)
        largest_strain = parameters[f"{material.element_set}.hardening_1_range"].value
        reached = largest_strain if state is None else float(np.nanpercentile(state, REACHED_PERCENTILE, axis=1).max())
        entries = [result["parameters"].get(name, {}) for name in names]
        determined = [i for i, entry in enumerate(entries) if entry.get("std")
                 and names[i] in result["correlation"]["names"]]
        if reached < MIN_REACHED or not determined:
            continue
        at = knots(largest_strain, n)
        compared = np.append(at[at < reached], reached)
        p = np.unique(np.concatenate([np.linspace(a, b, POINTS_BETWEEN + 1)
                                      for a, b in pairwise(compared)]))
        J = basis(p, largest_strain, n)
        level_covariance = np.zeros((n, n))
        level_covariance[np.ix_(determined, determined)] = covariance_of(result, parameters,
                                                                         [names[i] for i in determined])
        levels = np.maximum.accumulate([parameters[name].value for name in names])
        stress = J @ levels
        covariance = J @ level_covariance @ J.T + between_knots(p, largest_strain, levels, level_covariance)
        fits = classical_fits(p, stress, covariance, np.searchsorted(p, compared))
        std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        yield HardeningCurve(material.element_set, p, stress, std, at, reached, fits,
                             smoothness_of(model, names[0]))


def smoothness_of(model: Model, first: str) -> Smoothness:
    """The smoothness of the free curve whose first value has this name."""
    return next((curve.smoothness for curve in model.free_curves if curve.names[0] == first),
                Smoothness())


def covariance_of(result: Mapping, parameters: ParameterSet, names: list[str]) -> np.ndarray:
    """Covariance of some identified parameters, internal units  # (n, n)"""
    table = result["correlation"]
    at = [table["names"].index(name) for name in names]
    stds = np.array([result["parameters"][name]["std"] * abs(parameters[name].factor) for name in names])
    return np.asarray(table["matrix"], dtype=float)[np.ix_(at, at)] * np.outer(stds, stds)
