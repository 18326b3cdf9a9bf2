"""Heterogeneous stiffness: an inclusion that is softer or stiffer, or a stiffness gradient along an axis.

An inclusion of stiffness one has no place, so its place and two sizes are on a grid. Its stress is multiplied by the
stiffness: thickness and modulus are the same in a plane model, and a void is an inclusion without stiffness
(`form_of_refit`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from idic.diagnose.locate.place import in_words
from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.model import nodes_of

MAX_PLACES = 30  # inclusions of the grid, per element set
RADII_OVER_SPACING = (0.45, 0.9)  # radii, of the distance between two places
PROBE_INCLUSION, PROBE_GRADIENT = 0.8, 0.1
MAX_VOID_STIFFNESS = 0.15  # of the stiffness around
STIFFNESS_SUFFIX = ".inclusion.stiffness"


def variants(situation: Situation) -> tuple[Variant, ...]:
    proposals = []
    for material in situation.experiment.model.materials:
        name = material.element_set
        forms = [(entry["set"], entry.get("name", entry["form"]))
                 for entry in situation.document.get("heterogeneity", ())]
        if (name, "inclusion") not in forms:
            proposals += _inclusions(situation, name)
        if (name, "gradient") not in forms:
            proposals += _gradients(situation, name)
    return tuple(proposals)


def _inclusions(situation: Situation, element_set: str) -> Iterator[Variant]:
    n_axes = 3 if situation.experiment.recording.quantity == "volume" else 2  # images show no depth
    places, spacing = grid(situation.experiment.model.mesh.nodes[nodes_of(situation.experiment.model.mesh,
                                                                          element_set)][:, :n_axes])
    dof, body = f"{element_set}{STIFFNESS_SUFFIX}", situation.experiment.model.mesh.size
    for place in places:
        centre = tuple(float(x) for x in place)
        for size in RADII_OVER_SPACING:
            table = {"set": element_set, "form": "inclusion", "centre_mm": list(centre),
                     "radius_mm": {"value": float(size * spacing)}, "stiffness": {"value": 1.0, "identify": True}}
            refit = table | {"identify_centre": True, "radius_mm": {
                "value": float(size * spacing), "identify": True,
                "bounds": [0.1 * float(spacing), 3.0 * float(spacing)]}}
            yield Variant(f"{element_set} is softer or stiffer within {size * spacing:.3g} "
                          f"{situation.experiment.model.length_unit} of {in_words(centre, size=body)}",
                          _added(situation, table), (dof,), {dof: 1.0}, {dof: PROBE_INCLUSION}, form="inclusion",
                          place=centre, exact=True, refit=_added(situation, refit))


def _gradients(situation: Situation, element_set: str) -> Iterator[Variant]:
    for axis in "xyz"[:situation.experiment.model.n_dim]:
        dof = f"{element_set}.gradient.along_{axis}"
        table = {"set": element_set, "form": "gradient", f"along_{axis}": {"value": 0.0, "identify": True}}
        yield Variant(f"{element_set} becomes stiffer along {axis}", _added(situation, table), (dof,), {dof: 0.0},
                      {dof: PROBE_GRADIENT}, form="gradient", exact=True)


def _added(situation: Situation, table: dict) -> dict[str, Any]:
    return {"heterogeneity": [*situation.document.get("heterogeneity", ()), table]}


def grid(nodes: np.ndarray) -> tuple[np.ndarray, float]:
    """Places within the body on a regular grid of about `MAX_PLACES`, and their distance  # (n, d) mm, mm

    A place counts where a node is nearer than half the distance.
    """
    low, extent = nodes.min(axis=0), np.ptp(nodes, axis=0)
    d = len(extent)
    root = np.sqrt if d == 2 else np.cbrt
    spacing = max(float(root(max(np.prod(extent), 1e-300) / MAX_PLACES)), float(extent.max()) / MAX_PLACES)
    cells = np.maximum(1, np.rint(extent / spacing)).astype(int)
    axes = [low[i] + (np.arange(cells[i]) + 0.5) * extent[i] / cells[i] for i in range(d)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, d)
    inside = [np.linalg.norm(nodes - place, axis=1).min() < 0.5 * spacing for place in places]
    return places[np.array(inside)], spacing


def form_of_refit(variant: Variant, values: Mapping[str, float]) -> str | None:
    """The form of a refitted variant; an inclusion with next to no stiffness is a void."""
    dof = next((name for name in variant.new if name.endswith(STIFFNESS_SUFFIX)), None)
    return variant.form if dof is None else "void" if values[dof] < MAX_VOID_STIFFNESS else "inclusion"


register(Candidate(
    "heterogeneity", "heterogeneity", "heterogeneous stiffness", "a stiffness of one everywhere",
    rivals={"plasticity": "both are soft where stress is high: plasticity leaves strain after unloading",
            "damage": "both are soft where stress is high",
            "lens_distortion": "both distort a field that should be uniform",
            "grip_rotation": "a specimen that is softer on one side bends"},
    separating_tests=("load the specimen in another direction", "unload to zero once",
                      "measure the thickness on a grid"),
    variants=variants,
    limits=("hole_geometry",),  # of a ring around a hole, next to no stiffness or a very high one
    paraphrase="an inclusion, a void or a gradient of stiffness", refitted_form=form_of_refit))
