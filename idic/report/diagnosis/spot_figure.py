"""The figure of spots: what the reference image and a later frame show there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.patches import Circle

from idic.diagnose import Spot
from idic.model import Experiment
from idic.report.diagnosis.spots import WORDS
from idic.report.figures.picture import Colour, Picture
from idic.report.figures.style import look, new_figure, to_picture

MAX_SHOWN, AROUND_RADII, MIN_HALF_PX = 4, 5.0, 14  # spots; half the width of a cut-out


def spot_picture(experiment: Experiment, spots: Sequence[Spot]) -> Picture:
    """Cut-outs of the reference image and of a later frame around the largest spots."""
    model = experiment.model
    largest = spots[:MAX_SHOWN]
    with look():
        figure = new_figure(6.0, 2.7 * len(largest))
        axes = figure.subplots(len(largest), 2, squeeze=False)
        for row, spot in zip(axes, largest, strict=True):
            final_frame = model.n_frames - 1
            later = spot.first or final_frame // 2 + 1
            for axis, frame in zip(row, (model.reference, min(later, final_frame)), strict=True):
                image, half = experiment.recording.stack.frame(frame), max(AROUND_RADII * spot.radius_px, MIN_HALF_PX)
                axis.imshow(image, cmap="gray", vmin=np.nanmin(image), vmax=np.nanmax(image), interpolation="nearest")
                axis.add_patch(Circle((spot.column, spot.row), spot.radius_px + 1.0, fill=False, color=Colour.RED))
                name = "reference image" if frame == model.reference else f"frame {frame}"
                axis.set(xlim=(spot.column - half, spot.column + half), ylim=(spot.row + half, spot.row - half),
                         title=f"{WORDS[spot.kind]}, {name}", xlabel="column [px]", ylabel="row [px]")
                axis.grid(False)
        more = f" {len(spots) - MAX_SHOWN} smaller ones are not shown." if len(spots) > MAX_SHOWN else ""
        return to_picture(figure, "diagnosis_spots", "Spots",
                          f"Circle: place of the spot in the reference image. It is left out of all frames.{more}",
                          as_photo=True)
