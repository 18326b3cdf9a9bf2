"""Whether the positions of a series are those of its reference or of the stage itself: told from the data.

    X_k = X_0                    reference: a point has one position in all stages
    X_k - u_k = X_0 - u_0        deformed: its position is the one of now
    X_k - X_(k-1) = u_k          increments: u counts from the stage before

X, u : position and displacement in the file. A stage that has moved by few of the last digits of X may fit neither.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import scipy

from idic.errors import InputError
from idic.readers.fields.stages.failed_points import last_digit
from idic.readers.fields.stages.stage import KEY, Stage

REFERENCE, DEFORMED = "reference", "deformed"
MIN_MOTION_DIGITS = 30.0  # median displacement in last digits of the positions
MAX_MISFIT = 0.1  # of that displacement
MAX_MISFIT_PITCH = 0.05  # of a distance of neighbours: the next point is another one


def state_of_positions(read: Callable[[int], Stage], paths: Sequence[Path], default: str) -> str:
    """`REFERENCE` or `DEFORMED`.

    read : a stage by its number, as in the file; paths : of all stages; default : where no stage decides

    Raises
    ------
    InputError
        The positions fit neither, or one in some stages and the other in others.
    """
    n, first = len(paths), read(0)
    if first.displacement is None or len(first.points) < 2 or n < 2:
        return default
    answers: dict[int, str | None] = {}
    for k in dict.fromkeys((n - 1, n // 2, n // 4)):
        if k > 0 and (answer := _state(first, read(k))) != "":
            answers[k] = answer
            if answer is not None and k == n - 1:
                return answer
            if answer is None and k > 1 and _are_increments(read(k - 1), read(k)):
                raise _contradiction(paths[k], "they move from stage to stage by the displacement: it counts from the "
                                     "stage before")
    states = {answer for answer in answers.values() if answer is not None}
    if len(states) > 1:
        raise _contradiction(paths[next(iter(answers))], ", ".join(
            f"{answer or 'neither'} in {paths[k].name}" for k, answer in answers.items()))
    if answers and not states:
        raise _contradiction(paths[next(iter(answers))], "they fit neither the reference nor the stage itself")
    return states.pop() if states else default


def _contradiction(path: Path, finding: str) -> InputError:
    return InputError("positions and displacements contradict each other", file=path, key=KEY,
                      expected="positions of the reference, alike in all stages, or of the stage, displaced by the "
                      "displacement", found=finding,
                      remedy="export displacements against the first stage, or positions of every stage alone; remove "
                      "stages of other specimens from the pattern")


def at_rest(stage: Stage) -> Stage:
    """A stage of deformed positions as others have it: with ids its positions alone, else those of the reference."""
    assert stage.displacement is not None
    is_measured = np.isfinite(stage.displacement).all(axis=1)
    points, displacement = stage.points[is_measured], stage.displacement[is_measured]
    placeless = stage.placeless + int((~is_measured).sum())
    if stage.ids is not None:
        return stage.with_points(points, None, stage.ids[is_measured], placeless)
    return stage.with_points(points - displacement, displacement, None, placeless)


def _state(first: Stage, stage: Stage) -> str | None:
    """The state that a stage shows; None for neither, "" where it does not decide."""
    pair = _matched(first, stage, stage.points)
    if pair is None:
        return ""
    moved = _displacement(stage)[pair[1]] - _displacement(first)[pair[0]]
    motion = float(np.median(np.linalg.norm(moved, axis=1)))
    pitch = float(np.median(scipy.spatial.cKDTree(first.points).query(first.points, k=2)[0][:, 1]))
    most = min(MAX_MISFIT * motion, MAX_MISFIT_PITCH * pitch)
    if _misfit(first, stage, first.points, stage.points) < most:
        return REFERENCE
    origins = [one_stage.points - _displacement(one_stage) for one_stage in (first, stage)]
    if _misfit(first, stage, *origins) < most:
        return DEFORMED
    return None if motion > MIN_MOTION_DIGITS * last_digit(stage.points) else ""


def _are_increments(earlier: Stage, stage: Stage) -> bool:
    pair = _matched(earlier, stage, stage.points - _displacement(stage))
    if pair is None:
        return False
    moved, displacement = stage.points[pair[1]] - earlier.points[pair[0]], _displacement(stage)[pair[1]]
    return bool(np.median(np.linalg.norm(moved - displacement, axis=1))
                < MAX_MISFIT * np.median(np.linalg.norm(displacement, axis=1)))


def _displacement(stage: Stage) -> np.ndarray:
    assert stage.displacement is not None
    return stage.displacement


def _matched(first: Stage, stage: Stage, places: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Rows of points that both stages have measured: by id, else the nearest of `places`  # (m,), (m,)"""
    if stage.displacement is None or first.displacement is None or stage.points.shape[1] != first.points.shape[1]:
        return None
    measured = np.flatnonzero(np.isfinite(stage.displacement).all(axis=1))
    if not len(measured) or not len(first.points):
        return None
    if first.ids is not None and stage.ids is not None:
        _, at, rows = np.intersect1d(first.ids, stage.ids[measured], return_indices=True)
        rows = measured[rows]
    else:
        at, rows = scipy.spatial.cKDTree(first.points).query(places[measured])[1], measured
    is_common = np.isfinite(first.displacement[at]).all(axis=1)
    return (at[is_common], rows[is_common]) if is_common.any() else None


def _misfit(first: Stage, stage: Stage, first_places: np.ndarray, places: np.ndarray) -> float:
    """Median distance of the same points in two stages."""
    is_placed, is_measured = (np.isfinite(vectors).all(axis=1) for vectors in (first_places, _displacement(stage)))
    if first.ids is not None and stage.ids is not None:
        pair = _matched(first, stage, places)
        assert pair is not None
        return float(np.median(np.linalg.norm(places[pair[1]] - first_places[pair[0]], axis=1)))
    return float(np.median(scipy.spatial.cKDTree(first_places[is_placed]).query(places[is_measured])[0]))
