"""The choice of the estimator: ordinary or generalised least squares.

Ordinary least squares come first, since they converge from far. At their solution their sums predict the standard
deviations of generalised ones; these take over where they gain, and end the identification. (Equations:
docs/method.md, section 7, and `idic.correlation.shared_noise`.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from idic.errors import InputError
from idic.identification.step.parameter_covariance import MAX_UNDETERMINED_SHARE, scaled_system, undetermined_share
from idic.identification.step.state import GENERALISED, GENERALISED_REJECTED, ORDINARY, Evaluation
from idic.images import DEGREES, lowpass, spline_error
from idic.model import Experiment, Measured, Model, Parametrised

MAX_WORTHWHILE_STD_RATIO = 0.9  # standard deviation over that of ordinary least squares, of at least one parameter
MAX_LOCAL_UNKNOWNS = 6000  # frame-local unknowns of all frames, eliminated together: 0.3 GB
MAX_EXPLAINED_CHI2 = 1.4  # per pixel; with measured edges and a larger misfit the estimator stays ordinary
MAX_JUDGED_CHI2 = 2.0  # per pixel; a model that leaves more stays ordinary (a plate with 6: E moved by 9 %)
MAX_SPLINE_ERROR_SHARE = 0.3  # error of the spline over the noise, which generalised least squares take for noise


def check_estimator(experiment: Experiment) -> None:
    """Refuse generalised least squares where they are not available.

    Raises
    ------
    InputError
        With the weighting of the paper, which ignores the noise, and with height images of a cross-section.
    """
    if experiment.options.estimator != GENERALISED:
        return
    problem = None
    if experiment.options.weighting != "noise":
        problem = f"weighting = {experiment.options.weighting!r}"
    elif experiment.recording.quantity == "displacement":
        problem = "measured fields, whose noise is correlated between neighbours"
    elif experiment.recording.quantity == "height" and experiment.model.kind == "plane_strain":
        problem = "height images of a cross-section"
    if problem:
        raise InputError("generalised least squares are not available here", file="experiment.toml",
                         key="[options] estimator",
                         expected="images of a surface, weighted by their noise", found=problem,
                         remedy='use estimator = "ordinary", whose standard deviations hold as well')


def next_estimator(current: str, status: str, experiment: Experiment, names: Sequence[str], point: Evaluation,
                   image_noise: float, promised: bool = False) -> str:
    """The estimator that follows at the end of a schedule; `current` where the identification ends.

    Generalised least squares that do not converge are rejected, unless the experiment asks for them. With more
    frame-local unknowns than `MAX_LOCAL_UNKNOWNS` (long tests with measured edges) the estimator stays ordinary.

    With virtual boundaries `auto` stays ordinary, since a few modes never hold all of the motion. Where they do, the
    generalised error bars hold (95.5 and 96 % of 200 draws). On a plate whose grips turned back a little, with modes
    that are straight lines in time, ordinary least squares keep E within half a standard deviation at any amplitude;
    generalised ones are off by 1.8 at a chi^2 per pixel of 0.99 (0.96 without the turn), by 3.4 at 1.1, by 9 at 2.1. No
    threshold of chi^2 tells the first of these from a good fit. Measured edges are free in every frame and have no such
    misfit; with them `auto` stays ordinary where the residual exceeds the noise: on a real composite (chi^2 1.79) the
    generalised ratios differ by 1 to 8 % from the ordinary ones, with half their error bars. It stays
    ordinary, too, where a model leaves twice the noise: noise says nothing of the best weights then.

    promised : of a test that is planned, whose model is right and whose images have no residual of their own
    """
    setting = experiment.options.estimator
    if current == GENERALISED:
        return GENERALISED_REJECTED if status != "converged" and setting == "auto" else current
    if (current == GENERALISED_REJECTED or status != "converged" or point.system.predicted is None
            or setting == ORDINARY):
        return current
    if sum(len(record.local_step) + len(record.brightness) for record in point.system.frames) > MAX_LOCAL_UNKNOWNS:
        return current
    if setting == GENERALISED:
        return GENERALISED
    if not promised and point.misfit(experiment.options.lowpass_px) > MAX_JUDGED_CHI2:
        return current
    if experiment.options.interpolation != "quintic" or experiment.options.weighting != "noise":
        return current  # generalised least squares magnify the bias of the cubic spline
    if any(isinstance(entry.drive, Parametrised) for entry in experiment.model.prescribed):
        return current
    if any(isinstance(entry.drive, Measured) for entry in experiment.model.prescribed) and (
            point.misfit(experiment.options.lowpass_px) > MAX_EXPLAINED_CHI2):
        return current
    if predicted_gain(experiment.model, names, point, image_noise) >= MAX_WORTHWHILE_STD_RATIO:
        return current
    return current if spline_share(experiment) > MAX_SPLINE_ERROR_SHARE else GENERALISED


def may_begin_generalised(experiment: Experiment) -> bool:
    """Whether the identification of a recording may begin with generalised least squares, which ended that of a copy.

    The error of the spline is judged again, since the noise of the recording is lower than that of the copy. The misfit
    at measured edges is unknown before the first point, so that these begin with ordinary least squares.
    """
    if experiment.options.estimator == GENERALISED:
        return True
    measured = any(isinstance(entry.drive, Measured) for entry in experiment.model.prescribed)
    return not measured and spline_share(experiment) <= MAX_SPLINE_ERROR_SHARE


def estimator_notes(experiment: Experiment, estimator: str) -> list[str]:
    """Notes for the result where generalised least squares are asked for and their error bars may be too small."""
    if estimator != GENERALISED or experiment.options.estimator != GENERALISED:
        return []
    share = spline_share(experiment)
    if share <= MAX_SPLINE_ERROR_SHARE:
        return []
    return [f"generalised least squares treat the error of the interpolating spline, {share:.2g} of the noise of an "
            'image, as noise: their error bars may be too small; estimator = "auto" uses ordinary least squares here']


def spline_share(experiment: Experiment) -> float:
    """Error of the spline on the reference image over the noise of one image; 0 where either is unknown.

    The error repeats itself where the pattern returns to the same position between pixels. Generalised least squares
    weigh every frame as a new draw, so that their error bars are too small: by up to 13 times on a virtual test of 12
    and 16 bits without noise.
    """
    recording = experiment.recording
    noise = recording.noise.std_gv
    if recording.stack is None or recording.quantity != "grey" or not noise:
        return 0.0
    options = experiment.options
    image = lowpass(np.asarray(recording.stack.frame(experiment.model.reference), dtype=np.float32), options.lowpass_px)
    return spline_error(image, DEGREES[options.interpolation], noise) / noise


def with_final_weights(point: Evaluation, experiment: Experiment, names: Sequence[str],
                       image_noise: float) -> Evaluation:
    """A point of ordinary least squares with the sums of the estimator that would end an identification, as
    predicted."""
    if next_estimator(ORDINARY, "converged", experiment, names, point, image_noise, promised=True) != GENERALISED:
        return point
    predicted = point.system.predicted
    return replace(point, system=replace(point.system, M=predicted, spread=predicted),
                   reference_gram=np.zeros_like(point.reference_gram))


def predicted_gain(model: Model, names: Sequence[str], point: Evaluation, image_noise: float) -> float:
    """The smallest ratio of the standard deviations of generalised to those of ordinary least squares, 1 without any.

    point : of ordinary least squares, with `predicted`
    """
    parameters = model.parameters.with_free(names)
    system = point.system.restrict(names)
    pick = [point.system.names.index(name) for name in names]
    gram = point.reference_gram[np.ix_(pick, pick)]
    nothing = np.zeros_like(gram)
    ratios = []
    for equations, noise in ((system, gram), (replace(system, M=system.predicted, spread=system.predicted), nothing)):
        scaled = scaled_system(equations, parameters, noise, image_noise)
        directions = scaled.spectrum()
        stds = np.sqrt(np.maximum(np.diagonal(scaled.covariance(directions)), 0.0))
        ratios.append(np.where(undetermined_share(directions) > MAX_UNDETERMINED_SHARE, np.nan, stds))
    comparable = np.isfinite(ratios).all(axis=0) & (ratios[0] > 0.0)
    return float((ratios[1][comparable] / ratios[0][comparable]).min(initial=1.0))
