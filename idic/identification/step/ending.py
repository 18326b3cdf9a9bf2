"""Why the search ended, in one sentence, and which limit ended it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from idic.identification.step.proposal import STEP_CLIP, Step
from idic.identification.step.state import Ending, FORWARD_FAILED, LoopState
from idic.model import Options
from idic.parameters import ParameterSet, SmoothnessPrior

# of the objective, relative: half a unit of chi^2 for half a million pixels; equilibrium is solved to it
MAX_FLAT_CHANGE = 1e-6
ITERATIONS, BOUNDS, STEP, SIMULATION = "iterations", "bounds", "step", "simulation"


def small_step(step: Step, tolerance: float) -> str:
    """Why a search has converged: the last step in standard deviations."""
    return f"the next step is {step.relative:.2g} standard deviations; the tolerance is {tolerance:g}"


def settled(step: Step, share: float) -> str:
    """Why a search has converged beside a misfit: what the last step would gain of it."""
    return (f"the next step ({step.relative:.2g} standard deviations of the noise) would lower the objective by less "
            f"than {share:.0e} of what the model leaves beyond noise")


def flat(step: Step, rejections: int) -> str:
    """Why a search has converged where trial steps were rejected."""
    tried = f"{rejections} trial steps in a row did not lower it" if rejections > 1 else ("the gradient changes its "
                                                                                          "sign within a step")
    return f"the objective is flat: {tried}, and the next step is {step.relative:.2g} standard deviations"


def beyond_bounds(step: Step, parameters: ParameterSet) -> tuple[str, ...]:
    """Parameters whose minimum lies beyond a bound; a value of a free curve may stay at zero and is none of them."""
    curves = {name for prior in parameters.joint if isinstance(prior, SmoothnessPrior) for name in prior.names}
    return tuple(name for name in step.pinned
                 if not (name in curves and parameters[name].bounds[0] == 0.0
                         and parameters[name].value < 0.5 * parameters[name].bounds[1]))


def bounded(names: Sequence[str]) -> Ending:
    """The minimum of these parameters lies beyond a bound."""
    return Ending("at_bound",
                  f"the next step would move {', '.join(names)} over "
                  f"{'its bound' if len(names) == 1 else 'their bounds'}", BOUNDS)


def out_of_iterations(count: int, key: str, step: Step, options: Options) -> Ending:
    """The limit of evaluations is reached; where the steps were limited too, the sentence says so."""
    counted = "evaluations" if key == "options" else "steps"
    reason = (f"{count} {counted} are the limit (max_iterations in [{key}]); the next step is {step.relative:.2g} "
              "standard deviations")
    if step.clipped:
        reason += (f" and is shortened by the limit of a step ({options.step_limit or STEP_CLIP:g} in the logarithm of "
                   f"a "
                   "parameter; step_limit in [options])")
    return Ending("max_iterations", reason, ITERATIONS)


def stuck(step: Step, rejections: int) -> Ending:
    """No trial step lowers the objective, and the full step is not small."""
    tried = (f"{rejections} trial steps in a row, each shorter than the last, did not lower the objective" if rejections
             else "damping has shortened the step to nothing")
    return Ending("stalled", f"{tried}; the full step would be {step.relative:.2g} standard deviations", STEP)


def judged_flat(state: LoopState, ending: Ending) -> Ending:
    """The ending of a stalled search; converged where the rejected steps, the full one first, left the objective as it
    was.

    Objectives of generalised least squares at different points are not comparable: such a search stays stalled.
    """
    accepted = state.accepted
    if ending.status != "stalled" or state.generalised or accepted is None or not accepted.phi:
        return ending
    changes = [_change(entry, accepted.phi) for entry in _since_accepted(state.history)]
    if not changes or max(changes) > MAX_FLAT_CHANGE:
        return ending
    return Ending("converged",
                  f"the objective is flat: {len(changes)} trial steps, the full one first, changed it by less than "
                               f"{max(max(changes), 1e-12):.0e} of itself")


def failed_simulation(state: LoopState, message: str) -> LoopState:
    """The state that ends at a simulation without equilibrium."""
    place = "at the starting values" if state.accepted is None else "at every shorter step tried"
    return replace(state, status=FORWARD_FAILED,
                   end=Ending(FORWARD_FAILED, f"the simulation fails {place}{f': {message}' if message else ''}",
                              SIMULATION))


def end_entry(state: LoopState) -> dict:
    """``end`` of result.json: ``reason``, a sentence part, and ``limit``: iterations, bounds, step, simulation or
    None."""
    if state.status == "interrupted":
        return {"reason": "the run was interrupted", "limit": None}
    return {"reason": state.end.reason, "limit": state.end.limit}


def _since_accepted(history: Sequence[Mapping]) -> list[Mapping]:
    latest = max((k for k, entry in enumerate(history) if entry["accepted"]), default=-1)
    return [entry for entry in history[latest + 1:] if not entry["passed_over"]]


def _change(entry: Mapping, phi: float) -> float:
    return float("inf") if entry["phi"] is None else abs(entry["phi"] - phi) / phi
