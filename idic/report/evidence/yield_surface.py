"""Identified free yield surfaces: radius and band along the stresses that the test has visited, classical forms."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from idic.experiment_file import NEIGHBOURS
from idic.laws import (
    ClassicalFit, FAMILY_ERROR, classical_fits, classical_surfaces, equivalent, ring_knots_of, surface_weights,
)
from idic.measure import FieldSeries
from idic.model import Model
from idic.parameters import ParameterSet
from idic.report.evidence.hardening import covariance_of, smoothness_of
from idic.report.result.record import YieldSurface

SECTION_POINTS = 181  # of the drawn section, over a whole turn
CELL = 15.0  # deg of biaxial angle and of latitude: stresses within one count as one direction
MOST_DIRECTIONS = 40  # that are compared with classical forms, the most visited ones
MIN_GROWTH = 1e-5  # of plastic strain from frame to frame: flows


def yield_surfaces(model: Model, parameters: ParameterSet, result: Mapping,
                   series: FieldSeries | None) -> tuple[YieldSurface, ...]:
    """One surface per material with a free yield surface of which something was identified.

    Parameters
    ----------
    parameters : the identified values, internal units
    series : fields of the simulation, with stress and plastic strain of the specimen
    """
    return tuple(_surfaces(model, parameters, result, series))


def _surfaces(model: Model, parameters: ParameterSet, result: Mapping,
              series: FieldSeries | None) -> Iterator[YieldSurface]:
    for material in model.materials:
        n, stem = ring_knots_of(material.law), material.element_set
        if n == 0 or f"{stem}.yield_stress" not in parameters:
            continue
        names = [f"{stem}.yield_stress", *(f"{stem}.{name}" for name in surface_weights(n))]
        entries = [result["parameters"].get(name) or {} for name in names]
        determined = [i for i, entry in enumerate(entries)
                 if entry.get("std") and names[i] in result["correlation"]["names"]]
        if not any(i > 0 for i in determined):
            continue
        start, *weights = (parameters[name].value for name in names)
        covariance = covariance_of(result, parameters, [names[i] for i in determined])

        def radius(stress: np.ndarray, start=start, weights=weights, determined=determined,
                   covariance=covariance) -> tuple[np.ndarray, np.ndarray]:
            """(radius, its covariance) along directions, MPa."""
            q, dq = equivalent(np.array(weights), stress)
            J = np.column_stack([1.0 / q, -start / (q * q)[:, None] * dq])[:, determined]
            return start / q, J @ covariance @ J.T

        turn = np.linspace(0.0, 2.0 * np.pi, SECTION_POINTS)
        section = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(SECTION_POINTS)])
        visited = visited_directions(series, float(parameters[f"{stem}.yield_surface_angle"].value))
        r, C = radius(section)
        fits, along, stds = (), np.zeros(0), np.zeros(0)
        if len(visited):
            along, along_C = radius(visited)
            stds = std_of(along, along_C)
            fits = surface_fits(visited, along, along_C)
        yield YieldSurface(stem, section, r, std_of(r, C), visited, along, stds, fits,
                           NEIGHBOURS * smoothness_of(model, names[1]).strength)


def std_of(radius: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Standard deviation of the radius: of the parameters, and `FAMILY_ERROR` by which weights miss smooth surfaces.

    radius : (m,) MPa; covariance : (m, m) MPa^2, of the parameters alone  # (m,) MPa
    """
    return np.sqrt(np.maximum(np.diag(covariance), 0.0) + (FAMILY_ERROR * radius) ** 2)


def surface_fits(stress: np.ndarray, radius: np.ndarray, covariance: np.ndarray) -> tuple[ClassicalFit, ...]:
    """Classical surfaces fitted to a free one along directions (m, 3), the best first.

    radius : (m,) MPa; covariance : (m, m) MPa^2. Many directions of few weights are tied together, so that some
    combinations have no variance, but no surface is met exactly: `FAMILY_ERROR` is added to every direction.
    """
    at = np.arange(len(stress))
    return classical_fits(at.astype(float), radius, covariance + np.diag((FAMILY_ERROR * radius) ** 2), at,
                          classical_surfaces(stress))


def visited_directions(series: FieldSeries | None, angle: float) -> np.ndarray:
    """Directions of the stress (11, 22, 12 in material axes, unit length) where the body flows  # (m, 3)

    In a frame a node flows whose plastic strain has grown. Directions of one cell of angles count as their mean;
    tension and compression are one direction. angle : of material axis 1 in the mesh, degrees
    """
    state = None if series is None else series.states.get("plastic_strain")
    if series is None or series.stress is None or state is None or len(state) < 2:
        return np.zeros((0, 3))
    grown = np.diff(state, axis=0) > MIN_GROWTH
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    Q = np.array([[c, s], [-s, c]])
    local = Q @ series.stress[1:][grown] @ Q.T  # (k, 2, 2)
    stress = np.column_stack([local[:, 0, 0], local[:, 1, 1], local[:, 0, 1]])
    stress = stress[np.all(np.isfinite(stress), axis=1)]
    size = np.linalg.norm(stress, axis=1)
    unit = stress[size > 0.0] / size[size > 0.0, None]
    unit = np.where((unit[:, 0] + unit[:, 1] < 0.0)[:, None], -1.0, 1.0) * unit
    cells = np.floor(np.degrees(np.column_stack([np.arctan2(unit[:, 1], unit[:, 0]),
                                                 np.arcsin(np.clip(unit[:, 2], -1.0, 1.0))])) / CELL).astype(int)
    cell_numbers, inverse, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    inverse = inverse.ravel()
    fullest = np.argsort(-counts)[:MOST_DIRECTIONS]
    means = np.array([unit[inverse == i].mean(axis=0) for i in fullest]).reshape(len(fullest), 3)
    means /= np.linalg.norm(means, axis=1)[:, None]
    return means[np.lexsort((means[:, 2], np.arctan2(means[:, 1], means[:, 0])))]
