"""The search for a start, where no descent leads from the given start to the answer.

Some parameters say when a process begins (softening). At a start that says "never" or "long ago" the residual does not
depend on them, and no step leads back. Their law names start values (`LawParameter.start_values`). From each of them,
the other parameters at their start, a coarse fit of a few evaluations is made (`idic.identification.coarse`); if none
comes
near, the best ones are continued. The identification begins at the best fit. A start that is near, and whose values lie
among the start values, is kept.

The coarse fits use a simplified model. Where that finds the start promising (`MAX_PROMISING_COARSE_MISFIT`), the given
model decides.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from idic.identification.coarse import CoarseFit
from idic.identification.step.schedule import first_free
from idic.model import Experiment

MAX_NEAR_MISFIT = 2.0  # misfit (a pixel, 2 % of the channels) from which the images lead to the answer
MAX_NEAR_COARSE_MISFIT = 3.0  # of the simplified model, which is a pixel off: 2.5 at the truth of a necking strip
MAX_PROMISING_COARSE_MISFIT = 6.0  # misfit of the simplified model below which a start may be near
MAX_STABILISED_STARTS = 2  # powers of the stabilising factor tried where every simulation breaks down
TRIAL_EVALUATIONS = 3  # of a coarse fit
CONTINUED_EVALUATIONS, CONTINUED_TRIALS = 4, 2  # of a continued fit; how many fits are continued


@dataclass(frozen=True)
class StartTrial:
    """A start to try: values that replace those of the given start (internal units), most evaluations, simplified
    model."""

    label: str
    values: Mapping[str, float]
    evaluations: int
    simplified: bool = True


@dataclass(frozen=True)
class FoundStart:
    """The end of a search: values of all parameters, and every fit in order, by its label.

    moved : whether the values differ from the given start
    """

    values: Mapping[str, float]
    tried: tuple[tuple[str, CoarseFit], ...]
    moved: bool


def search(experiment: Experiment, fit_all: Callable[[Sequence[StartTrial]], Sequence[CoarseFit]],
           say: Callable[[str], None] = lambda text: None) -> FoundStart:
    """Look for a better start.

    fit_all : makes the coarse fits of several trials, in parallel where it can; in the order of the trials
    say : called with a line per finished fit
    """
    tried: list[tuple[str, CoarseFit]] = []
    contenders: list[CoarseFit] = []  # of the simplified model, which alone compare with each other

    def made(trials: Sequence[StartTrial]) -> list[CoarseFit]:
        fits = list(fit_all(trials))
        for trial, fit in zip(trials, fits, strict=True):
            tried.append((trial.label, fit))
            contenders.extend([fit] if trial.simplified else [])
            say(f"search {len(tried)}: {describe_trial(trial.label, fit)}")
        return fits

    start = experiment.model.parameters.as_values()
    (start_fit,) = made([StartTrial("start", {}, 1)])
    if start_fit.misfit < MAX_PROMISING_COARSE_MISFIT and _inside(experiment):
        (exact,) = made([StartTrial("start, given model", {}, 1, simplified=False)])
        if exact.misfit < MAX_NEAR_MISFIT:
            return FoundStart(start, tuple(tried), False)
    trials = trial_points(experiment)
    first = made(trials)
    for power in range(1, MAX_STABILISED_STARTS + 1):
        if any(fit.part >= 1.0 for fit in first) or not (stable := stabilised_start(experiment, power)):
            break
        more = [StartTrial(f"{t.label}, stabilised", {**stable, **t.values}, TRIAL_EVALUATIONS)
                for t in trials_of_law(experiment)]
        trials, first = [*trials, *more], [*first, *made(more)]
    best = sorted(range(len(first)), key=lambda k: (first[k].phi, k))[:CONTINUED_TRIALS]
    if first[best[0]].misfit > MAX_NEAR_COARSE_MISFIT:
        made([StartTrial(f"{trials[k].label}, continued", first[k].values, CONTINUED_EVALUATIONS) for k in best])
    winner = min(contenders, key=lambda fit: fit.phi)
    return FoundStart(dict(winner.values), tuple(tried), True)


def describe_trial(label: str, fit: CoarseFit) -> str:
    """A trial and its fit in one line."""
    if not np.isfinite(fit.phi):
        return f"{label}: no simulation"
    came = "" if fit.part >= 1.0 else f", simulated {100 * fit.part:.0f} % of the test"
    number = f"{fit.evaluations} evaluation{'s' if fit.evaluations != 1 else ''}"
    return f"{label}: misfit {fit.misfit:.3g} after {number}{came}"


def trial_points(experiment: Experiment) -> list[StartTrial]:
    """One trial per start value of a free parameter, and the given start where it lies among them, or where its bounds
    admit none of them."""
    of_law = trials_of_law(experiment)
    start_trials = [StartTrial("start, continued", {}, TRIAL_EVALUATIONS)] if _inside(experiment) or not of_law else []
    return [*start_trials, *of_law]


def trials_of_law(experiment: Experiment) -> list[StartTrial]:
    """One trial per start value that a law names for a free parameter."""
    points = []
    for name in first_free(experiment):
        parameter = experiment.model.parameters[name]
        low, high = parameter.bounds
        points += [StartTrial(f"{name} = {value:g}", {name: value},
                   TRIAL_EVALUATIONS) for value in parameter.start_values if low <= value <= high]
    return points


def stabilised_start(experiment: Experiment, power: int) -> dict[str, float]:
    """Values at which the body is more stable than at its start, of the parameters with a stabilising factor."""
    parameters = [experiment.model.parameters[name] for name in first_free(experiment)]
    return {p.name: float(np.clip(p.value * p.stabilising_factor**power, *p.bounds)) for p in parameters
            if p.stabilising_factor != 1.0}


def _inside(experiment: Experiment) -> bool:
    """Whether the given start lies among the start values of the laws."""
    asking = [experiment.model.parameters[name] for name in first_free(experiment)]
    return all(min(p.start_values) <= p.value <= max(p.start_values) for p in asking if p.start_values)
