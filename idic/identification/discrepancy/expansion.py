"""One frame's system in more unknowns than it has columns: each new one is a combination of the old ones.

A field whose amplitude has a course over the frames is one unknown per function of that course, x(t) = sum_k tau_k(t)
a_k. Every sum of a frame is linear in its columns, so that the expansion is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import sparse

from idic.correlation import ColumnSum, CorrelationSystem, OpenSums


def expanded(system: CorrelationSystem, names: Sequence[str], into: sparse.csc_array) -> CorrelationSystem:
    """The system of a frame in other unknowns.

    names : of the new unknowns; into : (n_old, n_new), the amplitudes of the old ones of a unit of each new one. The
    records of frames lose the slopes of their local unknowns, a matrix per frame as wide as the unknowns are many.
    """
    sums = system.sums
    back = into.T.tocsr()

    def both(matrix: np.ndarray) -> np.ndarray:
        return (back @ (back @ matrix).T).T

    def columns(matrix: np.ndarray) -> np.ndarray:
        return (back @ matrix.T).T

    if isinstance(sums, OpenSums):
        sums = replace(
            sums, columns=columns(sums.columns), product=columns(sums.product), noisy=columns(sums.noisy),
            matrix=both(sums.matrix), rhs=back @ sums.rhs, noise=both(sums.noise),
            frames=tuple(replace(record, cross=columns(record.cross), noise_cross=columns(record.noise_cross),
                                 shared_readings=columns(record.shared_readings)) for record in sums.frames))
    else:
        sums = None  # only the prediction of generalised least squares needs them
    frames = tuple(replace(record, channel_columns=columns(record.channel_columns),
                           local_slope=record.local_slope[:, :0].copy())
                   for record in system.frames)
    shared = system.shared.mapped(columns) if isinstance(system.shared, ColumnSum) else columns(system.shared)
    return replace(system, names=tuple(names), M=both(system.M), b=back @ system.b, spread=both(system.spread),
                   shared=shared, frames=frames, sums=sums)
