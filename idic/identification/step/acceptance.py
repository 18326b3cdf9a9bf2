"""Acceptance of a trial: whether it lies nearer to the estimate than the accepted point.

The estimate is the root of b (convected reference gradient); the minimum of the functional differs from it by the
noise bias of the interpolator (docs/method.md, equation 4.4). Far from the root the functional tells progress. Near it
the Newton decrement D = b^T M^-1 b does (equation 10.3), the squared distance to the root in standard deviations.
Generalised least squares are judged by D alone, since their functional would need a sum of residual images.

The functional also sums the noise of the frames. Of it the spline passes the more, the nearer pixels move to whole
pixels; b leaves that change out. Where pixels are many it exceeds what the last steps gain: over a step in 64^3 voxels,
with noise of a quarter of the contrast, the functional changed by -46.3, that noise by -45.6. A trial with a higher
functional is therefore accepted, too, where the function of which b is the slope falls and D with it.

Where a material point begins to yield, b is not smooth and between frames it jumps. A root may lie there: steps then
alternate across it, accepted by the functional in one direction and by D in the other; or D grows across it, and a
search that wants D to fall stops in front of it. Returns to earlier points are therefore rejected, and small D
accepted.
"""

from __future__ import annotations

import numpy as np

from idic.correlation import CorrelationSystem
from idic.identification.step.parameter_covariance import Scaled, scaled_system
from idic.identification.step.stages import stage_parameters
from idic.identification.step.state import Evaluation, LoopState
from idic.model import Experiment, Stage
from idic.parameters import ParameterSet

MAX_PHI_RISE_ON_ACTIVATION = 1.0  # of the functional, one standard deviation, over a step that activates nothing yet
MAX_PHI_RATIO_WITH_FEWER_CUTS = 2.0  # functional of a trial with fewer cut increments over that of the accepted point
MAX_DECREMENT_RATIO = 0.5  # of D after over D before; also the least share of the predicted decrease of D
MIN_FALL_ALONG_SLOPE = 0.1  # of the predicted decrease of D, where b does not turn over the step: more than rounding
MAX_DECREMENT_NEAR_ROOT = 0.25  # D of half a standard deviation: near enough to a root to step across a jump
MAX_RETURN_DISTANCE = 0.5  # of the step: a trial that lies nearer to an earlier point returns to it


def functional(system: CorrelationSystem, n_pixels: int) -> float:
    """The functional at a common number of pixels: lost pixels count as the mean of the seen ones.

    The number of pixels also differs between two points where camera or geometry move the mesh over the image.
    """
    return system.phi + system.phi_image * (n_pixels - system.n_pixels) / max(system.n_pixels, 1)


def improves(trial: Evaluation, previous: Evaluation, experiment: Experiment, stage: Stage, image_noise: float,
             state: LoopState) -> bool:
    """Whether a trial is accepted: lower functional or smaller Newton decrement, and no return to an earlier point.

    Where b does not turn over the step, D need fall by `MIN_FALL_ALONG_SLOPE` only.

    An increment that was cut at the accepted point and is not cut at the trial changes the functional by the error of
    the time integration, at the onset of a neck by more than any step; the trial need not be better then. Nor need it
    be where it tries to activate a parameter that stays inactive.

    state : of the trial, with the values of both points
    """
    n_pixels = previous.system.n_pixels + previous.system.n_lost
    generalised = trial.system.generalised
    if generalised != previous.system.generalised:
        return True  # the accepted point could not be simulated again for its other weights: nothing to compare
    if state.trial.tries_activation and not generalised and functional(trial.system, n_pixels) <= functional(
            previous.system, n_pixels) + MAX_PHI_RISE_ON_ACTIVATION:
        return True
    if 0 < trial.increments < previous.increments and (
            generalised or trial.system.phi <= MAX_PHI_RATIO_WITH_FEWER_CUTS * previous.system.phi):
        return True
    moved, parameters = (stage_parameters(experiment.model.parameters.with_values(point.values), stage)
                         for point in (state.trial, state.accepted))
    scaled = scaled_at(previous, parameters, stage, image_noise)
    if returns_to_an_earlier_point(state, scaled, moved, parameters, experiment.options.tolerance):
        return False
    trial_scaled = scaled_at(trial, moved, stage, image_noise)
    delta = _values(moved, scaled.names) - _values(parameters, scaled.names)
    if not generalised and falls(trial, previous, scaled, trial_scaled, delta):
        return True
    trial_decrement, decrement = newton_decrement(trial_scaled), newton_decrement(scaled)
    residual = scaled.b - scaled.M @ delta
    predicted_fall = decrement - residual @ scaled.spectrum().inverse @ residual
    if not generalised:
        return trial_decrement < MAX_DECREMENT_RATIO * decrement or (
            slope_falls(scaled, trial_scaled, delta)
            and trial_decrement < decrement - MIN_FALL_ALONG_SLOPE * predicted_fall)
    if state.trust.damping == 0.0 and trial_decrement < MAX_DECREMENT_NEAR_ROOT:
        return True
    return trial_decrement < decrement - MAX_DECREMENT_RATIO * predicted_fall


