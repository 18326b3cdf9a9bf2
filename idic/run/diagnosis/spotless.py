"""Spots are found before a diagnosis, left out of the images, and the model is identified without them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.interpolate import LinearNDInterpolator

from idic.correlation import camera_at
from idic.diagnose import ExperimentSource, LEFT_OUT, LeftOut, find_spots
from idic.identification import Identification, identify


def without_spots(source: ExperimentSource, found: Identification,
                  stage: Callable[[str], None]) -> tuple[ExperimentSource, Identification, LeftOut | None]:
    """The source and the identification without the pixels of spots; as they are, and None, where there is none."""
    spots = find_spots(found)
    if not spots:
        return source, found, None
    stage(f"fit of the identified model without {len(spots)} spot{'s' if len(spots) > 1 else ''} in the images")
    known = [list(circle) for circle in found.experiment.options.left_out_px]
    circles = [[round(x, 2) for x in circle] for spot in spots for circle in spot.left_out]
    there = source.with_edits({LEFT_OUT: known + circles})
    experiment = there.load()
    values = experiment.model.parameters.own_of(found.parameters.as_values())
    again = identify(replace(experiment, model=replace(experiment.model,
                                                       parameters=experiment.model.parameters.with_values(values)),
                             stages=()))
    if again.point is None:
        return source, found, None
    places = tuple(_place(again, spot.column, spot.row) for spot in spots)
    return there, again, LeftOut(spots, again.result, places)


def _place(found: Identification, column: float, row: float) -> tuple[float, ...]:
    """Point of the mesh at a pixel of the reference image, mm; the nearest node where the mesh is not there yet."""
    nodes = found.experiment.model.mesh.nodes
    seen = camera_at(found.experiment, found.parameters).project(nodes)
    place = np.atleast_2d(LinearNDInterpolator(seen, nodes)([column, row]))[0]
    if not np.isfinite(place).all():
        place = nodes[np.argmin(((seen - [column, row]) ** 2).sum(axis=1))]
    return tuple(float(x) for x in place)
