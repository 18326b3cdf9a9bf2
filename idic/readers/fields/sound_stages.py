"""Whether all stages are those of one test: none of another specimen with the same numbers, none that was cut off.

Systems number the points of every project from 1 on, so that another specimen has the same ids. Its points lie
elsewhere:
neighbours of the reference stage are no neighbours there. A file that ends too early at the end of a row looks like a
stage that has lost points; the next stage has them again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from idic.errors import InputError
from idic.readers.fields.series import FieldStack
from idic.readers.fields.stage import KEY

MAX_TORN_PART = 0.05  # of the points that were between their neighbours; a crack through the specimen tears 2 % or so
MIN_TORN_PITCH = 0.5  # distance from the middle of the four neighbours, in distances of neighbours
# of a distance of neighbours, in the reference stage: the point is in the middle of its four nearest
MAX_OFF_MIDDLE = 0.1
MIN_CUT_PART = 0.05  # of the points, at the end of a file


def check_stages(stack: FieldStack, frames: Sequence[int]) -> None:
    """Read every stage.

    frames : stages that are compared, in order

    Raises
    ------
    InputError
        A stage cannot be read, is one of another specimen, or ends before its last points.
    """
    middles = _Middles.of(stack.points.positions, stack.points.pitch)
    missing_before = 0
    for number, k in enumerate(frames):
        torn = middles.torn_part(stack.frame(k)[:, :2])
        if torn > MAX_TORN_PART:
            raise InputError("a stage of another specimen, or of a broken one", file=stack.entries[k].path, key=KEY,
                             expected="points between their neighbours of the reference stage",
                             found=f"{100 * torn:.0f} % of them elsewhere",
                             remedy="remove stages of other specimens, and those after the break, from the pattern")
        missing = _missing_at_end(stack, k)
        if number and missing_before - missing > MIN_CUT_PART * len(stack.points):
            raise InputError("a stage ends before its last points", file=stack.entries[frames[number - 1]].path,
                             key=KEY,
                             expected="the points of the reference stage, as in the next stage",
                             found=f"the last {missing_before} of {len(stack.points)} are not there",
                             remedy="the file may be half written: export the stage again, or remove it from the "
                                    "pattern")
        missing_before = missing


def _missing_at_end(stack: FieldStack, k: int) -> int:
    """How many points, from the last one of the reference stage backwards, have no row in a stage."""
    there = np.flatnonzero(stack.points.found_in(stack.series.stage(k)) >= 0)
    return len(stack.points) - 1 - int(there[-1]) if len(there) else len(stack.points)


@dataclass(frozen=True, eq=False)
class _Middles:
    """Points in the middle of four others.

    positions : (n, 2) columns and rows, in distances of neighbours; point : (m,), around : (m, 4) numbers of points
    """

    positions: np.ndarray
    point: np.ndarray
    around: np.ndarray
    pitch_um: float

    @classmethod
    def of(cls, positions: np.ndarray, pitch: float) -> _Middles:
        """positions : (n, 2) mm; pitch : mm"""
        at = positions / pitch * [1.0, -1.0]
        around = cKDTree(at).query(at, k=5)[1][:, 1:]
        inside = np.linalg.norm(at - at[around].mean(axis=1), axis=1) < MAX_OFF_MIDDLE
        return cls(at, np.flatnonzero(inside), around[inside], 1e3 * pitch)

    def torn_part(self, moved_um: np.ndarray) -> float:
        """Part of these points that are not between the others any more  # moved_um (n, 2)"""
        now = self.positions + moved_um / self.pitch_um
        away = np.linalg.norm(now[self.point] - now[self.around].mean(axis=1), axis=1)
        away = away[np.isfinite(away)]
        return float((away > MIN_TORN_PITCH).mean()) if len(away) else 0.0
