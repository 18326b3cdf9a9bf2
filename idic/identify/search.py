"""Where to begin, where no descent leads to the answer from the start that is given.

Some parameters say when something begins: softening, say. Where the start says "never" or "long ago", nothing depends
on them any more and no step leads back. Their law names values to begin at (`LawParameter.start_values`). From each of them,
the others at their start, a coarse fit of a few evaluations is made (`idic.identify.coarse`); where none comes near,
the best ones are carried on. The best of all is where the identification begins. A start that is near, and whose values
lie among those, is left alone.

All of this is done with a simplified model. What that says of a start that may be near (`MAX_PROMISING_COARSE_MISFIT`) is asked of the
given one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from idic.identify.coarse import CoarseFit
from idic.identify.step.schedule import first_free
from idic.model.experiment import Experiment

MAX_NEAR_MISFIT = 2.0  # misfit (a pixel, 2 % of the channels) from which the images lead on
MAX_NEAR_COARSE_MISFIT = 3.0  # the same of the simplified model, which is itself a pixel off: 2.5 at the truth of a necking strip
MAX_PROMISING_COARSE_MISFIT = 6.0  # misfit of the simplified model from which a start may be near
MAX_STABILISED_STARTS = 2  # times at most: where every trial breaks down on its way
TRIAL_EVALUATIONS, CONTINUED_EVALUATIONS, CONTINUED_TRIALS = 3, 4, 2  # evaluations of every trial, of those carried on, and how many these are


@dataclass(frozen=True)
class Trial:
    """A place to begin at: values over the start's, internal units; so many evaluations at most; simplified model?"""

    label: str
    values: Mapping[str, float]
    evaluations: int
    simplified: bool = True


@dataclass(frozen=True)
class Found:
    """What a search ended with: values of all parameters, and every fit that was made, in order, by its label.

    moved : whether the values are others than the start's
    """

    values: Mapping[str, float]
    tried: tuple[tuple[str, CoarseFit], ...]
    moved: bool


def search(experiment: Experiment, fit_all: Callable[[Sequence[Trial]], Sequence[CoarseFit]],
           say: Callable[[str], None] = lambda text: None) -> Found:
    """Look for a better start.

    fit_all : makes the coarse fits of several trials, side by side where it can; in the order of the trials
    say : gets a line when the fits of some trials are there
    """
    tried: list[tuple[str, CoarseFit]] = []
    contenders: list[CoarseFit] = []  # of the simplified model: only these can be compared with each other

    def made(trials: Sequence[Trial]) -> list[CoarseFit]:
        fits = list(fit_all(trials))
        for trial, fit in zip(trials, fits, strict=True):
            tried.append((trial.label, fit))
            contenders.extend([fit] if trial.simplified else [])
            say(f"search {len(tried)}: {describe_trial(trial.label, fit)}")
        return fits

    start = experiment.parameters.as_values()
    (here,) = made([Trial("start", {}, 1)])
    if here.misfit < MAX_PROMISING_COARSE_MISFIT and _inside(experiment):
        (exact,) = made([Trial("start, as it is", {}, 1, simplified=False)])
        if exact.misfit < MAX_NEAR_MISFIT:
            return Found(start, tuple(tried), False)
    trials = trial_points(experiment)
    first = made(trials)
    for power in range(1, MAX_STABILISED_STARTS + 1):
        if any(fit.part >= 1.0 for fit in first) or not (calm := stabilised_start(experiment, power)):
            break
        more = [Trial(f"{t.label}, stabilised", {**calm, **t.values}, TRIAL_EVALUATIONS) for t in trials_of_law(experiment)]
        trials, first = [*trials, *more], [*first, *made(more)]
    best = sorted(range(len(first)), key=lambda k: (first[k].phi, k))[:CONTINUED_TRIALS]
    if first[best[0]].misfit > MAX_NEAR_COARSE_MISFIT:
        made([Trial(f"{trials[k].label}, carried on", first[k].values, CONTINUED_EVALUATIONS) for k in best])
    winner = min(contenders, key=lambda fit: fit.phi)
    return Found(dict(winner.values), tuple(tried), True)


def describe_trial(label: str, fit: CoarseFit) -> str:
    """What came of a trial, in words."""
    if not np.isfinite(fit.phi):
        return f"{label}: no simulation"
    came = "" if fit.part >= 1.0 else f", simulated {100 * fit.part:.0f} % of the test"
    number = f"{fit.evaluations} evaluation{'s' if fit.evaluations != 1 else ''}"
    return f"{label}: misfit {fit.misfit:.3g} after {number}{came}"


def trial_points(experiment: Experiment) -> list[Trial]:
    """One trial per value that a law names for a free parameter, and the start itself where it lies among them."""
    return [*([Trial("start, carried on", {}, TRIAL_EVALUATIONS)] if _inside(experiment) else []), *trials_of_law(experiment)]


def trials_of_law(experiment: Experiment) -> list[Trial]:
    """One trial per value that a law names for a free parameter."""
    points = []
    for name in first_free(experiment):
        parameter = experiment.parameters[name]
        low, high = parameter.bounds
        points += [Trial(f"{name} = {value:g}", {name: value}, TRIAL_EVALUATIONS) for value in parameter.start_values
                   if low <= value <= high]
    return points


def stabilised_start(experiment: Experiment, power: int) -> dict[str, float]:
    """Values with which the body is more stable than at its start, of the parameters whose law says how."""
    parameters = [experiment.parameters[name] for name in first_free(experiment)]
    return {p.name: float(np.clip(p.value * p.stabilising_factor**power, *p.bounds)) for p in parameters
            if p.stabilising_factor != 1.0}


def _inside(experiment: Experiment) -> bool:
    """Whether the start lies among the values that are to be tried."""
    asking = [experiment.parameters[name] for name in first_free(experiment)]
    return all(min(p.start_values) <= p.value <= max(p.start_values) for p in asking if p.start_values)
