"""The probability that the selected set holds the truth, calibrated on recordings with known truth.

    drawn worlds, known kinds, seeds 7 and 11 (docs/evidence/blind-trial.md)        said before    true
        `none`: nothing is missing                                                        0.99    20 of 22
        faint (up to 12 standard deviations), named alone or in a set                     0.94     5 of 7
        stronger                                                                          0.98    14 of 14
        named, and yet unexplained by the library                                         0.10     3 of 12
    drawn worlds, known kinds, all seeds up to 53367
        `none`, though the score of a candidate is significant                            0.91     1 of 4
    frozen samples of drawn worlds, known kinds, seeds 19705 to 41811
        `none`: nothing is missing                                                        0.91    57 of 59
    14 sealed recordings by others, solids of real thickness, courses of their own: the right name first in 10; every
    one of them left a small part of the residual, significantly

The frozen campaigns on one strip (clear or concealed 514 of 524, faint 46 of 49, `none` 499 of 504) are not counted:
their world is the library's own. How often `none` is right depends on how often a faint cause is there.

`none` says that nothing of a practical size is missing. Beside a score that is significant and small it is as probable
as that this effect, with its error, is below the practical size; beside one that its refit does not confirm, as that
noise alone makes such a score. The members of a set share the probability of the set (`idic.diagnose.odds`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from idic.diagnose.residual.channel_left import ChannelLeft
from idic.diagnose.residual.excess_left import MIN_EXCESS_Z, ExcessLeft
from idic.diagnose.screen.select import Ranked
from idic.diagnose.selection.rival import Rival, Round, winners
from idic.diagnose.selection.verdict import Verdict

STRENGTHS_Z = (3.0, 8.0, 30.0)  # standard deviations of the weakest selected cause (root of `Rival.evidence`)
P_OF_STRENGTH = (0.7, 0.8, 0.98)
P_WITH_LEFTOVER = 10.0 / 14.0  # a part that noise does not leave: the world is not quite the library's
P_UNEXPLAINED = 0.25  # of a name where the verdict says that the library does not explain the residual
P_NONE = 0.95
P_NONE_UNCONFIRMED = 0.3  # a score is significant, which the refit does not confirm


def probability(verdict: Verdict, rounds: Sequence[Round], remainder: ExcessLeft,
                channels: Sequence[ChannelLeft]) -> float | None:
    """Of the selected set, or of the absence of a visible effect (`none`); None where the test says nothing.

    remainder, channels : what the last model leaves on the whole recording
    """
    if verdict.word == "blind":
        return None
    if verdict.word == "none":
        return of_none(rounds[0])
    if verdict.word == "outside_library":
        return P_UNEXPLAINED if verdict.selected else None
    weakest = min(winner.evidence for winner in winners(rounds))
    strength = float(np.interp(np.sqrt(max(weakest, 0.0)), STRENGTHS_Z, P_OF_STRENGTH))
    leaves = remainder.after.excess_z > MIN_EXCESS_Z or any(channel.is_significant for channel in channels)
    return min(strength, P_WITH_LEFTOVER) if leaves else strength


def of_none(entry: Round) -> float:
    """That nothing of a practical size is missing, beside the candidate that speaks most against it."""
    rivals = {rival.ranked.key: rival for rival in entry.rivals}
    return min((_of_none_beside(ranked, rivals.get(ranked.key), entry) for ranked in entry.screening.ranked
                if ranked.standing in ("significant", "small")), default=P_NONE)


def _of_none_beside(ranked: Ranked, rival: Rival | None, entry: Round) -> float:
    if ranked.standing == "small" or (rival is not None and not rival.is_large):
        return P_NONE * _is_below_margin(ranked, rival, entry)
    return max(P_NONE_UNCONFIRMED, _of_noise(ranked.p_familywise))


def _is_below_margin(ranked: Ranked, rival: Rival | None, entry: Round) -> float:
    """The probability that an effect is below the practical size: its own size has the relative error of its
    amplitude. One that something else than its size covers, a finer mesh, counts as if it just reached the margin."""
    effect = None if rival is None else rival.effect
    motion, readings = ((ranked.local_px, ranked.effect_channel) if effect is None
                        else (effect.local_px, effect.channel_std))
    practical = entry.screening.practical
    part = max(motion / practical.px, readings / practical.channel_std)
    return 1.0 if part <= 0.0 else float(stats.norm.cdf(ranked.statistic * max(1.0 / part - 1.0, 0.0)))


def _of_noise(p: float) -> float:
    """The probability of noise alone beside a score of family-wise p: odds for noise are at least -e p ln p times those
    before (Sellke, Bayarri, Berger 2001, doi 10.1198/000313001300339950), and `P_NONE` without any score."""
    p = min(max(p, 1e-300), 1.0 / np.e)  # the bound holds below 1/e
    odds = P_NONE / (1.0 - P_NONE) * -np.e * p * np.log(p)
    return float(odds / (1.0 + odds))
