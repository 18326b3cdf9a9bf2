"""Parameters of a body of real thickness and finite strains, where the model in plane stress and small strains has
neither and no cause is named for them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from idic.diagnose.discretisation.combinations import combinations, probabilities
from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.diagnose.residual.score import null_model
from idic.model import MotionError

MIN_NEGLECTED_STD = 0.5  # of a parameter by what is neglected: more is said and counted


@dataclass(frozen=True)
class Neglected:
    """What the neglected effects do to the parameters; all parameters in internal units.

    probability : of each effect, by the recording; full : by how much free parameters would move with all of an
    effect, where it matters to them; change, change_std : of each free parameter, mean and standard deviation over all
    combinations of effects
    """

    probability: Mapping[str, float]
    full: Mapping[str, Mapping[str, float]]
    change: Mapping[str, float]
    change_std: Mapping[str, float]


def neglected(residual: ResidualEvidence, errors: Mapping[str, MotionError]) -> Neglected | None:
    """What bricks of the thickness and finite strains would change in the parameters of a model that neglects them;
    None where they would move no parameter by half a standard deviation.

    residual, errors : of the model, and what it neglects (`neglected_errors`)
    """
    if not errors:
        return None
    null = null_model(residual.evidence, residual.null)
    noise = np.sqrt(np.maximum(np.diagonal(null.covariance), 1e-300))
    tried = combinations(residual, null, errors)
    weights, moves = probabilities(tried), np.array([combination.moves for combination in tried])
    mean = weights @ moves
    std = np.sqrt(weights @ (moves - mean) ** 2)
    if float((np.hypot(mean, std) / noise).max(initial=0.0)) < MIN_NEGLECTED_STD:
        return None
    probability = {effect: float(sum(weight for weight, combination in zip(weights, tried, strict=True)
                                     if effect in combination.effects)) for effect in errors}
    full = {}
    for (effect,), moves_by in ((combination.effects, combination.moves) for combination in tried
                                if len(combination.effects) == 1):
        matters = np.abs(moves_by) / noise * probability[effect]**0.5 >= MIN_NEGLECTED_STD
        if matters.any():
            full[effect] = {name: float(move)
                            for name, move, is_large in zip(null.names, moves_by, matters, strict=True) if is_large}
    return Neglected(probability, full, dict(zip(null.names, mean.tolist(), strict=True)),
                     dict(zip(null.names, std.tolist(), strict=True)))
