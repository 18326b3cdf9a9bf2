"""The table of causes: what may stand between a recording and its model, in the order in which it is looked for.

A row is a function of the evidence that gives a cause or None. Rows without an unknown come first: what they explain,
a row with more unknowns would explain as well.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from idic.report.evidence.causes.axes import exchanged_ends, other_axes_of, other_scale, other_sign
from idic.report.evidence.causes.course import delay, increments, other_order
from idic.report.evidence.causes.evidence import Cause, Evidence
from idic.report.evidence.causes.rigid import rigid_motion

Row = Callable[[Evidence], Cause | None]

ROWS: tuple[Row, ...] = (increments, other_sign, exchanged_ends, other_axes_of, other_scale, other_order, delay,
                         rigid_motion)
ROWS_OF_ENDS: tuple[Row, ...] = (other_sign, exchanged_ends, other_axes_of, other_order, rigid_motion, other_scale)
MIN_NOISES = 3.0  # misfit (rms) over the noise of the measured motion, before a cause is looked for
MIN_MISFIT_PX = 0.5  # largest misfit of an end in images that is told before a simulation: less is slip, drift
MIN_MISFIT_SHARE = 0.35  # of the largest expected motion, the same


def first_cause(evidence: Evidence) -> Cause | None:
    """The first cause of the table that explains the difference between measured and simulated motion."""
    if not _rms(evidence.misfit) > MIN_NOISES * evidence.noise_px:
        return None
    return _first(ROWS, evidence)


def cause_at_ends(evidence: Evidence) -> Cause | None:
    """The first cause that explains a clear difference between the ends in the images and in the log."""
    largest = float(np.abs(evidence.misfit).max(initial=0.0))
    least_px = MIN_MISFIT_PX if evidence.experiment.recording.points is None else 0.0
    least = max(least_px, MIN_MISFIT_SHARE * float(np.abs(evidence.expected).max(initial=0.0)),
                MIN_NOISES * evidence.noise_px)
    return _first(ROWS_OF_ENDS, evidence) if largest > least else None


def _first(rows: tuple[Row, ...], evidence: Evidence) -> Cause | None:
    return next((cause for row in rows if (cause := row(evidence)) is not None), None)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0
