"""Schedules: weak directions locked until the strong ones stand; stages on blurred images or the first part of a test.

Far from the solution the weak eigen-directions of M answer to the errors of the strong ones: their steps lead astray.
With ``schedule = "spectrum"`` an eigen-direction waits until every direction that the data know ten times better has
come to within a tenth (in the scaled unknowns, ln of a positive parameter) of where its own Gauss-Newton step leads.

A stage may look at blurred images (``lowpass_px``: a pattern of longer waves is matched from farther away) or at the
first part of the test only (``until_s``: less motion, and less history that goes wrong). Such a stage only leads to the
next one: it ends where a step moves nothing by more than `MIN_PRELIMINARY_STEP`, or would make the residual hardly smaller. So does a
stage with some parameters locked that a later one frees: what the wrong values of those do to the others is no matter.
After a search for a start (`idic.identify.search`) blurred images come first without being asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from idic.identify.covariance import Scaled, Spectrum
from idic.model.experiment import Experiment, Stage

MAX_SETTLED_STEP = 0.1  # scaled: a direction whose own step is shorter stands
WAITING_STD_RATIO = 10.0  # times the standard deviation: such a direction waits for the stronger one
MIN_PRELIMINARY_STEP = 0.02  # scaled: steps of a leading stage that are shorter end it
MIN_PRELIMINARY_GAIN = 0.05  # of the functional, the decrease that a full step promises: a leading stage with less to gain is over
MIN_CONTINUED_STAGE_GAIN = 1e-3  # the same of a stage that sees all images, where a later one frees what it frees and more
SCHEDULES = ("all", "spectrum")
BLURRED_STAGE = Stage("all", max_iterations=5, lowpass_px=3.0)  # after a search: what it found is off by up to a few pixels


def wants_search(experiment: Experiment) -> bool:
    """Whether a better start is looked for before the first step: something is free that only begins at some time."""
    options = experiment.options
    asked = options.search != "never" and options.method == "integrated" and experiment.solver is None
    return asked and any(experiment.parameters[name].start_values for name in first_free(experiment))


def first_free(experiment: Experiment) -> tuple[str, ...]:
    """What the first stage frees: a search leaves the others where they are, too."""
    names = experiment.stages[0].free if experiment.stages else "all"
    return tuple(name for name in experiment.parameters.free if names == "all" or name in names)


def begins_blurred(experiment: Experiment) -> bool:
    """Whether the schedule begins with `BLURRED_STAGE`: where a start may have to be looked for, and no stage is asked for.

    A start that was near already skips it (`idic.identify.loop.start`).
    """
    return not experiment.stages and experiment.quantity == "grey" and wants_search(experiment)


def strong_directions(scaled: Scaled, found: Spectrum) -> np.ndarray:
    """The eigen-directions to step along: those that wait for no stronger one  # (n,) bool"""
    steps = np.abs(found.vectors.T @ scaled.b) / np.where(found.values > 0.0, found.values, np.inf)
    moving = found.determined & (steps > MAX_SETTLED_STEP)
    return np.array([not np.any(moving & (found.stds * WAITING_STD_RATIO < own)) for own in found.stds], dtype=bool)


def is_preliminary(stage: Stage) -> bool:
    """Whether a stage sees other images, or fewer of them, than the identification is about."""
    return stage.lowpass_px is not None or stage.until_s is not None


def is_continued(stages: Sequence[Stage], number: int) -> bool:
    """Whether the last stage frees what this one does and more: then this one need not be brought to its very end."""
    own, last = set(stages[number].free), set(stages[-1].free)
    return number + 1 < len(stages) and own < last


def same_images(first: Stage, second: Stage) -> bool:
    """Whether two stages look at the same images."""
    return (first.lowpass_px, first.until_s) == (second.lowpass_px, second.until_s)


def seen_in(experiment: Experiment, stage: Stage) -> Experiment:
    """The experiment as a stage sees it; itself where that is all of it."""
    if stage.lowpass_px is not None:
        blur = max(stage.lowpass_px, experiment.options.lowpass_px)
        experiment = replace(experiment, options=replace(experiment.options, lowpass_px=blur))
    if stage.until_s is None:
        return experiment
    late = np.flatnonzero(experiment.times > stage.until_s)
    return replace(experiment, excluded=tuple(sorted({*experiment.excluded, *map(int, late)})))
