"""Nonuniform illumination: light, contrast and offset with hats over the image, growing with time or the motion, or to
and fro.

A lamp multiplies the grey values; haze takes contrast about their mean; stray light adds to them.

What is alike all over a frame is no candidate: gain and offset of every frame are among the unknowns already.
"""

from __future__ import annotations

import numpy as np

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.residual.grey_value_effects import LIGHT
from idic.model import hats, knot_frames

PATCHES_PER_SIDE = 4  # along the longer side of the visible region, in the refit
COURSE_KNOTS = 3  # of a course that the data give, at every place; in the refit every frame has its own


def variants(situation: Situation) -> tuple[Variant, ...]:
    experiment = situation.experiment
    if experiment.recording.quantity != "grey" or experiment.options.brightness == "patch":
        return ()
    nodes_px = experiment.model.camera.project(experiment.model.mesh.nodes)
    size = float(min(np.ptp(nodes_px, axis=0).max(), max(experiment.recording.image_shape)) / PATCHES_PER_SIDE)
    edits = {"options.brightness": "patch", "options.patch_px": max(size, 16.0)}
    proposals = []
    for kind, quantity in ((LIGHT, "the light"), ("gain", "the contrast"), ("offset", "the offset of the light")):
        proposals += [Variant(f"{quantity} grows with {name}", edits, (), {}, pixels=(kind, course[None]))
                      for name, course in courses(situation)]
    if experiment.model.n_frames > COURSE_KNOTS:
        knot_courses = hats(experiment.model.times, experiment.model.reference,
                            knot_frames(experiment.model.n_frames, experiment.model.reference, COURSE_KNOTS))
        proposals.append(Variant("light with an identified time course", edits, (), {}, pixels=(LIGHT, knot_courses),
                                 free_course=True))
    return tuple(proposals)


def courses(situation: Situation) -> list[tuple[str, np.ndarray]]:
    """Time, and the load where that is something else, both relative to their largest  # name, (n_frames,)"""
    experiment = situation.experiment
    time = (experiment.model.times - experiment.model.times[experiment.model.reference]) / situation.duration
    pairs = [("time", time)]
    if experiment.model.channels:
        load = experiment.model.channels[0].values - experiment.model.channels[0].values[experiment.model.reference]
        load = load / (np.abs(load).max() or 1.0)
        if abs(np.corrcoef(time, load)[0, 1]) < 0.98:
            pairs.append((experiment.model.channels[0].column, load))
    return pairs


register(Candidate(
    "illumination", "camera", "nonuniform illumination", "the same light in every frame",
    rivals={"defocus": "both change contrast: a lamp in some places, focus everywhere"},
    separating_tests=("record still frames over the same time", "shield the specimen from daylight"),
    variants=variants,
    paraphrase="light that changes from place to place"))
