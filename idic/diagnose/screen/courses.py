"""Courses in time of causes that are no material: slip, rotation, misalignment, drift of a channel, magnification,
deflection of a sheet.

A cause is a pattern times a course; the course of one degree of freedom is the change of that amplitude with it, per
frame.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from idic.images import CameraMotion, PlacedCamera, SCANNER, Scanner
from idic.laws import EXPANSION
from idic.model import (
    CORRECTION_TERMS, Experiment, Model, TEMPERATURE, TemperatureField, channel_term, corrections_of, jump_frame,
    knot_name, without_knot,
)

SUPPOSED_EXPANSION_PER_K = 1e-5  # 1/K: without a log of the temperature the data give its product with that
MIN_ONSET_STD = 3.0  # standard deviations: a cause has begun


@dataclass(frozen=True, eq=False)
class Course:
    """The course of a selected cause.

    cause : name of its candidate; name : degree of freedom without its knot; unit : of value; value, std : (n_frames,);
    is_free : the data give it, knot by knot; jumps : frame, size and standard deviation of each, of a course of jumps
    """

    cause: str
    name: str
    unit: str
    value: np.ndarray
    std: np.ndarray
    is_free: bool
    jumps: tuple[tuple[int, float, float], ...] = ()

    @property
    def onset(self) -> tuple[int, int] | None:
        """Frames between which it begins: the last one in which it is zero within a standard deviation, and the first
        one beyond `MIN_ONSET_STD`; None where none is.
        """
        is_visible = np.abs(self.value) > MIN_ONSET_STD * np.maximum(self.std, 1e-300)
        if not is_visible.any():
            return None
        visible = int(np.argmax(is_visible))
        at_zero = np.flatnonzero(np.abs(self.value[:visible]) <= self.std[:visible])
        return (int(at_zero[-1]) if len(at_zero) else 0), visible


def course_of(experiment: Experiment, name: str) -> np.ndarray | None:
    """Amplitude in every frame per unit of a degree of freedom  # (n_frames,); None where it has no course."""
    model = experiment.model
    stem, _, word = name.rpartition(".")
    if without_knot(name) == TEMPERATURE or word == EXPANSION.name:
        return _of_warmth(model, name)
    for entry in model.prescribed:
        if stem == f"boundary.{entry.nodes}.{entry.component}":
            return next((c.course for c in corrections_of(entry.drive)
                         if c.name == word and CORRECTION_TERMS[c.kind].is_timed), None)
    for channel in model.channels:
        term = channel_term(without_knot(word))
        if stem == f"channel.{channel.column}" and term is not None and term.course is not None:
            return term.course.amplitude(experiment, channel, word)
    motion = model.camera.motion
    owner = SCANNER if isinstance(model.camera, Scanner) else experiment.recording.camera_name
    if motion is not None and not isinstance(model.camera, PlacedCamera) and stem == owner \
            and word in motion.names and (word.startswith("magnification")
                                          or motion.kinds[motion.names.index(word)] in CameraMotion.shapes):
        return motion.courses[motion.names.index(word)]
    return None


def _of_warmth(model: Model, name: str) -> np.ndarray | None:
    """Change of the temperature, K, per unit of a knot, or of the expansion under a supposed course: the warmth at an
    expansion of `SUPPOSED_EXPANSION_PER_K`. None where the temperature is logged; a course is taken for supposed."""
    for entry in model.temperatures:
        if entry.hats is not None:
            return {knot_name(TEMPERATURE, frame): hat for frame, hat in zip(entry.knots, entry.hats, strict=True)
                    }.get(name)
        if isinstance(entry.drive, TemperatureField) and entry.drive.source.endswith(".course"):
            values = entry.drive.values[:, 0]
            return (values - values[model.reference]) / SUPPOSED_EXPANSION_PER_K
    return None


def courses_of(cause: str, experiment: Experiment, null: Experiment, names: Iterable[str],
               values: Mapping[str, float], stds: Mapping[str, float | None]) -> list[Course]:
    """Courses of a cause, one per degree of freedom, or per set of knots.

    null : the experiment of the RUN; what expands with a temperature of its file has no course to tell. values, stds :
    of parameters, internal units. Between knots the bands of the neighbours are interpolated: the covariance of knots
    would make it narrower.
    """
    parts: dict[str, list[tuple[str, np.ndarray, float]]] = {}
    for name in names:
        is_given = bool(null.model.temperatures) and name.rpartition(".")[2] == EXPANSION.name
        course = None if is_given else course_of(experiment, name)
        std = stds.get(name)
        if course is not None and std is not None:
            parts.setdefault(without_knot(name), []).append((name, course, std))
    courses = []
    for stem, terms in parts.items():
        value = np.sum([values[name] * course for name, course, _ in terms], axis=0)
        band = np.sum([std * np.abs(course) for _, course, std in terms], axis=0)
        jumps = tuple((frame, values[name], std) for name, _, std in terms if (frame := jump_frame(name)) is not None)
        first = terms[0][0]
        courses.append(Course(cause, stem, _unit(experiment.model, first), value, band, without_knot(first) != first,
                              jumps))
    return courses


def _unit(model: Model, name: str) -> str:
    """Of the amplitude: that of a rate or of a share of the motion times its course."""
    unit = model.parameters[name].unit
    if name.rpartition(".")[2] == EXPANSION.name:
        return "K"
    if name.startswith("channel.") and not unit:  # a share of the reading
        return next(channel.unit for channel in model.channels if name.startswith(f"channel.{channel.column}."))
    if unit.startswith("rad"):
        return "rad"
    if name.startswith("boundary."):
        return model.length_unit
    return unit.removesuffix("/s").replace("1", "") if unit.endswith("/s") else unit


def content(courses: Sequence[Course], times: np.ndarray) -> list[dict]:
    """Entries ``courses`` of diagnosis.json."""
    return [{"name": course.cause, "parameter": course.name, "unit": course.unit, "free": course.is_free,
             "onset_frames": course.onset,
             "jumps": [dict(zip(("frame", "size", "std"), jump, strict=True)) for jump in course.jumps],
             "time_s": times.tolist(), "value": course.value.tolist(), "std": course.std.tolist()}
            for course in courses]
