"""Excess of the residual before and after an addition to the model: what only another cause leaves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.diagnose.residual.heldout import Misfit
from idic.diagnose.residual.margin import PRACTICAL_MARGIN_PX

MIN_EXCESS_Z = 5.0  # standard deviations of an excess that count as something
MAX_EXCESS_LEFT = 0.1  # of the motions' excess left, above the practical margin: a formal fit, not the cause
MAX_LOCAL_EXCESS_LEFT = 0.01  # the same at the place of a fitted inclusion: a tenth of the motion's amplitude
# the same with an inclusion in the model, of motions with its time course: right ones left 0.006 at most
MAX_INCLUSION_EXCESS_LEFT = 0.02


@dataclass(frozen=True, eq=False)
class ExcessLeft:
    """Excess of the residual before and after an addition to the model.

    power : chi-square of a motion of one px (rms) in all its frames; max_share, margin_px : share of the excess before,
    and motion, that only another cause leaves; camera_px : motion that the camera shows at rest, 0 where it is unknown
    """

    before: Misfit
    after: Misfit
    power: float
    max_share: float = MAX_EXCESS_LEFT
    margin_px: float = PRACTICAL_MARGIN_PX
    camera_px: float = 0.0

    @property
    def matters(self) -> bool:
        """Whether a part is left that is significant, large enough, and a good share of the excess before."""
        return (self.after.excess_z > MIN_EXCESS_Z and self.after.excess > self.max_share * self.before.excess
                and self.motion_px > self.margin_px)

    @property
    def share(self) -> float | None:
        """Of the excess before; None where that is noise: the share of next to nothing says nothing."""
        return self.after.excess / self.before.excess if self.before.excess_z > MIN_EXCESS_Z else None

    @property
    def motion_px(self) -> float:
        """Motion (px rms) that free motions still ask for beyond noise."""
        return effect(self.after, self.power)

    @property
    def before_px(self) -> float:
        """Motion (px rms) that free motions asked for before."""
        return effect(self.before, self.power)


def effect(misfit: Misfit, unit_motion_chi2: float) -> float:
    """Motion (px rms) that free motions ask for beyond noise; unit_motion_chi2 : chi-square of one px, all frames."""
    return float(np.sqrt(max(misfit.gain.sum() - misfit.rank.sum(), 0.0) / max(unit_motion_chi2, 1e-300)))
