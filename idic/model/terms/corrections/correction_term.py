"""What a logged or fixed motion lacks, declared whole: keys, pattern, course, words, probes.

A correction adds ``amplitude * course(t) * pattern(X)`` to a prescribed displacement, zero where the log is right. A
term is one file of this folder; from it follow its ``kind`` among the ``corrections`` of a drive and their keys, its
degree of freedom ``boundary.SET.COMPONENT.KIND`` with every derivative, its free course, and its candidate in the
diagnosis.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from idic.errors import InputError
from idic.fe import Mesh
from idic.model.records.experiment import Experiment
from idic.model.records.model import Model
from idic.model.records.parts import Column, Constant, Pattern, Prescribed, uniform
from idic.parameters import PlausibleSize

ONSETS = (0.0, 0.2, 0.4, 0.6, 0.8)  # of the test, where a probe begins
PROBE_PX = 0.2


@dataclass(frozen=True)
class Key:
    """A key that the table of this correction has and no other one: a number or whole number between bounds, or one of
    some words."""

    name: str
    type: type = float
    above: float | None = None
    least: float | None = None
    most: float | None = None
    words: tuple[str, ...] = ()


@dataclass(frozen=True)
class Required:
    """Keys without which a correction means nothing, and the words of its refusal; example : a whole table."""

    keys: tuple[str, ...]
    fault: str
    expected: str
    example: str


@dataclass(frozen=True)
class CorrectedMotion:
    """The motion to which a correction belongs, and the table of the correction.

    times : (n_frames,) s, numbers of frames where no times are known; keys : the entries of the table; start : () ->
    when its course begins, refused outside the test; log : (internal unit, None: as logged) -> the column that the
    table names  # (n_frames,)
    """

    drive: Column | Constant
    times: np.ndarray
    reference: int
    length_unit: str
    keys: Mapping[str, Any]
    start: Callable[[], float]
    log: Callable[[str | None], np.ndarray]


@dataclass(frozen=True)
class Probe:
    """A way in which a correction may be missing: its table without ``kind``, at a plausible amplitude.

    value : internal units; sign : +1 where only positive amplitudes are possible
    """

    label: str
    keys: Mapping[str, Any]
    value: float
    sign: int = 0


@dataclass(frozen=True)
class Scale:
    """A number of the table that the probes hold at few values: key, and (node set, value, unit) -> label of a probe.
    """

    key: str
    label: Callable[[str, float, str], str]


@dataclass(frozen=True)
class Cause:
    """A candidate of the diagnosis, in words; several corrections may be forms of one.

    name, title, paraphrase, null, rivals, separating_tests, has_onset, size : as those of a candidate
    """

    name: str
    title: str
    paraphrase: str
    null: str
    rivals: Mapping[str, str]
    separating_tests: tuple[str, ...]
    has_onset: bool = False
    size: PlausibleSize | None = None


@dataclass(frozen=True)
class CorrectionTerm:
    """What a motion at a set of nodes may lack.

    Attributes
    ----------
    kind : in the file, and last word of its degree of freedom
    course : of its motion  # (n_frames,); the value at the reference is taken off
    unit : of the amplitude of that course, "" for none
    cause, probes : of its candidate, (experiment, motion) -> ways in which it may be missing; None: it has none
    pattern : as that of a `Correction`
    reach : (mesh, nodes, component) -> largest value of the pattern
    keys, required : that no other kind has; without which it means nothing
    number : the key whose value ends its name, "" for none
    is_timed, is_logged : it may begin at a time with a course of its own, or have one that the data give; follow a
        column of the log
    free_unit : (length unit) -> of the amplitude of a course of its own; free_sign : (drive) -> its sign
    stays : in a continuation of the test it is as it was last; others follow the motion
    jumps : verb of a cause that may happen in a few jumps, "" of another one
    scale : that the diagnosis refines
    """

    kind: str
    course: Callable[[CorrectedMotion], np.ndarray]
    unit: Callable[[CorrectedMotion], str]
    cause: Cause | None = None
    probes: Callable[[Experiment, Prescribed], list[Probe]] = lambda experiment, motion: []
    pattern: Pattern = uniform
    reach: Callable[[Mesh, np.ndarray, str], float] = lambda mesh, nodes, component: 1.0
    keys: tuple[Key, ...] = ()
    required: Required | None = None
    number: str = ""
    is_timed: bool = False
    is_logged: bool = False
    free_unit: Callable[[str], str] = lambda length_unit: length_unit
    free_sign: Callable[[Column | Constant], float] = lambda drive: 1.0
    stays: bool = False
    jumps: str = ""
    scale: Scale | None = None

    @property
    def reads_force(self) -> bool:
        """Whether its table has to name a column: the unit that [[channel]] gives to it counts."""
        return self.required is not None and "column" in self.required.keys


# courses ------------------------------------------------------------------------------------------
def in_length(motion: CorrectedMotion) -> str:
    """The unit of an amplitude that is a displacement."""
    return motion.length_unit


def in_proportion(motion: CorrectedMotion, name: str) -> np.ndarray:
    """The logged motion, a column of the log over its largest value, or a course from some time on  # (n_frames,)

    Raises
    ------
    InputError
        If a fixed set is without a column.
    """
    if has_course(motion):
        values = motion.drive.values if isinstance(motion.drive, Column) else motion.times
        return timed_course(motion, values)
    if motion.keys.get("column") is not None:
        values = motion.log(None)
        return values / (np.abs(values).max() or 1.0)
    if not isinstance(motion.drive, Column):
        raise InputError(f"a {name} of a fixed set without a column", key="column",
                         expected="the column of the log for its course", found="no column",
                         remedy='name the column, e.g. column = "force_N"')
    return motion.drive.values


def has_course(motion: CorrectedMotion) -> bool:
    """Whether it begins at a time, or has a shape in time."""
    return motion.keys.get("start_s") is not None or motion.keys.get("course") is not None


def follows_motion(motion: CorrectedMotion) -> bool:
    """Whether its course is the logged motion itself."""
    return not has_course(motion) and motion.keys.get("column") is None


def timed_course(motion: CorrectedMotion, values: np.ndarray) -> np.ndarray:
    """A course that begins after the start of a motion, 1 at its end  # (n_frames,)

    "ramp" grows evenly in time, "jump" is there at once, "travel" grows with the way that `values` (n_frames,) cover.
    """
    start, times, shape = motion.start(), motion.times, motion.keys.get("course") or "ramp"
    has_begun = times > start
    if shape == "jump":
        return has_begun.astype(float)
    if shape == "ramp":
        return np.where(has_begun, times - start, 0.0) / max(float(times[-1] - start), 1e-300)
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(values)))])
    distance = np.maximum(way - np.interp(start, times, way), 0.0)
    return distance / max(float(distance[-1]), 1e-300)


def against_motion(drive: Column | Constant) -> float:
    """Sign of what the specimen lags behind a logged motion, where that is largest; +1 at a fixed set."""
    return -_sign_at_largest(drive, drive.values) if isinstance(drive, Column) else 1.0


def against_motion_with(drive: Column | Constant, values: np.ndarray) -> float:
    """The sign by which `values` (n_frames,) count against a logged motion, where that is largest; +1 at a fixed set.
    """
    if not isinstance(drive, Column):
        return 1.0
    return -(float(np.sign(values[np.argmax(np.abs(drive.values))])) * _sign_at_largest(drive, drive.values) or 1.0)


def _sign_at_largest(drive: Column, values: np.ndarray) -> float:
    return float(np.sign(values[np.argmax(np.abs(drive.values))])) or 1.0


# probes -------------------------------------------------------------------------------------------
def probe_starts(model: Model) -> list[dict[str, Any]]:
    """Keys of courses that begin at some moment: evenly in time from then on, or at once."""
    first = float(model.times[model.reference])
    duration = float(model.times[-1] - model.times[model.reference])
    return [{"start_s": float(np.round(first + onset * duration, 9)), "course": course}
            for onset in ONSETS for course in (("ramp", "jump") if onset else ("ramp",))]


def probe_length(model: Model) -> float:
    """A displacement of a fifth of a pixel, mm."""
    return PROBE_PX * model.camera.pixel_size


def main_motion(model: Model) -> Column | None:
    """The logged motion that moves most."""
    drives = [entry.drive for entry in model.prescribed if isinstance(entry.drive, Column)]
    return max(drives, key=lambda drive: np.abs(drive.values).max(), default=None)
