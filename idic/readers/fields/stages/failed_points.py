"""Which points of a stage were measured: one table of the flags of all exports, one rule.

A point failed where a flag says so, where a coordinate of its displacement is missing, or where it is exactly zero
beside points that move: arrays start as zeros, and stay so outside the region of interest. A number beyond all
displacements that stands in every coordinate, as -999, is a mark as well. Failed points are gaps. Some systems write
them all at one place, which is none: these rows are left out, and counted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

NO_DISPLACEMENT, NO_PLACE, OUTSIDE = "no displacement", "no position", "exactly zero, outside the region"
MIN_CORRELATION = 0.9  # ZNCC; the threshold of pyvale, which writes points below it only on demand
MAX_LENGTH = 1e9  # in any unit; a larger coordinate or displacement is none
MIN_JUMP = 5.0  # from the mark of failed points to the next moving point, in steps of neighbours and in last digits
_MAX_BORDER = 1.5  # distances of neighbours
_MAX_DECIMALS = 9
_MIN_MOVING = 4
_MAX_NAME = 2.0**53  # beyond, two names are one number


@dataclass(frozen=True)
class Flag:
    """A column that says whether a point was measured.

    column : without unit, in lower case; least, most : its values where a point was measured; formats : that write it,
    empty: any
    """

    column: str
    least: float
    formats: tuple[str, ...] = ()
    most: float = np.inf

    @property
    def words(self) -> str:
        bounds = [f"below {self.least:g}"] if self.least > -np.inf else []
        return f"{self.column} {' or '.join([*bounds, *([f'above {self.most:g}'] if self.most < np.inf else [])])}"

    def fails(self, values: np.ndarray) -> np.ndarray:
        """Where a point was not measured, an empty cell among these  # (n,) bool"""
        return ~((values >= self.least) & (values <= self.most))


FLAGS = (
    Flag("sigma", 0.0, ("vic", "dice")),
    Flag("match", 0.0),
    Flag("gamma", 0.0, ("dice",)),
    Flag("beta", 0.0, ("dice",)),
    Flag("converged", 0.5),
    Flag("stereo_converged", 0.5),
    Flag("cost", MIN_CORRELATION, ("pyvale",)),
    Flag("cost_zncc", MIN_CORRELATION),
    Flag("stereo_cost_zncc", MIN_CORRELATION),
    Flag("valid", 0.5),
)


@dataclass(frozen=True, eq=False)
class SoundPoints:
    """The points of a stage after the rule.

    points : (n, d); displacement : (n, d), NaN where a point failed, or None where positions are those of now;
    ids : (n,) or None; failed : reason -> number of points; placeless : rows without a place, which are left out
    """

    points: np.ndarray
    displacement: np.ndarray | None
    ids: np.ndarray | None
    failed: Mapping[str, int]
    placeless: int

    @property
    def n_repeated(self) -> int:
        """How many rows name a point, or a place, that another one names."""
        names = self.ids if self.ids is not None else np.round(self.points, 9)
        return len(self.points) - len(np.unique(names, axis=0))


def sound_points(points: np.ndarray, displacement: np.ndarray | None, ids: np.ndarray | None, format: str,
                 columns: Mapping[str, np.ndarray], flags: Sequence[Flag] = FLAGS) -> SoundPoints:
    """Apply the rule to one stage.

    points, displacement : (n, d); ids : (n,); columns : by `Flag.column`, (n,) each; those that are no flags do not
    count
    """
    has_place = (np.abs(points) < MAX_LENGTH).all(axis=1)  # False for NaN
    is_failed = ~has_place
    failed = {NO_PLACE: int(is_failed.sum())}
    for flag in flags:
        if flag.column in columns and (not flag.formats or format in flag.formats):
            is_failed = _counted(failed, flag.words, flag.fails(columns[flag.column]), is_failed)
    if displacement is not None:
        is_failed = _counted(failed, NO_DISPLACEMENT, ~(np.abs(displacement) < MAX_LENGTH).all(axis=1), is_failed)
        is_failed = _counted(failed, OUTSIDE, _outside(points, displacement, ~is_failed), is_failed)
        mark = _mark_of_failure(displacement[~is_failed])
        if mark is not None:
            is_marked = _stands_alone(points, displacement, ~is_failed, mark)
            is_failed = _counted(failed, f"displacement {mark:g}", is_marked, is_failed)
        displacement = np.where(is_failed[:, None], np.nan, displacement)
    else:
        has_place = ~is_failed  # a position is all that there is
    if is_failed.any():
        has_place = has_place & ~(is_failed & _shared_place(points))
    return SoundPoints(points[has_place], None if displacement is None else displacement[has_place],
                       None if ids is None else ids[has_place],
                       {reason: n for reason, n in failed.items() if n}, int((~has_place).sum()))


