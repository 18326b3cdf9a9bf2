"""Ordinary or generalised least squares: which of the two ends an identification.

Ordinary least squares come first: they find the way from far. Where they have arrived, their sums tell what standard
deviations the generalised ones would have; these take over where they gain, and the answer is theirs.
(`idic.correlation.shared_noise` has the equations.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from idic.errors import InputError
from idic.identify.covariance import OPEN_SHARE, covariance, scaled_system, spectrum, undetermined_share
from idic.identify.step.state import Evaluation, GENERALISED, ORDINARY, GENERALISED_REJECTED
from idic.images.interpolate import DEGREES
from idic.images.quality.lowpass import lowpass, still_gain
from idic.images.quality.round_trip import spline_error
from idic.model.experiment import Experiment, Measured, Parametrised

MAX_WORTHWHILE_STD_RATIO = 0.9  # standard deviation over that of ordinary least squares, for at least one parameter
MAX_LOCAL_UNKNOWNS = 6000  # frame-local unknowns of all frames, which generalised least squares eliminate together: 0.3 GB
MAX_EXPLAINED_CHI2 = 1.4  # misfit in variances of the noise: above, measured edges stay with ordinary least squares
MAX_SPLINE_ERROR_SHARE = 0.3  # of the noise: an error of the spline that generalised least squares would take for noise


def check_estimator(experiment: Experiment) -> None:
    """Refuse generalised least squares where there are none.

    Raises
    ------
    InputError
        With the weighting of the paper, which knows no noise, and with cross-sections seen from above.
    """
    if experiment.options.estimator != GENERALISED:
        return
    problem = None
    if experiment.options.weighting != "noise":
        problem = f"weighting = {experiment.options.weighting!r}"
    elif experiment.quantity == "height" and experiment.kind == "plane_strain":
        problem = "height images of a cross-section"
    if problem:
        raise InputError("no generalised least squares here", file="experiment.toml", key="[options] estimator",
                         expected="images of a surface, weighted by their noise", found=problem,
                         remedy='use estimator = "ordinary", whose standard deviations hold too')


def next_estimator(present: str, status: str, experiment: Experiment, names: Sequence[str], point: Evaluation,
                   image_noise: float) -> str:
    """The estimator to go on with from the end of a schedule, the same one where it is the end.

    Generalised least squares that do not converge are given up, unless they are asked for; with very many frame-local
    unknowns (long tests with measured edges) there are none.

    With virtual boundaries `auto` stays ordinary, because a few modes never have all of the motion. Where they do, the
    generalised error bars hold (95.5 and 96 % of 200 draws). But on a plate whose grips turned back a little, seen with
    modes that are straight lines in time, ordinary least squares kept E within half a standard deviation whatever the
    amplitude; generalised ones were off by 1.8 with a chi^2 per pixel of 0.99 (0.96 without), by 3.4 at 1.1, by 9 at
    2.1. No threshold of chi^2 tells the first of these from a good fit. Measured edges are free in every frame and have
    nothing of the kind; with them `auto` stays ordinary where the model leaves more than noise in the images: on a real
    composite (chi^2 1.79) the generalised ratios lay 1 to 8 % beside the ordinary ones, with half their error bars.
    """
    wanted = experiment.options.estimator
    if present == GENERALISED:
        return GENERALISED_REJECTED if status != "converged" and wanted == "auto" else present
    if present == GENERALISED_REJECTED or status != "converged" or point.system.predicted is None or wanted == ORDINARY:
        return present
    if sum(len(record.local_step) + len(record.brightness) for record in point.system.frames) > MAX_LOCAL_UNKNOWNS:
        return present
    if wanted == GENERALISED:
        return GENERALISED
    if experiment.options.interpolation != "quintic" or experiment.options.weighting != "noise":
        return present  # the gain would go with the cubic spline's bias, which it magnifies
    if any(isinstance(entry.drive, Parametrised) for entry in experiment.prescribed):
        return present
    if any(isinstance(entry.drive, Measured) for entry in experiment.prescribed) and (
            misfit(point, experiment.options.lowpass_px) > MAX_EXPLAINED_CHI2):
        return present
    if predicted_gain(experiment, names, point, image_noise) >= MAX_WORTHWHILE_STD_RATIO:
        return present
    return present if spline_share(experiment) > MAX_SPLINE_ERROR_SHARE else GENERALISED


def may_begin_generalised(experiment: Experiment) -> bool:
    """Whether generalised least squares, which ended the identification of a noisier copy, may begin that of the recording.

    What `next_estimator` asks of the noise is asked again: the spline's error counts for more here. What it asks of the
    misfit at measured edges needs a point first.
    """
    if experiment.options.estimator == GENERALISED:
        return True
    measured = any(isinstance(entry.drive, Measured) for entry in experiment.prescribed)
    return not measured and spline_share(experiment) <= MAX_SPLINE_ERROR_SHARE


def misfit(point: Evaluation, lowpass_px: float) -> float:
    """Mean squared residual over that of noise, blurred as the images are: 0.8 to 1.1 where nothing else is left.

    Roughly chi^2 per pixel, whose denominator knows the interpolation of every pixel too.
    """
    pixels = max(sum(record.n_pixels for record in point.system.frames), 1)
    return point.system.phi_image / pixels / still_gain(lowpass_px)


def estimator_notes(experiment: Experiment, estimator: str) -> list[str]:
    """What is to be said of generalised least squares where they were asked for and should not have been."""
    if estimator != GENERALISED or experiment.options.estimator != GENERALISED:
        return []
    share = spline_share(experiment)
    if share <= MAX_SPLINE_ERROR_SHARE:
        return []
    return [f"generalised least squares were asked for, but the interpolating spline is off by {share:.2g} of the noise of "
            'an image, which they take for noise: their error bars may be too small (estimator = "auto" would have stayed '
            "with ordinary least squares)"]


def spline_share(experiment: Experiment) -> float:
    """The spline's error on the reference image over the noise of one image; 0 where nothing is known of either.

    With next to no noise it is all there is. It repeats itself where the pattern returns to like places between the
    pixels, so that the error bars of generalised least squares, which weigh every frame as a new draw, are too small:
    by up to 13 times on a virtual test of 12 and 16 bits without noise.
    """
    noise = experiment.noise.std_gv
    if experiment.stack is None or experiment.quantity != "grey" or not noise:
        return 0.0
    options = experiment.options
    image = lowpass(np.asarray(experiment.stack.frame(experiment.reference), dtype=np.float32), options.lowpass_px)
    return spline_error(image, DEGREES[options.interpolation], noise) / noise


def with_final_weights(point: Evaluation, experiment: Experiment, names: Sequence[str], image_noise: float) -> Evaluation:
    """Sums of ordinary least squares in the weights that an identification would end with, told beforehand."""
    if next_estimator(ORDINARY, "converged", experiment, names, point, image_noise) != GENERALISED:
        return point
    predicted = point.system.predicted
    return replace(point, system=replace(point.system, M=predicted, spread=predicted),
                   reference_gram=np.zeros_like(point.reference_gram))


def predicted_gain(experiment: Experiment, names: Sequence[str], point: Evaluation, image_noise: float) -> float:
    """The smallest ratio of the standard deviations of generalised to those of ordinary least squares, 1 without any.

    point : of ordinary least squares, with `predicted`
    """
    parameters = experiment.parameters.with_free(names)
    system = point.system.restrict(names)
    pick = [point.system.names.index(name) for name in names]
    gram = point.reference_gram[np.ix_(pick, pick)]
    nothing = np.zeros_like(gram)
    ratios = []
    for own, noise in ((system, gram), (replace(system, M=system.predicted, spread=system.predicted), nothing)):
        scaled = scaled_system(own, parameters, noise, image_noise)
        found = spectrum(scaled)
        stds = np.sqrt(np.maximum(np.diagonal(covariance(scaled, found)), 0.0))
        ratios.append(np.where(undetermined_share(found) > OPEN_SHARE, np.nan, stds))
    known = np.isfinite(ratios).all(axis=0) & (ratios[0] > 0.0)
    return float((ratios[1][known] / ratios[0][known]).min(initial=1.0))
