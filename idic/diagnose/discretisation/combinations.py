"""Which of the effects that a model neglects, and that are computed without an unknown, the body has.

The parameters can take up nearly all of such an effect; the recording then has no residual to test. So every
combination of them is compared with the recording, by the chi-square that remains after the parameters have followed:

    rise = s^T s - 2 s^T r,  s: the sum of the effects, r: the residual, both beside the parameters
    probability ~ prior exp(-rise / 2)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations as choices

import numpy as np

from idic.diagnose.discretisation.weight import error_column
from idic.diagnose.residual.evidence import joined
from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.diagnose.residual.score import NullModel, score
from idic.model import MotionError

BRICKS, FINITE_STRAINS = "bricks", "finite strains"
# without a recording: a grip may let the thickness go; every body has finite strains, and the law at them is open
PRIOR = {BRICKS: 0.5, FINITE_STRAINS: 0.9}


@dataclass(frozen=True, eq=False)
class Combination:
    """Effects that act together.

    effects : () for the model as it is; rise : of the chi-square of the recording above that of the model; moves :
    of the identified parameters, (n,) internal units; square : s^T s of the sum of the effects
    """

    effects: tuple[str, ...]
    rise: float
    moves: np.ndarray
    square: float = 0.0

    @property
    def amplitude(self) -> float:
        """The factor of the summed effects that fits the recording best: 1 in a body that has them and nothing else."""
        return 0.5 * (1.0 - self.rise / self.square) if self.square > 0.0 else 0.0


def combinations(residual: ResidualEvidence, null: NullModel,
                 errors: Mapping[str, MotionError]) -> tuple[Combination, ...]:
    """Every combination of effects, that of none first.

    residual, null : of the model without them; errors : by effect
    """
    names = tuple(errors)
    scores = score(residual.evidence, null, joined(*(error_column(residual, error) for error in errors.values())))
    entries = []
    for number in range(len(names) + 1):
        for chosen in choices(range(len(names)), number):
            indices = list(chosen)
            information = float(scores.information[np.ix_(indices, indices)].sum())
            entries.append(Combination(tuple(names[k] for k in indices),
                                       information - 2.0 * float(scores.U[indices].sum()),
                                       scores.moves[:, indices].sum(axis=1), information))
    return tuple(entries)


def probabilities(entries: tuple[Combination, ...]) -> np.ndarray:
    """Of the combinations, by the recording  # (n,)"""
    names = {effect for entry in entries for effect in entry.effects}
    prior = np.array([np.prod([PRIOR[name] if name in entry.effects else 1.0 - PRIOR[name] for name in names])
                      for entry in entries])
    rises = np.array([entry.rise for entry in entries])
    weights = prior * np.exp(-0.5 * (rises - rises.min()))
    return weights / weights.sum()


def best_with(entries: tuple[Combination, ...], effect: str) -> Combination:
    """The combination with an effect that leaves the lowest chi-square."""
    return min((entry for entry in entries if effect in entry.effects), key=lambda entry: entry.rise)


def drop_by(entries: tuple[Combination, ...], effect: str) -> float:
    """Of chi-square by one effect: the best combination with it against the best one without it."""
    return min(entry.rise for entry in entries if effect not in entry.effects) - best_with(entries, effect).rise