def names_of(values: np.ndarray) -> np.ndarray:
    """Names of points from a column of numbers; -1 where it holds none  # (n,) -> (n,) int64"""
    is_name = np.abs(values) < _MAX_NAME  # False for NaN
    return np.where(is_name, values, -1.0).astype(np.int64)


def in_words(failed: Mapping[str, int]) -> str:
    """"12 sigma below 0, 3 no displacement"."""
    return ", ".join(f"{n} {reason}" for reason, n in failed.items())


def _counted(failed: dict[str, int], reason: str, is_flagged: np.ndarray, is_failed: np.ndarray) -> np.ndarray:
    """Those that failed so far with those of this reason; a point counts once, with the first  # (n,) bool"""
    failed[reason] = failed.get(reason, 0) + int((is_flagged & ~is_failed).sum())
    return is_failed | is_flagged


def _shared_place(points: np.ndarray) -> np.ndarray:
    """Whether another row has the same place  # (n,) bool"""
    _, place, count = np.unique(np.round(points, 9), axis=0, return_inverse=True, return_counts=True)
    return count[place.ravel()] > 1


def _outside(points: np.ndarray, displacement: np.ndarray, is_measured: np.ndarray) -> np.ndarray:
    """Points that are exactly zero where the next ones move by far  # (n,) bool

    A clamped point is exactly zero, too, in a field of finite elements: its neighbours move by no more than elsewhere.
    """
    return _stands_alone(points, displacement, is_measured, 0.0)


def _mark_of_failure(displacement: np.ndarray) -> float | None:
    """The number that stands in every coordinate of some points and is beyond all others; None without"""
    is_one_number = (displacement == displacement[:, :1]).all(axis=1) & (displacement[:, 0] != 0.0)
    if not is_one_number.any():
        return None
    mark = float(displacement[is_one_number, 0][np.argmax(np.abs(displacement[is_one_number, 0]))])
    other_values = displacement[~(displacement == mark).all(axis=1)]
    return mark if np.abs(other_values).max(initial=0.0) < abs(mark) else None


def _stands_alone(points: np.ndarray, displacement: np.ndarray, is_measured: np.ndarray, mark: float) -> np.ndarray:
    """Points whose coordinates are all this number, where that is far from the next points  # (n,) bool"""
    is_mark = is_measured & (displacement == mark).all(axis=1)
    is_moving = is_measured & ~is_mark
    if not is_mark.any() or is_moving.sum() < _MIN_MOVING:
        return np.zeros(len(points), bool)
    moved = displacement[is_moving]
    tree = scipy.spatial.cKDTree(points[is_moving])
    distance, neighbour = tree.query(points[is_moving], k=2)
    pitch = np.median(distance[:, 1])
    step = np.median(np.linalg.norm(moved - moved[neighbour[:, 1]], axis=1))
    border, border_point = tree.query(points[is_mark])
    at_border = border < _MAX_BORDER * pitch
    jump = np.median(np.linalg.norm(moved[border_point[at_border]] - mark, axis=1)) if at_border.any() else 0.0
    return is_mark & bool(jump > MIN_JUMP * max(step, last_digit(moved)))


def last_digit(values: np.ndarray) -> float:
    """Unit of the last decimal digit that these numbers use."""
    return next((10.0**-k for k in range(_MAX_DECIMALS) if np.allclose(values, np.round(values, k), rtol=0.0,
                                                                      atol=1e-6 * 10.0**-k)), 10.0**-_MAX_DECIMALS)
