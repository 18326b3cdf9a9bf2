"""Schedules: weak directions wait for strong ones; preliminary stages use blurred images or the first part of a test.

Far from the solution the steps along weak eigen-directions of M answer to the errors of the strong ones. With
``schedule = "spectrum"`` an eigen-direction waits until every direction of a ten times smaller standard deviation has a
Gauss-Newton step below a tenth (scaled unknowns, ln of a positive parameter).

A preliminary stage uses blurred images (``lowpass_px``: a pattern of longer waves is matched from farther away) or the
first part of the test (``until_s``: less motion, and less history that goes wrong). It ends where its step is shorter
than `MIN_PRELIMINARY_STEP` or gains less than `MIN_PRELIMINARY_GAIN`. A stage whose parameters are all freed again in
the last one, among others, ends at `MIN_CONTINUED_STAGE_GAIN`: its locked parameters are wrong, so that more precision
is of no use. After a search for a start (`idic.identification.start_search`) a stage on blurred images comes first by
default.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from idic.identification.step.parameter_covariance import Scaled, Spectrum
from idic.model import Experiment, Measured, Stage

MAX_SETTLED_STEP = 0.1  # scaled: a direction with a shorter step no longer holds up weaker ones
WAITING_STD_RATIO = 10.0  # standard deviation of a waiting direction over that of the one it waits for
MIN_PRELIMINARY_STEP = 0.02  # scaled: a shorter step ends a preliminary stage
MIN_PRELIMINARY_GAIN = 0.05  # predicted decrease of the functional by a full step, over the functional
MIN_CONTINUED_STAGE_GAIN = 1e-3  # the same, of a stage on all images that a later one continues with more parameters
SCHEDULES = ("all", "spectrum")
BLURRED_STAGE = Stage("all", max_iterations=5, lowpass_px=3.0)  # after a search, whose result is a few pixels off


def wants_search(experiment: Experiment) -> bool:
    """Whether a start is searched before the first step: a free parameter has start values of its law.

    Not where edges take a motion in space from the images, nor of volumes: the search knows the motion of one camera.
    """
    model = experiment.model
    options = experiment.options
    in_space = experiment.is_stereo and any(isinstance(entry.drive, Measured) for entry in model.prescribed)
    is_allowed = (options.search != "never" and options.method == "integrated" and model.solver is None
                  and not in_space and experiment.recording.quantity != "volume")
    return is_allowed and any(model.parameters[name].start_values for name in first_free(experiment))


def first_free(experiment: Experiment) -> tuple[str, ...]:
    """The parameters that the first stage frees, and a search with it."""
    names = experiment.stages[0].free if experiment.stages else "all"
    return tuple(name for name in experiment.model.parameters.free if names == "all" or name in names)


def begins_blurred(experiment: Experiment) -> bool:
    """Whether the schedule begins with `BLURRED_STAGE`: a start may have to be searched, and no stage is given.

    A start that was near already skips the stage (`idic.identification.loop.start`).
    """
    return not experiment.stages and experiment.recording.quantity == "grey" and wants_search(experiment)


def strong_directions(scaled: Scaled, directions: Spectrum) -> np.ndarray:
    """The eigen-directions to step along: those that wait for no stronger one  # (n,) bool"""
    steps = np.abs(directions.vectors.T @ scaled.b) / np.where(directions.values > 0.0, directions.values, np.inf)
    moving = directions.determined & (steps > MAX_SETTLED_STEP)
    return np.array([not np.any(moving & (directions.stds * WAITING_STD_RATIO < std)) for std in directions.stds],
                    dtype=bool)


def is_preliminary(stage: Stage) -> bool:
    """Whether a stage uses blurred images or a part of the test only."""
    return stage.lowpass_px is not None or stage.until_s is not None


def is_continued(stages: Sequence[Stage], number: int) -> bool:
    """Whether the last stage frees the parameters of this one and more."""
    names, final_names = set(stages[number].free), set(stages[-1].free)
    return number + 1 < len(stages) and names < final_names


def same_images(first: Stage, second: Stage) -> bool:
    """Whether two stages use the same images."""
    return (first.lowpass_px, first.until_s) == (second.lowpass_px, second.until_s)


def seen_in(experiment: Experiment, stage: Stage) -> Experiment:
    """The experiment with the images of a stage; itself where these are all images as they are."""
    if stage.lowpass_px is not None:
        blur = max(stage.lowpass_px, experiment.options.lowpass_px)
        experiment = replace(experiment, options=replace(experiment.options, lowpass_px=blur))
    if stage.until_s is None:
        return experiment
    late = np.flatnonzero(experiment.model.times > stage.until_s)
    return replace(experiment, recording=replace(experiment.recording,
                                                 excluded=tuple(sorted({*experiment.recording.excluded,
                                                                        *map(int, late)}))))
