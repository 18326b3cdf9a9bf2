"""Convergence at a non-smooth point: the gradient jumps and vanishes on no side of the minimum.

Sensitivities jump where the onset of yielding at a material point passes the end of an increment. The functional is
continuous there and its gradient is not, so that Gauss-Newton steps lead from either side to the other. Between two
points whose gradients disagree lies a minimum if a convex combination of both gradients vanishes.
(Goldstein 1977, Math. Program. 13, 14: stationary where 0 lies in the convex hull of the gradients near by.)
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.identification.step.parameter_covariance import Scaled, Spectrum
from idic.parameters import ParameterSet


def directional_derivative(accepted: Scaled, trial: Scaled, directions: Spectrum, parameters: ParameterSet,
                           moved: ParameterSet, max_distance: float) -> Scaled | None:
    """The system of a non-smooth point with the directional derivative; None where the gradient does not jump.

    The point is a minimum where the step of that system vanishes; otherwise the step leads to one through non-smooth
    points.

    Parameters
    ----------
    accepted, trial : systems of the accepted point and of the rejected trial, the same unknowns
    directions : spectrum of `accepted`; parameters, moved : of the two points
    max_distance : between the two, in standard deviations of each unknown
    """
    stds = np.sqrt(np.maximum(np.diagonal(accepted.covariance(directions)), 0.0))
    way = np.array([moved[name].to_scaled() - parameters[name].to_scaled() for name in accepted.names])
    if np.any(np.abs(way) > max_distance * np.where(stds > 0.0, stds, np.inf)):
        return None
    smallest = smallest_gradient(accepted, trial, directions)
    return None if np.array_equal(smallest.b, accepted.b) else smallest


def smallest_gradient(accepted: Scaled, trial: Scaled, directions: Spectrum) -> Scaled:
    """The system of `accepted` with the smallest convex combination of both gradients.

    b = (1 - t) b_accepted + t b_trial, 0 <= t <= 1, with the smallest b^T M^-1 b
    """
    difference = trial.b - accepted.b
    size = float(difference @ directions.inverse @ difference)
    part = float(np.clip(-(accepted.b @ directions.inverse @ difference) / size, 0.0, 1.0)) if size > 0.0 else 0.0
    return replace(accepted, b=accepted.b + part * difference)
