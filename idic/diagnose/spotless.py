"""Spots are found before a diagnosis, left out of the images, and the model is identified without them.

What the causes explain is no spot: where the identified model loses the pattern and the last one does not, its motion
was wrong.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.interpolate import LinearNDInterpolator

from idic.correlation import camera_at
from idic.diagnose.chain import diagnose
from idic.diagnose.diagnosis import Diagnosis
from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.refits.refit_job import ExperimentSource, Refits
from idic.diagnose.residual.spots import LEFT_OUT, LeftOut, Spot, find_spots
from idic.diagnose.selection.notes import Notes
from idic.diagnose.selection.state import Stage, silent
from idic.identification import Identification, identify


def diagnose_without_spots(source: ExperimentSource, identification: Identification, refits: Refits,
                           stage: Stage = silent, **options: Any) -> Diagnosis:
    """A diagnosis of images without their spots; it holds those that its last model leaves.

    options : of `idic.diagnose.chain.diagnose`
    """
    notes, as_identified = Notes(), (source, identification, None)
    source, identification, spots = notes.attempt(
        "the search for spots in the images", without_spots, source, identification, stage, otherwise=as_identified)
    diagnosis = diagnose(source, identification, refits, stage, **options)
    lasting = notes.attempt("the second look at spots in the images", left_by, diagnosis.enriched, spots,
                            otherwise=spots)
    explained = _number(spots) - _number(lasting)
    if explained:
        notes.texts.append(f"{explained} of {_number(spots)} places where the identified model loses the pattern: the "
                           "causes found explain them. Their pixels stayed out of all fits.")
    return replace(diagnosis, spots=lasting, notes=(*notes.texts, *diagnosis.notes))


def _number(spots: LeftOut | None) -> int:
    return 0 if spots is None else len(spots.spots)


def left_by(model: FittedModel | None, spots: LeftOut | None) -> LeftOut | None:
    """The spots that a model leaves when their pixels are back; None where it leaves none, all without a model."""
    if model is None or spots is None:
        return spots
    circles = _circles(spots.spots)
    user_circles = [list(c) for c in model.source.load().options.left_out_px if list(c) not in circles]
    unmasked = replace(model, source=model.source.with_edits({LEFT_OUT: user_circles}))
    lasting = find_spots(unmasked.identification())
    numbers = [k for k, spot in enumerate(spots.spots) if any(_overlap(spot, s) for s in lasting)]
    return replace(spots, spots=tuple(spots.spots[k] for k in numbers),
                   place_mm=tuple(spots.place_mm[k] for k in numbers)) if numbers else None


def _overlap(a: Spot, b: Spot) -> bool:
    return bool(np.hypot(a.column - b.column, a.row - b.row) < a.radius_px + b.radius_px)


def _circles(spots: tuple[Spot, ...]) -> list[list[float]]:
    """As they are written into the experiment  # (column, row, radius) px"""
    return [[round(x, 2) for x in circle] for spot in spots for circle in spot.left_out]


def without_spots(source: ExperimentSource, identification: Identification,
                  stage: Stage) -> tuple[ExperimentSource, Identification, LeftOut | None]:
    """The source and the identification without the pixels of spots; as they are, and None, where there is none."""
    spots = find_spots(identification)
    if not spots:
        return source, identification, None
    stage(f"fit of the identified model without {len(spots)} spot{'s' if len(spots) > 1 else ''} in the images")
    earlier_circles = [list(circle) for circle in identification.experiment.options.left_out_px]
    spotless_source = source.with_edits({LEFT_OUT: earlier_circles + _circles(spots)})
    experiment = spotless_source.load()
    values = experiment.model.parameters.own_of(identification.parameters.as_values())
    refit = identify(replace(experiment, model=replace(experiment.model,
                                                       parameters=experiment.model.parameters.with_values(values)),
                             stages=()))
    if refit.point is None:
        return source, identification, None
    places = tuple(_place(refit, spot.column, spot.row) for spot in spots)
    return spotless_source, refit, LeftOut(spots, refit.result, places)


def _place(identification: Identification, column: float, row: float) -> tuple[float, ...]:
    """Point of the mesh at a pixel of the reference image, mm; the nearest node where the mesh is not there yet."""
    nodes = identification.experiment.model.mesh.nodes
    nodes_px = camera_at(identification.experiment, identification.parameters).project(nodes)
    place = np.atleast_2d(LinearNDInterpolator(nodes_px, nodes)([column, row]))[0]
    if not np.isfinite(place).all():
        place = nodes[np.argmin(((nodes_px - [column, row]) ** 2).sum(axis=1))]
    return tuple(float(x) for x in place)
