"""The practical margin of candidates: below it none is named, whichever test shows it.

A score over a million pixels resolves the error of every model. So an effect counts by its size, not by its
significance: the motion that it makes where and when it acts, and its part of the readings. Both are what the
identified parameters cannot imitate. The screening asks this of every score, and the selection of every refit; there is
no other way to a name (`PracticalSize.is_reached`). Grey values count as the motion that would change as much.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from idic.diagnose.residual.heldout import Misfit
from idic.diagnose.residual.margin import PRACTICAL_MARGIN_PX

MIN_CHANNEL_EFFECT_STD = 0.3  # rms in standard deviations of one reading
# standard deviations of an identified parameter: a cause that moves it further needs more than its own pattern
MAX_UNSEEN_SHIFT_STD = 5.0


@dataclass(frozen=True)
class EffectSize:
    """An effect beside the identified parameters.

    px : rms over pixels and frames; local_px : weighed by the effect itself, where and when it acts; channel_std : rms
    in standard deviations of one reading
    """

    px: float
    local_px: float
    channel_std: float

    def or_larger(self, size: EffectSize) -> EffectSize:
        """The larger of each."""
        return EffectSize(max(self.px, size.px), max(self.local_px, size.local_px),
                          max(self.channel_std, size.channel_std))


@dataclass(frozen=True)
class PracticalSize:
    """The size below which no candidate is named.

    px : motion where and when it acts; channel_std : of the readings, rms in standard deviations; power : chi-square of
    a motion of one px in all frames of a copy; is_located : whether anything but the pattern of a candidate shows a
    mismatch
    """

    px: float
    channel_std: float
    power: float = np.inf
    is_located: bool = True

    def is_reached(self, size: EffectSize) -> bool:
        """Whether an effect of this size may be named."""
        return size.local_px > self.px or size.channel_std > self.channel_std

    def is_shown(self, shifts_std: Mapping[str, float]) -> bool:
        """Whether a cause that moves the identified parameters by so many standard deviations may be named.

        Its pattern, once chosen among many, is one number; the parameters rest on all frames and pixels. Where nothing
        else shows a mismatch, neither free motions nor channels, the pattern alone does not move them.
        """
        return self.is_located or max(map(abs, shifts_std.values()), default=0.0) <= MAX_UNSEEN_SHIFT_STD

    def of_refit(self, null: Misfit, fit: Misfit, n_unknowns: int, locality: float) -> EffectSize:
        """The effect of a refit by what it explains where it was fitted, less what its unknowns explain of noise.

        locality : local_px over px of its pattern
        """
        motion = float(null.gain.sum() - fit.gain.sum()) - n_unknowns
        channels = float((null.channels**2).sum() - (fit.channels**2).sum()) / max(null.channels.size, 1)
        px = float(np.sqrt(max(motion, 0.0) / self.power))
        return EffectSize(px, locality * px, float(np.sqrt(max(channels, 0.0))))


ASSUMED_SIZE = PracticalSize(PRACTICAL_MARGIN_PX, MIN_CHANNEL_EFFECT_STD)
