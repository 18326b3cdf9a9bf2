"""The step of a curve that never falls: values at its knots move in their order.

A value below the one before it counts as that one in the law, and says nothing there: a step that has left the order
finds no way back. The step keeps to it instead: of all steps in order the one nearest to the Gauss-Newton step in the
metric of M,

    min (delta - delta_GN)^T M (delta - delta_GN)   with   z_1 <= z_2 <= ... <= z_n,

a least-squares problem with increments that are bounded below.
"""

from __future__ import annotations

import numpy as np
import scipy

from idic.identification.step.parameter_covariance import Scaled
from idic.parameters import ParameterSet, SmoothnessPrior

RIDGE = 1e-10  # of the diagonal of M: directions without data


def in_order(scaled: Scaled, parameters: ParameterSet, values: np.ndarray, delta: np.ndarray) -> np.ndarray:
    """`delta`, or where it would carry values of a rising curve past each other the nearest step that does not  # (n,)

    values : (n,) scaled values
    """
    for prior in parameters.joint:
        if not isinstance(prior, SmoothnessPrior) or not prior.rising or not set(prior.names) <= set(scaled.names):
            continue
        at = [scaled.names.index(name) for name in prior.names]
        if np.all(np.diff((values + delta)[at]) >= 0.0):
            continue
        diagonal = np.diagonal(scaled.M)
        root = np.linalg.cholesky(scaled.M + RIDGE * np.diag(np.where(diagonal > 0.0, diagonal, 1.0))).T
        ways = np.eye(len(values))  # columns: the other steps, the first value, increments
        ways[np.ix_(at, at)] = np.tril(np.ones((len(at), len(at))))
        origin = np.zeros(len(values))
        origin[at] = -values[at]
        lowest = np.full(len(values), -np.inf)
        lowest[at[1:]] = 0.0
        solution = scipy.optimize.lsq_linear(root @ ways, root @ (delta - origin), bounds=(lowest, np.inf),
                                             method="bvls")
        delta = origin + ways @ solution.x
    return delta
