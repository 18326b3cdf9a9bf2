"""The increments of time of a comparison of two simulations: those of the model, or a few.

A law with a memory may have asked the search for 64 increments in a frame. The error of the time integration that is
left of a few, extrapolated (`idic.fe.extrapolation`), is nearly the same in two bodies that move nearly alike, and
their difference needs no more: bricks in thousands of increments would take half an hour.
"""

from __future__ import annotations

from idic.identify.in_memory import Identification

FEW_INCREMENTS = 4  # per frame, beside half as many


def increments_in_few(found: Identification) -> int | None:
    """Increments per frame of a comparison in few; None where the model took no more, and is compared in its own."""
    if found.steps is None:
        return None
    intervals = found.experiment.n_frames - 1 - found.experiment.reference
    return FEW_INCREMENTS if len(found.steps) > (FEW_INCREMENTS + FEW_INCREMENTS // 2) * intervals else None
