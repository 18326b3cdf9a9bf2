"""Noise of a logged channel where the experimenter gives none: from its third differences over the frames."""

from __future__ import annotations

import numpy as np

_MAD = 1.4826  # median absolute deviation -> standard deviation of a normal distribution


def channel_noise(values: np.ndarray) -> float:
    """Standard deviation of the noise of a series (n,), in its unit.

    Third differences remove a smooth course and amplify white noise by sqrt(20); the median ignores the few frames
    at a knee. Never below a thousandth of the series' range divided by ten, so that a noise-free record keeps a
    finite weight.
    """
    values = np.asarray(values, float)
    floor = 1e-4 * max(float(np.ptp(values)), 1e-12)
    if len(values) < 6:
        return max(floor, 2e-3 * float(np.abs(values).max(initial=0.0)))
    third = np.diff(values, 3)
    return max(floor, _MAD * float(np.median(np.abs(third))) / np.sqrt(20.0))
