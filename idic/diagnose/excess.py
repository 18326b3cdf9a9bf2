"""Is there anything that noise does not explain? Three tests, and a margin below which nothing is called a mismatch.

omnibus    every pixel's white residual against the variance that noise leaves there: sees everything, weakly
whiteness  a mismatch of motion is smooth: m = r (d . grad f) resembles itself some pixels and some frames further on,
           noise does not; r (f - mean) and r itself tell of lighting instead; runs of one sign in the channels
directed   the drop of chi-square under free motion, by far the strongest

With 10^8 pixels everything is significant through interpolation alone, so that every figure comes with its size as a
motion in pixels, and `MARGIN_PX` is what a recording must exceed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from idic.diagnose.evidence import Evidence

MARGIN_PX = 0.005  # rms: twice what interpolation and discretisation left in a sound rendered recording
LAGS_PX = (6, 10, 14, 20)  # beyond the reach of interpolation and low-pass
LAGS_FRAMES = (1, 2, 3, 5)
FRAMES = 24  # at most, spread over the recording


@dataclass(frozen=True)
class Test:
    """One test of excess. p_value : of noise alone; effect_px : size as a motion, nan where it is none; words : in a
    sentence."""

    name: str
    p_value: float
    effect_px: float
    words: str


def beyond(gain, rank, margin):
    """Probability of this drop of chi-square from noise and a motion of chi-square `margin` (Patnaik 1949)."""
    gain, rank, margin = np.asarray(gain, float), np.asarray(rank, float), np.asarray(margin, float)
    spread = (rank + 2.0 * margin) / (rank + margin)
    return stats.chi2.sf(gain / spread, (rank + margin) / spread)


def margin_chi2(evidence: Evidence, margin_px: float = MARGIN_PX) -> np.ndarray:
    """Chi-square per frame of a motion of this rms, weighed by how well pixels see it  # (T,)"""
    return margin_px**2 * power(evidence)


def power(evidence: Evidence) -> np.ndarray:
    """Chi-square of a motion of one px (rms) in each frame: sum |grad f|^2 / 2 sigma^2  # (T,)

    From nodal sums of one component at a time, of which shape functions add up to one.
    """
    component = evidence.seen % evidence.n_components
    found = []
    for part in evidence.parts:
        totals = [float((part.A @ (component == k).astype(float))[component == k].sum()) for k in (0, 1)]
        found.append(0.5 * sum(totals))
    return np.array(found)
