"""Columns of causes at the ends of a specimen: the response to a pattern of unit amplitude, times courses in time.

A change of a prescribed motion enters a first-order response at the present frame only (`idic.fe.response`), so that
all courses of one pattern (of a slip, a rotation) share the response to the unit amplitude: du_t = c(t) s_t.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from idic.diagnose.physics.candidate import Variant
from idic.model import (
    CORRECTION_TERMS, Correction, Experiment, TEMPERATURE, TemperatureField, corrections_of, knot_name, without_knot,
)

Pattern = tuple[str, str, str, tuple]  # node set, component, kind, keys that this kind alone has


@dataclass(frozen=True, eq=False)
class TimedVariant:
    """A variant whose degrees of freedom are amplitudes of one pattern.

    names : of its columns; courses : (n_frames, n_columns) amplitude of the pattern per unit of a column; unit : the
    experiment in which the pattern has the amplitude 1 in every frame
    """

    variant: Variant
    pattern: Pattern
    names: tuple[str, ...]
    courses: np.ndarray
    unit: Experiment


def timed(experiment: Experiment, variant: Variant) -> TimedVariant | None:
    """A variant as a pattern times courses; None where it is another change of the model.

    experiment : with the edits of the variant. One column, the way from null to probe, or one per knot of a free
    course.
    """
    if (warm := _warmth(experiment, variant)) is not None:
        return warm
    found = [_correction(experiment, name) for name in variant.new]
    if not found or not variant.exact or any(one is None for one in found):
        return None
    number, first = found[0]  # type: ignore[misc]
    entry = experiment.prescribed[number]
    pattern = (entry.nodes, entry.component, first.kind, tuple(sorted(first.keys.items())))
    courses = np.array([correction.course for _, correction in found]).T  # type: ignore[misc]
    names = variant.new if variant.free_course else (variant.label,)
    if not variant.free_course:
        (name,) = variant.new
        courses = courses * (variant.probe[name] - variant.null[name])
    steady = replace(first, course=np.ones_like(first.course))
    kept = tuple(steady if one is first else one for one in corrections_of(entry.drive))
    prescribed = list(experiment.prescribed)
    prescribed[number] = replace(entry, drive=replace(entry.drive, corrections=kept))  # type: ignore[type-var]
    return TimedVariant(variant, pattern, names, courses, replace(experiment, prescribed=tuple(prescribed)))


def _warmth(experiment: Experiment, variant: Variant) -> TimedVariant | None:
    """A temperature whose course the data give: the response to 1 K, times the courses of its knots."""
    if not variant.new or without_knot(variant.new[0]) != TEMPERATURE:
        return None
    free = next(entry for entry in experiment.temperatures if entry.hats is not None)
    of_name = {knot_name(TEMPERATURE, frame): hat for frame, hat in zip(free.knots, free.hats, strict=True)}  # type: ignore
    warm = np.ones((experiment.n_frames, experiment.mesh.n_nodes))
    warm[:experiment.reference + 1] = 0.0
    steady = tuple(replace(entry, drive=TemperatureField(warm), knots=(), hats=None) if entry is free else entry
                   for entry in experiment.temperatures)
    return TimedVariant(variant, (TEMPERATURE, "", "warmth", ()), variant.new,
                        np.array([of_name[name] for name in variant.new]).T, replace(experiment, temperatures=steady))


def unit_values(one: TimedVariant) -> dict[str, float]:
    """Values of the degrees of freedom of a variant at which its pattern has the amplitude 1."""
    return dict.fromkeys(one.variant.new, 0.0) | {one.variant.new[0]: 1.0}


def times_courses(variants: Sequence[TimedVariant], patterns: Sequence[Pattern], frames: np.ndarray, fields: np.ndarray,
                  channels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns of all variants, one after the other  # (T, n_seen, K), (T, n_channels, K)

    patterns : of the responses fields (T, n_seen, n), channels (T, n_channels, n) to unit amplitudes
    """
    which = [patterns.index(one.pattern) for one in variants for _ in one.names]
    courses = np.concatenate([one.courses[frames] for one in variants], axis=1)  # (T, K)
    return fields[..., which] * courses[:, None, :], channels[..., which] * courses[:, None, :]


def _correction(experiment: Experiment, name: str) -> tuple[int, Correction] | None:
    """The correction whose amplitude is a degree of freedom, with the number of its prescribed displacement."""
    stem, _, last = name.rpartition(".")
    for number, entry in enumerate(experiment.prescribed):
        if stem == f"boundary.{entry.nodes}.{entry.component}":
            for correction in corrections_of(entry.drive):
                if correction.name == last and CORRECTION_TERMS[correction.kind].is_timed:
                    return number, correction
    return None
