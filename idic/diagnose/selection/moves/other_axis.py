"""Another axis of a law that depends on direction: a second minimum that explains the recording as well.

Over the angle of its axis an orthotropic stiffness has several minima. In a small recording two of them may fit equally
well with moduli that differ by far more than their error bars. So the last model is fitted again from other axes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from idic.diagnose.physics.candidate import Variant
from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.refits.refit import Fit
from idic.diagnose.refits.refit_job import RefitJob
from idic.diagnose.screen.select import MIN_SEPARATION_CHI2
from idic.diagnose.selection.rival import COPIES, with_winners
from idic.diagnose.selection.state import State

ANGLE = "angle"
MIN_OTHER_DEG = 20.0  # from the axis that was found, or across it
MAX_OTHER_AXES = 2
MIN_DIFFERENCE_STD = 3.0  # of a parameter of two fits, in standard deviations of both
MIN_CHI2 = COPIES * MIN_SEPARATION_CHI2  # of the whole recording between two models that it tells apart


def fit_from_other_axes(state: State, model: FittedModel) -> Fit | None:
    """The best fit of the last model to the recording that begins at another axis; None without an axis or an
    answer."""
    setting, source, final = state.setting, model.source, model.fit
    turned = next(((entry, winner) for entry, winner in with_winners(state.rounds)
                   if _angle_of(winner.ranked.variant)), None)
    if turned is None or final.choice is None:
        return None
    entry, winner = turned
    variant = winner.ranked.variant
    name = _angle_of(variant)
    scores = {trial.variant.label: (abs(entry.screening.scores.z[k]), trial.variant)
              for k, trial in enumerate(entry.screening.trials)
              if trial.candidate.name == winner.name and trial.variant.new == variant.new}
    distant = [v for _, v in sorted(scores.values(), key=lambda score: -score[0])
               if _apart(v.probe[name], final.values[name]) > MIN_OTHER_DEG][:MAX_OTHER_AXES]
    if not distant:
        return None
    values = tuple({**final.values, **{n: v.probe[n] for n in v.new}} for v in distant)
    job = RefitJob("other_axis", source, tuple(v.label for v in distant), ({},) * len(distant), values, final.local,
                   setting.grid, -np.inf, setting.seed, copies=False, whole_std=True)
    (fit,) = setting.refits([job])
    return replace(fit, name=final.name) if fit.usable else None


def is_better(trial: Fit, final: Fit) -> bool:
    """Whether the recording prefers the other axis."""
    return trial.choice.chi2 < final.choice.chi2 - MIN_CHI2


def is_another_answer(trial: Fit, final: Fit) -> bool:
    """Whether the recording does not tell the two, and a parameter differs by more than the error bars say."""
    if not trial.choice.chi2 < final.choice.chi2 + MIN_CHI2:
        return False
    values = same_axes(trial.values, final.values)
    stds = {name: (std, trial_std) for name, std in final.stds.items() if not name.endswith(f".{ANGLE}")
            and std is not None and (trial_std := trial.stds.get(name)) is not None}
    return any(abs(values[name] - final.values[name]) > MIN_DIFFERENCE_STD * float(np.hypot(*pair))
               for name, pair in stds.items())


def same_axes(values: Mapping[str, float], like: Mapping[str, float]) -> dict[str, float]:
    """The values of an orthotropic law with its first axis where it is in `like`, not across it: the same law."""
    turned = dict(values)
    for name in (n for n in values if n.rpartition(".")[2] == ANGLE):
        stem = name.removesuffix(ANGLE)
        first, second, poisson = (f"{stem}{key}" for key in ("E1", "E2", "nu12"))
        across = 45.0 < (values[name] - like[name]) % 180.0 < 135.0
        if across and {first, second, poisson} <= set(values):
            turned |= {first: values[second], second: values[first], name: values[name] - 90.0,
                       poisson: values[poisson] * values[second] / values[first]}
    return turned


def _angle_of(variant: Variant) -> str:
    return next((name for name in variant.new if name.rpartition(".")[2] == ANGLE), "")


def _apart(first: float, second: float) -> float:
    """Degrees between two axes, or between one and what is across the other: E1 and E2 change their places there."""
    gap = abs(first - second) % 90.0
    return min(gap, 90.0 - gap)
