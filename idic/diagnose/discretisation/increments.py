"""The increments of time of a comparison of two simulations: those of the model, or a few where it took many.

A law with a memory may have asked the search for 64 increments in a frame. The error of the time integration by few is
nearly the same in two bodies that move nearly alike, and their difference needs no more: bricks in hundreds of
increments take half an hour. In a bent beam that yields, loaded and unloaded in three frames, one per frame changes the
difference of bricks by 2 % and that of a finer mesh by 4 %; 1 and 2, extrapolated, by 1 and 2 %.
Their work is three times that of one.
"""

from __future__ import annotations

import numpy as np

from idic.identification import Identification, rate_dependent_laws

MAX_INCREMENTS = 3  # per frame, both of an extrapolation counted, of a law with time
MAX_INCREMENTS_WITHOUT_TIME = 1


def compared_increments(found: Identification) -> np.ndarray | None:
    """Ends of the increments of a comparison at an identification, s: its own, or a few where it took many.

    A few are one per frame, of a law without time; 2 and 1, extrapolated (`idic.fe.extrapolation`), of another one.
    """
    ends = found.experiment.times[found.experiment.reference:]
    in_time = bool(rate_dependent_laws(found.experiment))
    few = MAX_INCREMENTS if in_time else MAX_INCREMENTS_WITHOUT_TIME
    if found.steps is None or len(found.steps) < (few + 1) * (len(ends) - 1):  # one per frame, some of them cut
        return found.steps
    if not in_time:
        return ends[1:]
    halves = np.column_stack([0.5 * (ends[:-1] + ends[1:]), ends[1:]]).ravel()
    return np.concatenate([halves, ends[1:]])
