"""Discretisation bias: the error of the identified parameters due to the element size, by one refinement.

At the identified point the test is simulated once more, on quadratic elements in the place of linear ones or on
elements of half the size, and compared with the same images. The Gauss-Newton step from there is the change on the
finer mesh; the noise is the same on both, so that the change is hardly noisy:

    bias = value - value on the finer mesh = -(M^-1 b) on the finer mesh

The finer mesh has a bias, too, by which the figure is too small. Quadratic elements of the same size have a small
part of the bias of linear ones. Elements of half the size keep 2^-p of it: next to nothing of quadratic ones where the
strain is smooth; a quarter of linear bricks; about half where a front of yielding runs through the elements (p = 1), so
that there the true bias is up to twice the figure. A difference in shape between mesh and body (a polygon for a circle)
remains under refinement.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from idic.correlation import CorrelationSystem, Weights
from idic.errors import NotConverged
from idic.identification.discrepancy.normal_equations import DiscrepancySystem
from idic.identification.step.parameter_covariance import MAX_UNDETERMINED_SHARE, scaled_system, undetermined_share
from idic.identification.step.state import Evaluation
from idic.model import Experiment, Model
from idic.parameters import ParameterSet
from idic.simulation_error import refined

Evaluate = Callable[[Experiment, Mapping[str, float], np.ndarray, bool, int | None], tuple[Evaluation, Weights]]


def is_coarse(experiment: Experiment) -> bool:
    """Whether an identification estimates its discretisation bias by itself: linear elements in the plane, as given.

    Of solids, which would cost more than the identification, the error of the motion is estimated
    (`idic.identification.discrepancy.normal_equations`).
    """
    model = experiment.model
    return (model.solver is None and experiment.options.weighting == "noise" and model.mesh.n_dim == 2
            and model.mesh.is_raised_by_default)


def with_mesh_error(discrepancy: DiscrepancySystem, evaluate: Evaluate, experiment: Experiment,
                    values: Mapping[str, float], local: np.ndarray, generalised: bool, ended: Evaluation,
                    increments: int | None) -> DiscrepancySystem:
    """The normal equations of a discrepancy with the error of a coarse mesh; without it where the finer one fails.

    The error of b by the mesh is (M + priors) times the bias of the parameters: it moves them by that bias and leaves
    no residual.

    Parameters
    ----------
    experiment : as its last stage sees it; the others as for `discretisation_bias`
    """
    try:
        biases, _ = discretisation_bias(evaluate, experiment, values, local, generalised, ended, increments)
    except NotConverged:
        return discrepancy
    bias = np.array([biases.get(name, 0.0) for name in discrepancy.names])
    error = discrepancy.M[:, :discrepancy.n] @ bias
    error[:discrepancy.n] += beyond_data(ended.system, experiment.model.parameters.with_values(values), bias)
    return replace(discrepancy, mesh_error=error)


def beyond_data(system: CorrelationSystem, parameters: ParameterSet, bias: np.ndarray) -> np.ndarray:
    """The part of b that belongs to a bias of the parameters beside the M of the data: that of their priors, less that
    of the noise of measured ends  # (n,)"""
    by_priors = parameters.prior_equations(system.names)[0] @ bias
    if system.end_noise is None:
        return by_priors
    scaled = scaled_system(system, parameters, np.zeros_like(system.M), 0.0)
    unweighted = np.linalg.lstsq(scaled.weight, scaled.slopes * by_priors, rcond=None)[0] / scaled.slopes
    return unweighted - system.end_noise @ bias


def discretisation_bias(evaluate: Evaluate, experiment: Experiment, values: Mapping[str, float], local: np.ndarray,
                        generalised: bool, ended: Evaluation,
                        increments: int | None = None) -> tuple[dict[str, float], str]:
    """Bias of every free parameter that the data determine (internal units), and how the mesh was refined.

    Parameters
    ----------
    evaluate : simulates and correlates a point, `idic.identification.in_memory.evaluate_at`
    experiment : as its last stage sees it
    values : identified, internal units
    local : (n_frames, m) mm, frame-local unknowns there
    generalised : whether generalised least squares found them
    ended : on the given mesh there; its remaining step is not due to the mesh
    increments : per frame, extrapolated in time, with which it was simulated; None: those of the options

    Raises
    ------
    InputError
        As `refined`.
    NotConverged
        If the finer model does not converge.
    """
    finer = refined(experiment)
    evaluated, weights = evaluate(finer.experiment, values, finer.carried_local(local), generalised, increments)
    if evaluated.system is None:
        raise NotConverged(f"the finer model does not converge: {evaluated.message}")
    return _biases(experiment.model, values, evaluated, ended, weights.image_noise), finer.way


def time_step_bias(evaluate: Evaluate, experiment: Experiment, values: Mapping[str, float], local: np.ndarray,
                   generalised: bool, ended: Evaluation, increments: int | None = None) -> dict[str, float]:
    """Bias by the increments of every free parameter that the data determine (internal units), by halving them.

    The test is simulated once more, extrapolated in time from the given increments and half of their length.
    Extrapolated increments leave a quarter of their error when they are halved.

    Parameters
    ----------
    evaluate, experiment, values, local, generalised, ended, increments : as for `discretisation_bias`

    Raises
    ------
    NotConverged
        If the simulation with shorter increments does not converge.
    """
    finer = 2 * (increments or experiment.options.substeps or 1)
    evaluated, weights = evaluate(experiment, values, local, generalised, finer)
    if evaluated.system is None:
        raise NotConverged(f"no equilibrium with shorter increments: {evaluated.message}")
    error_ratio = 1.0 if increments is None else 4.0 / 3.0
    biases = _biases(experiment.model, values, evaluated, ended, weights.image_noise)
    return {name: error_ratio * bias for name, bias in biases.items()}


def _biases(model: Model, values: Mapping[str, float], evaluated: Evaluation, ended: Evaluation,
            image_noise: float) -> dict[str, float]:
    """Values less those where one Gauss-Newton step of the finer model leads, without the step left of the given
    one."""
    parameters = model.parameters.with_values(values)
    steps = []
    for point in (evaluated, ended):
        scaled = scaled_system(point.system, parameters, point.reference_gram, image_noise)
        directions = scaled.spectrum()
        steps.append(directions.inverse @ scaled.b)
    step = steps[0] - steps[1]
    moved = parameters.unpack(parameters.pack() + step)
    share = undetermined_share(directions)  # of the given mesh, whose parameters are reported
    determined = [name for i, name in enumerate(scaled.names) if share[i] <= MAX_UNDETERMINED_SHARE]
    return {name: values[name] - moved[name].value for name in determined}
