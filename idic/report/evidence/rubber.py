"""Identified free rubber energies: stress in three modes and derivatives by the invariants, with bands, and classical
forms."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from idic.fe import nodal_deformation
from idic.laws import (
    INVARIANTS, RUBBER_TESTS, basis, classical_fits, classical_forms, invariants, knots, knots_of_rubber,
    rubber_level_names, stress_matrix,
)
from idic.model import Material, Model
from idic.parameters import ParameterSet
from idic.report.evidence.hardening import covariance_of, smoothness_of
from idic.report.evidence.law import nodes_of
from idic.report.result.record import RubberCurve, RubberMode, RubberSlope

POINTS = 40  # of a drawn curve
COMPARED = 8  # stretches per mode at which classical forms are compared
# percent of the nodes: the few at corners of the mesh strain more than anything that was seen
REACHED_PERCENTILE = 99.0
SMALLEST_STRETCH, LARGEST_STRETCH = 1.02, 10.0  # of the curves: below, all forms are one


def rubber_curves(model: Model, parameters: ParameterSet, result: Mapping,
                  motions: np.ndarray) -> tuple[RubberCurve, ...]:
    """One record per material with a free energy of which something was identified.

    Parameters
    ----------
    parameters : the identified values, internal units
    motions : (n_frames, n_nodes, dim) mm
        Simulated displacement of some frames, from which the largest invariants are taken.
    """
    return tuple(_curves(model, parameters, result, motions))


def _curves(model: Model, parameters: ParameterSet, result: Mapping,
            motions: np.ndarray) -> Iterator[RubberCurve]:
    for material in model.materials:
        counts = tuple(n for n in knots_of_rubber(material.law) if n)
        if not counts:
            continue
        law_invariants = INVARIANTS[:len(counts)]
        names = [f"{material.element_set}.{name}" for invariant, n in zip(law_invariants, counts, strict=True)
                 for name in rubber_level_names(invariant, n)]
        determined = [i for i, name in enumerate(names)
                 if (result["parameters"].get(name) or {}).get("std") and name in result["correlation"]["names"]]
        if not determined:
            continue
        ranges = tuple(parameters[f"{material.element_set}.{invariant}_range"].value for invariant in law_invariants)
        levels = np.array([parameters[name].value for name in names])
        covariance = np.zeros((len(names), len(names)))
        covariance[np.ix_(determined, determined)] = covariance_of(result, parameters, [names[i] for i in determined])
        reached = _reached(model, material, motions)
        modes, rows, points = [], [], []
        for mode in RUBBER_TESTS:
            end = _largest_stretch(mode, reached[:len(counts)])
            stretch = np.linspace(SMALLEST_STRETCH, end, POINTS)
            J = stress_matrix(mode, stretch, ranges, counts)
            modes.append((mode, stretch, J @ levels, _std(J, covariance)))
            samples = np.linspace(SMALLEST_STRETCH, end, COMPARED + 1)[1:]
            rows.append(stress_matrix(mode, samples, ranges, counts))
            points += [(mode, value) for value in samples]
        J, places = np.vstack(rows), np.arange(len(points), dtype=float)
        forms = classical_forms(np.array([mode for mode, _ in points]), np.array([value for _, value in points]))
        fits = classical_fits(places, J @ levels, J @ covariance @ J.T, range(len(points)), forms)
        cut = np.cumsum([0, *counts])
        slopes = []
        for k, (invariant, n, end) in enumerate(zip(law_invariants, counts, ranges, strict=True)):
            x = np.linspace(0.0, min(reached[k], end), POINTS)
            B, part = basis(x, end, n), slice(cut[k], cut[k + 1])
            slopes.append(RubberSlope(invariant, x, B @ levels[part], _std(B, covariance[part, part]), knots(end, n)))
        yield RubberCurve(material.element_set, tuple(RubberMode(*mode) for mode in modes), tuple(slopes), reached,
                          fits, tuple(smoothness_of(model, names[place]).strength for place in cut[:-1]))


def _std(J: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(np.einsum("mi,ij,mj->m", J, covariance, J), 0.0))


def _reached(model: Model, material: Material, motions: np.ndarray) -> tuple[float, float]:
    """I1 - 3 and I2 - 3 that nearly all nodes of the set stay within; a plane body keeps its volume."""
    mesh, nodes = model.mesh, nodes_of(model.mesh, model.mesh.element_sets[material.element_set])
    largest = [0.0, 0.0]
    for u in motions:
        F = nodal_deformation(mesh, u[:, :mesh.n_dim])[nodes]
        s = np.linalg.svd(F[np.isfinite(F).all(axis=(1, 2))], compute_uv=False)[:, :2]
        squares = np.column_stack([s**2, 1.0 / np.prod(s, axis=1) ** 2])
        for k, values in enumerate((squares.sum(axis=1) - 3.0, (1.0 / squares).sum(axis=1) - 3.0)):
            largest[k] = max(largest[k], float(np.percentile(values, REACHED_PERCENTILE)))
    return largest[0], largest[1]


def _largest_stretch(mode: str, reached: tuple[float, ...]) -> float:
    """The stretch of a mode at which an invariant leaves what the test has reached."""
    stretch = np.linspace(SMALLEST_STRETCH, LARGEST_STRETCH, 2000)
    inside = np.all([x <= end for x, end in zip(invariants(mode, stretch), reached, strict=False)], axis=0)
    return float(max(stretch[inside].max(initial=SMALLEST_STRETCH), 1.01 * SMALLEST_STRETCH))