def falls(trial: Evaluation, previous: Evaluation, scaled: Scaled, trial_scaled: Scaled, delta: np.ndarray) -> bool:
    """Whether the functional with the squares of the priors falls over the step delta; where b is weighted, that of
    which it is the slope."""
    if scaled.weight is not None:
        return slope_falls(scaled, trial_scaled, delta)
    n_pixels = previous.system.n_pixels + previous.system.n_lost
    by_priors = -float(delta @ (scaled.pull + trial_scaled.pull))  # quadratic
    return functional(trial.system, n_pixels) + by_priors <= functional(previous.system, n_pixels)


def slope_falls(scaled: Scaled, trial_scaled: Scaled, delta: np.ndarray) -> bool:
    """Whether the function of which -2 b is the slope falls over the step delta, by the trapezoidal rule."""
    return float(delta @ (scaled.b + trial_scaled.b)) >= 0.0


def newton_decrement(scaled: Scaled) -> float:
    """D = b^T M^-1 b over the determined directions."""
    return float(scaled.b @ scaled.spectrum().inverse @ scaled.b)


def returns_to_an_earlier_point(state: LoopState, scaled: Scaled, moved: ParameterSet, parameters: ParameterSet,
                                tolerance: float) -> bool:
    """Whether a trial returns to a point that the same stage and estimator have accepted earlier.

    Parameters
    ----------
    scaled : of the accepted point, whose standard deviations measure the distance
    moved, parameters : parameters of the trial, of the accepted point
    tolerance : of convergence, in standard deviations
    """
    iterations = state.schedule.iterations
    earlier = [entry["values"] for entry in state.history if entry["accepted"]][-iterations - 1:-1]
    if iterations == 0 or not earlier:
        return False
    stds = np.sqrt(np.maximum(np.diagonal(scaled.covariance(scaled.spectrum())), 0.0))
    at, origin = _values(moved, scaled.names), _values(parameters, scaled.names)
    step = np.abs(at - origin)
    off = [np.abs(at - _values(parameters.with_values(values), scaled.names)) for values in earlier]
    nearest = np.minimum(tolerance * stds, MAX_RETURN_DISTANCE * step.max())
    return any(bool(np.all(distance <= nearest)) for distance in off)


def scaled_at(point: Evaluation, parameters: ParameterSet, stage: Stage, image_noise: float) -> Scaled:
    """The scaled normal equations of a point over the unknowns of a stage."""
    pick = [point.system.names.index(name) for name in stage.free]
    return scaled_system(point.system.restrict(stage.free), parameters, point.reference_gram[np.ix_(pick, pick)],
                         image_noise)


def _values(parameters: ParameterSet, names: tuple[str, ...]) -> np.ndarray:
    return np.array([parameters[name].to_scaled() for name in names])
