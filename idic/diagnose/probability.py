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
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from idic.diagnose.residual.channel_left import ChannelLeft
from idic.diagnose.residual.excess_left import MIN_EXCESS_Z, ExcessLeft
from idic.diagnose.selection.rival import Round, winners
from idic.diagnose.selection.verdict import Verdict

STRENGTHS_Z = (3.0, 8.0, 30.0)  # standard deviations of the weakest selected cause (root of `Rival.evidence`)
P_OF_STRENGTH = (0.7, 0.8, 0.98)
P_WITH_LEFTOVER = 10.0 / 14.0  # a part that noise does not leave: the world is not quite the library's
P_UNEXPLAINED = 0.25  # of a name where the verdict says that the library does not explain the residual
P_NONE = 0.95
P_NONE_BESIDE_A_SCORE = 0.3  # a score is significant, which the refit does not confirm or the practical margin covers


def probability(verdict: Verdict, rounds: Sequence[Round], remainder: ExcessLeft,
                channels: Sequence[ChannelLeft]) -> float | None:
    """Of the selected set, or of the absence of a visible effect (`none`); None where the test says nothing.

    remainder, channels : what the last model leaves on the whole recording
    """
    if verdict.word == "blind":
        return None
    if verdict.word == "none":
        has_score = any(ranked.standing in ("significant", "small") for ranked in rounds[0].screening.ranked)
        return P_NONE_BESIDE_A_SCORE if has_score else P_NONE
    if verdict.word == "outside_library":
        return P_UNEXPLAINED if verdict.selected else None
    weakest = min(winner.evidence for winner in winners(rounds))
    strength = float(np.interp(np.sqrt(max(weakest, 0.0)), STRENGTHS_Z, P_OF_STRENGTH))
    leaves = remainder.after.excess_z > MIN_EXCESS_Z or any(channel.is_significant for channel in channels)
    return min(strength, P_WITH_LEFTOVER) if leaves else strength
