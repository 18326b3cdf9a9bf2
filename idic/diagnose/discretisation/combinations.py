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
    of the identified parameters, (n,) internal units; own : s^T s of the sum of the effects
    """

    effects: tuple[str, ...]
    rise: float
    moves: np.ndarray
    own: float = 0.0

    @property
    def amplitude(self) -> float:
        """The factor of the summed effects that fits the recording best: 1 in a body that has them and nothing else."""
        return 0.5 * (1.0 - self.rise / self.own) if self.own > 0.0 else 0.0


def combinations(residual: ResidualEvidence, null: NullModel,
                 errors: Mapping[str, MotionError]) -> tuple[Combination, ...]:
    """Every combination of effects, that of none first.

    residual, null : of the model without them; errors : by effect
    """
    names = tuple(errors)
    seen = score(residual.evidence, null, joined(*(error_column(residual, error) for error in errors.values())))
    found = []
    for number in range(len(names) + 1):
        for chosen in choices(range(len(names)), number):
            some = list(chosen)
            information = float(seen.information[np.ix_(some, some)].sum())
            found.append(Combination(tuple(names[k] for k in some), information - 2.0 * float(seen.U[some].sum()),
                                     seen.moves[:, some].sum(axis=1), information))
    return tuple(found)


def probabilities(found: tuple[Combination, ...]) -> np.ndarray:
    """Of the combinations, by the recording  # (n,)"""
    names = {effect for one in found for effect in one.effects}
    prior = np.array([np.prod([PRIOR[name] if name in one.effects else 1.0 - PRIOR[name] for name in names])
                      for one in found])
    rises = np.array([one.rise for one in found])
    weights = prior * np.exp(-0.5 * (rises - rises.min()))
    return weights / weights.sum()


def best_with(found: tuple[Combination, ...], effect: str) -> Combination:
    """The combination with an effect that leaves the lowest chi-square."""
    return min((one for one in found if effect in one.effects), key=lambda one: one.rise)


def drop_by(found: tuple[Combination, ...], effect: str) -> float:
    """Of chi-square by one effect: the best combination with it against the best one without it."""
    return min(one.rise for one in found if effect not in one.effects) - best_with(found, effect).rise
