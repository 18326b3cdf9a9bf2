"""What each of several specimens says of the shared parameters: one step from the joint values by its own equations.

    lam_i = lam + P_i b_i,      Cov_i = P_i [ Cov(b_i) + A_i^T V_i A_i ] P_i   (docs/method.md, equation 16.1)

with the normal equations of specimen i alone at the joint values (the first-order value of a separate identification),
and with the discrepancy that its model leaves at its own values. Its own parameters (alignment, thickness, slip, with
their priors) are free in that step; priors of shared parameters are left out, as all specimens have them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace

from idic.identification.discrepancy.normal_equations import DiscrepancySystem
from idic.identification.joint import Joint
from idic.identification.loop import parameters_at
from idic.identification.result import Analysis
from idic.identification.specimens.scatter import MIN_SPECIMENS, Scatter, scatter
from idic.identification.step.state import Evaluation, LoopState
from idic.parameters import Parameter, ParameterSet


@dataclass(frozen=True)
class OwnValue:
    """Value and standard deviation of a shared parameter by one specimen, in scaled and in the user's units."""

    scaled: float
    scaled_std: float
    value: float
    std: float


def specimens_content(joint: Joint, state: LoopState, parts: Mapping[str, Evaluation], noise: Mapping[str, float],
                      discrepancies: Mapping[str, DiscrepancySystem | str]) -> dict[str, dict]:
    """The entry ``specimens`` of a joint result: per shared free parameter, the specimens and their scatter.

    Returns
    -------
    {name: {"unit", "values": {experiment: {"value", "std"}}, "between_std", "between_ci95", "p_value", "mean",
    "mean_std"}}; the last five are None where fewer than two specimens determine the parameter.
    """
    counts = Counter(joined for names in joint.names.values() for joined in names.values())
    shared = [name for name in joint.whole.model.parameters.free if counts[name] > 1]
    current = {name: replace(p, prior_mean=None, prior_std=None)  # as every specimen sees them: in the same scaled unit
               for name, p in parameters_at(joint.whole.model, state).items() if name in shared}
    own_values = {name: _own_values(joint, name, state, parts[name], noise[name], discrepancies[name], current)
                  for name in parts}
    return {name: _entry(current[name],
                         {specimen: values[name] for specimen, values in own_values.items() if name in values})
            for name in shared}


def _own_values(joint: Joint, name: str, state: LoopState, point: Evaluation, noise: float,
                discrepancy: DiscrepancySystem | str, shared: Mapping[str, Parameter]) -> dict[str, OwnValue]:
    """By the name in the whole; parameters that this specimen does not determine are left out.

    shared : the shared parameters, by the name in the whole, without their priors
    """
    experiment, names = joint.experiments[name], joint.names[name]
    current = parameters_at(experiment.model, joint.state_of(name, state))
    parameters = ParameterSet(
        (replace(shared[names[p.name]], name=p.name) if names[p.name] in shared else p for p in current.values()),
        [prior for prior in current.joint if not any(names.get(own_name) in shared for own_name in prior.names)])
    analysis = Analysis(experiment, parameters, point, noise, discrepancy)
    step = analysis.spectrum.inverse @ analysis.scaled.b
    values = {}
    for i, own_name in enumerate(analysis.names):
        p, std = parameters[own_name], analysis.std(own_name)
        if names[own_name] not in shared or std is None:
            continue
        scaled = p.to_scaled() + float(step[i])
        value = p.from_scaled(scaled)
        estimate = replace(p, value=value)
        values[names[own_name]] = OwnValue(scaled, std / abs(p.slope()), estimate.shown,
                                           std / abs(p.slope()) * abs(estimate.slope() / p.factor))
    return values


def _entry(p: Parameter, specimens: Mapping[str, OwnValue]) -> dict:
    entry: dict = {"unit": p.unit,
                   "values": {name: {"value": specimen.value, "std": specimen.std}
                              for name, specimen in specimens.items()},
                   "between_std": None, "between_ci95": None, "p_value": None, "mean": None, "mean_std": None}
    if len(specimens) < MIN_SPECIMENS:
        return entry
    between: Scatter = scatter([specimen.scaled for specimen in specimens.values()],
                               [specimen.scaled_std for specimen in specimens.values()])
    mean = replace(p, value=p.from_scaled(between.mean))
    size = abs(mean.slope() / p.factor)  # of a small scaled step, in the user's unit
    return entry | {"between_std": size * between.std, "between_ci95": [size * bound for bound in between.ci95],
                    "p_value": between.p_value, "mean": mean.shown, "mean_std": size * between.mean_std}

