"""Checks that all stages belong to one test: none of another specimen with the same numbers, none that was cut off.

Systems number the points of every project from 1 on, so that another specimen has the same ids. Its points lie
elsewhere: neighbours of the reference stage are no neighbours there, one stage alone is stretched by far, or the file
states other places in the system's reference. A file that ends too early at the end of a row looks like a stage that
has lost points: the next stage has them again, or, of the last stage, they end within a line of the grid and the rows
above are as complete as before. Another specimen on the same grid: `idic.readers.fields.other_pattern`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from idic.errors import InputError
from idic.readers.fields.chosen_stages import mean_strain
from idic.readers.fields.other_pattern import PatternSteps
from idic.readers.fields.series import UM_PER_MM, FieldStack
from idic.readers.fields.stages.stage import KEY

MAX_TORN_PART = 0.05  # of the points that were between their neighbours; a crack through the specimen tears 2 % or so
MIN_TORN_PITCH = 0.5  # distance from the middle of the four neighbours, in distances of neighbours
# of a distance of neighbours, in the reference stage: the point is in the middle of its four nearest
MAX_OFF_MIDDLE = 0.1
MIN_CUT_PART = 0.05  # of the points, at the end of a file
MAX_NEIGHBOUR = 1.5  # distances of neighbours
MAX_LOST_PART = 0.01  # of the points, lost elsewhere in a file that was cut off
MAX_OTHER_PLACE = 0.01  # of a distance of neighbours: one test has the same reference coordinates, to rounding
MAX_OTHER_PART = 0.5  # of the points of a stage that are at other places of the system's reference
MIN_JUMP_STRAIN = 0.05  # of one stage against its neighbours
MAX_OTHER_STEP = 0.05  # any other step of the mean strain over the jump
MIN_OTHER_STEPS = 6  # fewer stages may be one cycle of a test


def check_stages(stack: FieldStack, frames: Sequence[int]) -> Mapping[str, int]:
    """Read every stage; why points failed, and how many in all stages (`idic.readers.fields.stages.failed_points`).

    frames : stages that are compared, in order

    Raises
    ------
    InputError
        A stage cannot be read, is one of another specimen, or ends before its last points.
    """
    middles = _Middles.of(stack.points.positions, stack.points.pitch)
    strains, ends, pattern = [], [], PatternSteps(middles.pitch_um)
    failed: Counter[str] = Counter()
    for k in frames:
        failed.update(stack.series.stage(k).failed)
        moved = stack.frame(k)[:, :2]
        pattern.add(middles.against_neighbours(moved))
        torn = middles.torn_part(moved)
        if torn > MAX_TORN_PART:
            raise _other_specimen(stack, k, "points between their neighbours of the reference stage",
                                  f"{100 * torn:.0f} % of them elsewhere")
        _check_places(stack, k)
        strains.append(mean_strain(stack.points.positions, moved / UM_PER_MM * [1.0, -1.0]))
        ends.append(_End.of(stack, k))
        if len(ends) > 1 and ends[-2].missing - ends[-1].missing > MIN_CUT_PART * len(stack.points):
            raise _cut_off(stack, frames[len(ends) - 2], ends[-2].missing, "as in the next stage")
    if len(ends) > 1 and ends[-1].is_cut_after(ends[-2]):
        raise _cut_off(stack, frames[-1], ends[-1].missing, "as in the stage before")
    _check_motion(stack, frames)
    jump = _jump(np.array(strains))
    if jump is not None:
        k, size = jump
        raise _other_specimen(stack, frames[k], "a mean strain near that of the stages before and after it",
                              f"one that is off by {size:.2g} in this stage alone")
    odd_stage = pattern.other_pattern(np.array(strains))
    if odd_stage is not None:
        k, size = odd_stage
        raise _other_specimen(stack, frames[k], "points that move relative to their neighbours by noise, as between "
                              "other stages", f"{size:.2g} times that, all over the field")
    return failed


def _check_motion(stack: FieldStack, frames: Sequence[int]) -> None:
    """Refuse positions that are the same in all stages, to the last digit: those of the reference."""
    last_stage = stack.series.stage(frames[-1])
    if last_stage.displacement is not None or len(frames) < 2:
        return
    if all(np.nanmax(np.abs(stack.points.moved(stack.series.stage(k))), initial=0.0) == 0.0
           for k in (frames[-1], frames[len(frames) // 2])):
        raise InputError("the points of the stages do not move", file=stack.entries[frames[-1]].path, key=KEY,
                         expected="positions of the points in every stage", found="the same positions in all stages, "
                         "to the last digit", remedy="export deformed positions, or displacements beside the positions")


def _other_specimen(stack: FieldStack, k: int, expected: str, finding: str) -> InputError:
    return InputError("a stage of another specimen, or of a broken one", file=stack.entries[k].path, key=KEY,
                      expected=expected, found=finding,
                      remedy="remove stages of other specimens, and those after the break, from the pattern")


def _cut_off(stack: FieldStack, k: int, missing: int, of: str) -> InputError:
    return InputError("a stage ends before its last points", file=stack.entries[k].path, key=KEY,
                      expected=f"the points of the reference stage, {of}",
                      found=f"the last {missing} of {len(stack.points)} are not there",
                      remedy="the file may be half written: export the stage again; or remove it from the pattern")


def _check_places(stack: FieldStack, k: int) -> None:
    """Refuse a stage whose points have other places in the system's own reference than those of the reference stage."""
    stage, points = stack.series.stage(k), stack.points
    if stage.displacement is None:
        return
    at, is_measured = points.found_in(stage), np.isfinite(stage.displacement).all(axis=1)
    if not is_measured.any():
        return
    shared = (at >= 0) & is_measured[at]  # a failed point has no place that counts
    is_displaced = np.linalg.norm(stage.points[at[shared]] - points.keys[shared],
                                  axis=1) > MAX_OTHER_PLACE * points.pitch
    other_part = float(is_displaced.mean()) if shared.any() else 1.0
    if points.ids is None:
        other_part = max(other_part, 1.0 - shared.sum() / max(is_measured.sum(), 1))
    if other_part > MAX_OTHER_PART:
        raise _other_specimen(stack, k, "points at the reference coordinates of the reference stage",
                              f"{100 * other_part:.0f} % of them at others")


