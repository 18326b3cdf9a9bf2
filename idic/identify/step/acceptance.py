"""Whether a trial is nearer to the estimate than the accepted point.

The estimate is the root of b (convected reference gradient); the minimum of the functional lies beside it by the
interpolator's noise bias (`image-kernel.md` 1). Far from it the functional tells progress. Near the end only the Newton
decrement D = b^T M^-1 b does, the squared distance to the root in standard deviations; and so it does of generalised
least squares, whose functional would need a sum of residual images.

Where a material point begins to yield, b has a kink, and between frames even a jump. A root may lie at such a place:
steps then lead to and fro across it, by the functional in one direction and by D in the other, for ever. Or D grows
across it and falls behind it, and a search that wants it to fall stays in front of it.
"""

from __future__ import annotations

import numpy as np

from idic.correlation.system import CorrelationSystem
from idic.identify.covariance import Scaled, covariance, scaled_system, spectrum
from idic.identify.step.stages import stage_parameters
from idic.identify.step.state import Evaluation, LoopState
from idic.model.experiment import Experiment, Stage
from idic.parameters import ParameterSet

MAX_PHI_RISE_ON_ACTIVATION = 1.0  # of the functional, one standard deviation: what a parameter may change that has not begun to count
MAX_PHI_RATIO_WITH_FEWER_CUTS = 2.0  # times the functional of an accepted point with cut increments, allowed to a trial with fewer of them
MAX_DECREMENT_RATIO = 0.5  # a step that brings the root nearer at least halves D, or makes half of what it promises of it
MAX_DECREMENT_NEAR_ROOT = 0.25  # D of half a standard deviation: near enough to a root to go over a jump
MAX_RETURN_DISTANCE = 0.5  # of the step: a trial that is nearer than that to an earlier point goes back to it


def functional(system: CorrelationSystem, n_pixels: int) -> float:
    """The functional with so many pixels like the mean of the seen ones: losing some is no progress.

    The pixels of two points also differ in number where camera or geometry move the mesh over the image.
    """
    return system.phi + system.phi_image * (n_pixels - system.n_pixels) / max(system.n_pixels, 1)


def improves(trial: Evaluation, previous: Evaluation, experiment: Experiment, stage: Stage, image_noise: float,
             state: LoopState) -> bool:
    """Whether the functional fell, or the distance to the root of b did, and not by going back.

    An increment that had to be cut at the accepted point and no longer at the trial changes the functional by the error
    of the time integration, at the onset of a neck by more than any step: then the trial need not be better. Nor need
    it where it lets something begin sooner that still has not begun.

    state : of the trial, with the values of both points
    """
    n_pixels = previous.system.n_pixels + previous.system.n_lost
    generalised = trial.system.generalised
    if generalised != previous.system.generalised:
        return True  # the accepted point could not be simulated again for its other weights: nothing to compare
    if state.sought and not generalised and (
            functional(trial.system, n_pixels) <= functional(previous.system, n_pixels) + MAX_PHI_RISE_ON_ACTIVATION):
        return True
    if 0 < trial.increments < previous.increments and (
            generalised or trial.system.phi <= MAX_PHI_RATIO_WITH_FEWER_CUTS * previous.system.phi):
        return True
    there, here = (stage_parameters(experiment.parameters.with_values(values), stage)
                   for values in (state.trial, state.accepted))
    before = _scaled(previous, here, stage, image_noise)
    if returns_to_an_earlier_point(state, before, there, here, experiment.options.tolerance):
        return False
    if not generalised and functional(trial.system, n_pixels) <= functional(previous.system, n_pixels):
        return True
    after, old = decrement(_scaled(trial, there, stage, image_noise)), decrement(before)
    if not generalised:
        return after < MAX_DECREMENT_RATIO * old
    if state.damping == 0.0 and after < MAX_DECREMENT_NEAR_ROOT:
        return True
    delta = _values(there, before.names) - _values(here, before.names)
    left = before.b - before.M @ delta
    return after < old - MAX_DECREMENT_RATIO * (old - left @ spectrum(before).inverse @ left)


def decrement(scaled: Scaled) -> float:
    """D = b^T M^-1 b over the determined directions."""
    return float(scaled.b @ spectrum(scaled).inverse @ scaled.b)


def returns_to_an_earlier_point(state: LoopState, before: Scaled, there: ParameterSet, here: ParameterSet, tolerance: float) -> bool:
    """Whether a trial is back at a point that the same stage and estimator have accepted earlier.

    Parameters
    ----------
    before : of the accepted point, whose standard deviations measure how near the two are
    there, here : parameters of the trial, of the accepted point
    tolerance : of a standard deviation, by which convergence is judged
    """
    earlier = [entry["values"] for entry in state.history if entry["accepted"]][-state.stage_iterations - 1:-1]
    if state.stage_iterations == 0 or not earlier:
        return False
    stds = np.sqrt(np.maximum(np.diagonal(covariance(before, spectrum(before))), 0.0))
    at, now = _values(there, before.names), _values(here, before.names)
    step = np.abs(at - now)
    off = [np.abs(at - _values(here.with_values(values), before.names)) for values in earlier]
    return any(bool(np.all(far <= np.minimum(tolerance * stds, MAX_RETURN_DISTANCE * step.max()))) for far in off)


def _scaled(point: Evaluation, parameters: ParameterSet, stage: Stage, image_noise: float) -> Scaled:
    pick = [point.system.names.index(name) for name in stage.free]
    return scaled_system(point.system.restrict(stage.free), parameters, point.reference_gram[np.ix_(pick, pick)],
                         image_noise)


def _values(parameters: ParameterSet, names: tuple[str, ...]) -> np.ndarray:
    return np.array([parameters[name].to_scaled() for name in names])
