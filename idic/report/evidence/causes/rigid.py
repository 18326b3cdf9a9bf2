"""Rigid motions that neither log nor model has: a jump after the reference, a jump later, one frame, a drift.

    misfit of entry q in frame k:   d_q . (t_k + w_k J (p_q - c))       t : translation, w : turn, small
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from idic.report.evidence.causes.evidence import MIN_SHARE, Cause, Evidence
from idic.report.evidence.causes.lines import excluded_frames, free_rigid_motion

MIN_FRAMES_OF_DRIFT = 4
MIN_GAIN = 0.5  # of what a simpler course leaves, that a course with more unknowns has to explain


@dataclass(frozen=True)
class _Course:
    """A course in time of one rigid motion; values : (n,) of the frames, amplitude : (3,) columns, rows, turn"""

    kind: str
    values: np.ndarray
    amplitude: np.ndarray
    share: float
    first: int = 0


def rigid_motion(evidence: Evidence) -> Cause | None:
    """The rigid motion with the simplest course that explains the misfit."""
    lines = free_rigid_motion(evidence.experiment)
    basis = _basis(evidence)
    if not lines or not evidence.is_seen.any() or np.linalg.matrix_rank(basis, tol=1e-6) < 3:
        return None
    best: _Course | None = None
    for course in _courses(evidence, basis):
        is_better = best is None or 1.0 - course.share < (1.0 - MIN_GAIN) * (1.0 - best.share)
        if course.share >= MIN_SHARE and is_better:
            best = course
    if best is None:
        return None
    text, more_lines = _WORDS[best.kind](evidence, best)
    return Cause(best.kind, best.share, f"{text}: {evidence.of(best.share)}. Write", more_lines or lines)


def rigid_part(evidence: Evidence) -> np.ndarray:
    """The rigid motion of every frame that fits the misfit best  # (n, 3) px, px, rad"""
    return evidence.misfit @ np.linalg.pinv(_basis(evidence)).T


def _basis(evidence: Evidence) -> np.ndarray:
    """Motions of the entries by a translation along columns, along rows, and by a turn  # (q, 3)"""
    centred = evidence.places_px - evidence.places_px.mean(axis=0)
    turned = np.column_stack([-centred[:, 1], centred[:, 0]])
    return np.column_stack([evidence.directions, (turned * evidence.directions).sum(axis=1)])


def _courses(evidence: Evidence, basis: np.ndarray) -> Iterator[_Course]:
    """Courses, those with fewer unknowns first."""
    misfit, seen_frames, n = evidence.misfit, evidence.is_seen.astype(float), len(evidence.frames)

    def fitted(kind: str, values: np.ndarray, first: int = 0) -> _Course:
        values = values * seen_frames
        amplitude = np.linalg.pinv(basis) @ misfit.T @ values / max(float(values @ values), 1e-300)
        return _Course(kind, values, amplitude, evidence.explained(misfit - np.outer(values, basis @ amplitude)), first)

    yield fitted("rigid_jump", np.ones(n))
    yield max((fitted("rigid_frame", (np.arange(n) == k).astype(float), k) for k in range(n)), key=_share)
    if n > 2:
        yield max((fitted("rigid_step", (np.arange(n) >= k).astype(float), k) for k in range(1, n)), key=_share)
    if n >= MIN_FRAMES_OF_DRIFT:
        times = evidence.experiment.model.times
        yield fitted("rigid_drift", times[evidence.frames] - times[evidence.experiment.model.reference])
        for values in evidence.loads.values():
            yield fitted("rigid_load", (values - values[evidence.experiment.model.reference])[evidence.frames])
    amplitudes = rigid_part(evidence)
    size = np.abs(amplitudes @ np.diag([1.0, 1.0, _radius(evidence)])).max(axis=0)
    yield _Course("rigid_free", seen_frames, size / [1.0, 1.0, _radius(evidence)],
                  evidence.explained(misfit - amplitudes @ basis.T))


def _share(course: _Course) -> float:
    return course.share


def _radius(evidence: Evidence) -> float:
    """Distance of the farthest entry from the middle, px."""
    return float(np.linalg.norm(evidence.places_px - evidence.places_px.mean(axis=0), axis=1).max())


def _size(evidence: Evidence, amplitude: np.ndarray) -> str:
    """A rigid motion in words."""
    turn = np.degrees(abs(amplitude[2]))
    moved = evidence.length(float(np.hypot(*amplitude[:2])))
    return moved if turn * np.radians(1.0) * _radius(evidence) < 0.1 else f"{moved} and {turn:.2g} degrees"


def _jump(evidence: Evidence, course: _Course) -> tuple[str, tuple]:
    return (f"the specimen moves as a rigid body by {_size(evidence, course.amplitude)} right after the reference "
            f"{evidence.reference} and stays there (grips closed, camera or table touched)"), ()


def _frame(evidence: Evidence, course: _Course) -> tuple[str, tuple]:
    frame = int(evidence.frames[course.first])
    return (f"{evidence.labels[frame]} alone is moved as a rigid body, by {_size(evidence, course.amplitude)}",
            excluded_frames(evidence.experiment, [frame]))


def _step(evidence: Evidence, course: _Course) -> tuple[str, tuple]:
    until, first = evidence.frames[course.first - 1], evidence.frames[course.first]
    return (f"between {evidence.labels[until]} and {evidence.labels[first]} the specimen moves as a rigid body by "
            f"{_size(evidence, course.amplitude)} and stays there (a grip that gives way, camera or table touched)"), ()


def _drift(evidence: Evidence, course: _Course) -> tuple[str, tuple]:
    size = course.amplitude * np.abs(course.values).max()
    return (f"specimen or camera drift as a rigid body in proportion to time, by {_size(evidence, size)} until the "
            "end"), ()


def _with_load(evidence: Evidence, course: _Course) -> tuple[str, tuple]:
    size = course.amplitude * np.abs(course.values).max()
    return (f"the specimen moves as a rigid body in proportion to the load, by {_size(evidence, size)} at the largest "
            "(a frame that yields)"), ()


def _free(evidence: Evidence, course: _Course) -> tuple[str, tuple]:
    return (f"specimen or camera move as a rigid body from {evidence.reference} to {evidence.reference}, by up to "
            f"{_size(evidence, course.amplitude)}"), ()


_WORDS: dict[str, Callable[[Evidence, _Course], tuple[str, tuple]]] = {
    "rigid_jump": _jump, "rigid_frame": _frame, "rigid_step": _step, "rigid_drift": _drift, "rigid_load": _with_load,
    "rigid_free": _free}