def _jump(strains: np.ndarray) -> tuple[int, float] | None:
    """The stage with a far outlying mean strain, and its distance; None where there is none  # strains (n, 2, 2)

    The steps to it and away from it are far larger than all others of the test, and those are many.
    """
    steps = np.linalg.norm(np.diff(strains, axis=0), axis=(1, 2))
    if len(steps) < MIN_OTHER_STEPS + 1:
        return None
    sizes = np.append(np.minimum(steps[:-1], steps[1:]), steps[-1])  # of the stages after the first
    k = int(np.argmax(sizes)) + 1
    size, is_last = float(sizes[k - 1]), k == len(steps)
    other_steps = np.delete(steps, [k - 1] if is_last else [k - 1, k])
    if size < MIN_JUMP_STRAIN or len(other_steps) < MIN_OTHER_STEPS or other_steps.max() > MAX_OTHER_STEP * size:
        return None
    returns = is_last or np.linalg.norm(strains[k + 1] - strains[k - 1]) < MAX_OTHER_STEP * size
    return (k, size) if returns else None


@dataclass(frozen=True)
class _End:
    """The end of the rows of a stage.

    missing : points, from the last one of the reference stage backwards, without a row, be it one without a place;
    lost : how many of the others are not measured; n : all; in_line : the last one there and the next one are
    neighbours. Whole lines of a grid leave the view, a file is cut off anywhere.
    """

    missing: int
    lost: int
    n: int
    in_line: bool

    @classmethod
    def of(cls, stack: FieldStack, k: int) -> _End:
        stage = stack.series.stage(k)
        is_shown = stack.points.found_in(stage) >= 0
        shown_numbers = np.flatnonzero(is_shown)
        missing = len(is_shown) - 1 - int(shown_numbers[-1]) if len(shown_numbers) else len(is_shown)
        missing = max(missing - stage.placeless, 0)
        ends = stack.points.positions[[-1 - missing, -missing]] if 0 < missing < len(is_shown) else np.zeros((2, 0))
        in_line = bool(ends.size) and float(np.linalg.norm(ends[1] - ends[0])) < MAX_NEIGHBOUR * stack.points.pitch
        return cls(missing, int((~is_shown).sum()) - missing, len(is_shown), in_line)

    def is_cut_after(self, previous: _End) -> bool:
        """Whether the rows end within a line, where those above are as complete as in the stage before."""
        return (self.in_line and self.missing - previous.missing > MIN_CUT_PART * self.n
                and self.lost <= previous.lost + MAX_LOST_PART * self.n)


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
        around = scipy.spatial.cKDTree(at).query(at, k=5)[1][:, 1:]
        inside = np.linalg.norm(at - at[around].mean(axis=1), axis=1) < MAX_OFF_MIDDLE
        return cls(at, np.flatnonzero(inside), around[inside], 1e3 * pitch)

    def torn_part(self, moved_um: np.ndarray) -> float:
        """Part of these points that are not between the others any more  # moved_um (n, 2)"""
        places = self.positions + moved_um / self.pitch_um
        away = np.linalg.norm(places[self.point] - places[self.around].mean(axis=1), axis=1)
        away = away[np.isfinite(away)]
        return float((away > MIN_TORN_PITCH).mean()) if len(away) else 0.0

    def against_neighbours(self, moved_um: np.ndarray) -> np.ndarray:
        """Motion of these points less the mean of their neighbours  # (n, 2) -> (m, 2) µm"""
        return moved_um[self.point] - moved_um[self.around].mean(axis=1)
