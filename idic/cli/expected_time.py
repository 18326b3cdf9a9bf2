"""Expected time left: of a fan-out by its pace, of an identification by how fast its objective settles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import ceil, log

SETTLED_GAIN = 1e-3  # of the objective in units of chi^2: a step of 3 % of a standard deviation gains that
SLOWEST_RATIO, FASTEST_RATIO = 0.7, 0.01  # of the gains of two steps in a row; outside, two steps say little
MIN_DONE_SHARE = 0.02  # of a fan-out before its pace means something


class Pace:
    """How fast the tasks of a fan-out come back; began : `time.monotonic` when `done` of them were there."""

    def __init__(self, began: float, done: int):
        self._began, self._done, self._told = began, done, began

    def left(self, now: float, done: int, total: int) -> float | None:
        """Seconds for the rest; None before enough is done, and at the end."""
        new = done - self._done
        if new < max(1, MIN_DONE_SHARE * total) or done >= total or now <= self._began:
            return None
        return (now - self._began) / new * (total - done)

    def due(self, now: float, every_s: float) -> bool:
        """Whether a line is due; asks begin a new interval."""
        if now - self._told < every_s:
            return False
        self._told = now
        return True


def evaluations_left(history: Sequence[Mapping]) -> int | None:
    """Expected number of further evaluations, from the gains of the last two accepted steps; None where they tell nothing.

    The gains of Gauss-Newton steps fall by a constant ratio at least. A last evaluation confirms the end.

    Parameters
    ----------
    history : entries of `idic.identify.step.state.LoopState`
    """
    values = [entry["phi"] for entry in history if entry["accepted"] and entry["phi"] is not None]
    gains = [before - after for before, after in pairwise(values)]
    if len(gains) < 2 or gains[-2] <= 0.0:
        return None
    if gains[-1] <= SETTLED_GAIN:
        return 1
    ratio = min(max(gains[-1] / gains[-2], FASTEST_RATIO), SLOWEST_RATIO)
    return 1 + ceil(log(SETTLED_GAIN / gains[-1]) / log(ratio))


def duration(seconds: float) -> str:
    """A rounded time: ``8 s``, ``3 min``, ``2.5 h``."""
    if seconds < 90.0:
        return f"{max(1, round(seconds))} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
