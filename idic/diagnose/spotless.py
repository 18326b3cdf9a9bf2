"""Spots are found before a diagnosis, left out of the images, and the model is identified without them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.interpolate import LinearNDInterpolator

from idic.correlation import camera_at
from idic.diagnose.refits.refit_job import ExperimentSource
from idic.diagnose.residual.spots import LEFT_OUT, LeftOut, find_spots
from idic.identification import Identification, identify


def without_spots(source: ExperimentSource, identification: Identification,
                  stage: Callable[[str], None]) -> tuple[ExperimentSource, Identification, LeftOut | None]:
    """The source and the identification without the pixels of spots; as they are, and None, where there is none."""
    spots = find_spots(identification)
    if not spots:
        return source, identification, None
    stage(f"fit of the identified model without {len(spots)} spot{'s' if len(spots) > 1 else ''} in the images")
    earlier_circles = [list(circle) for circle in identification.experiment.options.left_out_px]
    circles = [[round(x, 2) for x in circle] for spot in spots for circle in spot.left_out]
    spotless_source = source.with_edits({LEFT_OUT: earlier_circles + circles})
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
