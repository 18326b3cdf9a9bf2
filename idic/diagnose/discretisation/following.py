"""The parameters follow a known error by one step, as they have taken a part of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.diagnose.residual.score import null_model
from idic.identification import AcceptedPoint, Identification
from idic.model import Experiment, build_forward
from idic.parameters import ParameterSet

# of a parameter: an error of the simulation that was found so near is not found anew. Beside a new one the parameters
# move by a part of this distance
NEAR_STD = 0.25
MAX_CHANGE = 0.5  # of a positive parameter, by one step


def following(residual: ResidualEvidence) -> tuple[dict[str, float], float]:
    """By how much the free parameters would still move, to first order, and the chi-square that it brings; those that
    a bound holds back stay."""
    parameters, null = residual.context.parameters, residual.null
    while True:
        projection = null_model(residual.evidence, null)
        steps = projection.remaining
        inside = [j for j, (name, step) in enumerate(zip(null.names, steps, strict=True))
                  if not _leaves(parameters[name].value, step, parameters[name].bounds)]
        if len(inside) == null.n:
            return dict(zip(null.names, steps.tolist(), strict=True)), float(projection.b @ steps)
        null = null.pick(inside)


def _leaves(value: float, step: float, bounds: tuple[float, float]) -> bool:
    """Whether a step from a bound would leave it."""
    return (value >= bounds[1] and step > 0.0) or (value <= bounds[0] and step < 0.0)


def moved(identification: Identification, steps: Mapping[str, float]) -> Identification:
    """At other values of free parameters, within their bounds; steps : of those that move

    A step is shortened as a whole where a positive parameter would change by more than half its value, as that is
    beyond first order: a bulk modulus of rubber that a bent sheet hardly determines went to zero.
    """
    values = identification.parameters.as_values()
    for name, change in shortened(identification.parameters, steps).items():
        low, high = identification.parameters[name].bounds
        values[name] = float(np.clip(values[name] + change, low, high))
    return at_values(identification, identification.experiment, values)


def shortened(parameters: ParameterSet, steps: Mapping[str, float]) -> dict[str, float]:
    """A step, shortened as a whole where a positive parameter would change by more than half its value, as that is
    beyond first order: a bulk modulus of rubber that a bent sheet hardly determined went to zero, and so did the rate
    of creep that imitated yielding."""
    share = share_of_step(parameters, steps)
    return {name: share * change for name, change in steps.items()}


def share_of_step(parameters: ParameterSet, steps: Mapping[str, float]) -> float:
    """How much of a step first order allows: 1, or less where a positive parameter changes by `MAX_CHANGE`."""
    largest = max((abs(change) / abs(parameters[name].value) for name, change in steps.items()
                   if parameters[name].transform == "log"), default=0.0)
    return MAX_CHANGE / largest if largest > MAX_CHANGE else 1.0


def at_values(identification: Identification, experiment: Experiment, values: dict[str, float]) -> Identification:
    """The record of an identification with another experiment and other values; its simulation is not kept."""
    accepted = identification.state.accepted
    state = replace(identification.state, accepted=AcceptedPoint(values) if accepted is None else replace(accepted,
                                                                                               values=values))
    return replace(identification, experiment=experiment, forward=build_forward(experiment), state=state, path=None)


def is_at(values: Mapping[str, float], identification: Identification, stds: Mapping[str, float | None]) -> bool:
    """Whether parameters are those of an identification within `NEAR_STD` standard deviations; stds : of its free
    parameters, None where one is open"""
    return all(abs(values[name] - identification.parameters[name].value) <= NEAR_STD * (stds.get(name) or np.inf)
               for name in identification.parameters.free)
