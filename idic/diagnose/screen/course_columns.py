"""Columns of causes at the ends of a specimen: the response to a pattern of unit amplitude, times courses in time.

A change of a prescribed motion enters a first-order response at the present frame only (`idic.fe.response`), so that
all courses of one pattern (of a slip, a rotation) share the response to the unit amplitude: du_t = c(t) s_t.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from idic.diagnose.physics.candidate import Variant
from idic.diagnose.residual.evidence import Columns, Courses
from idic.model import (
    CORRECTION_TERMS, Correction, Experiment, Model, TEMPERATURE, TemperatureField, corrections_of, knot_name,
    without_knot,
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
    terms = [term for name in variant.new if (term := _correction(experiment.model, name)) is not None]
    if not terms or not variant.exact or len(terms) < len(variant.new):
        return None
    number, first = terms[0]
    entry = experiment.model.prescribed[number]
    pattern = (entry.nodes, entry.component, first.kind, tuple(sorted(first.keys.items())))
    courses = np.array([correction.course for _, correction in terms]).T
    names = variant.new if variant.free_course else (variant.label,)
    if not variant.free_course:
        (name,) = variant.new
        courses = courses * (variant.probe[name] - variant.null[name])
    steady = replace(first, course=np.ones_like(first.course))
    corrections = tuple(steady if term is first else term for term in corrections_of(entry.drive))
    prescribed = list(experiment.model.prescribed)
    prescribed[number] = replace(entry, drive=replace(entry.drive, corrections=corrections))
    return TimedVariant(variant, pattern, names, courses,
                        replace(experiment, model=replace(experiment.model, prescribed=tuple(prescribed))))


def _warmth(experiment: Experiment, variant: Variant) -> TimedVariant | None:
    """A temperature whose course the data give: the response to 1 K, times the courses of its knots."""
    model = experiment.model
    if not variant.new or without_knot(variant.new[0]) != TEMPERATURE:
        return None
    free_entry = next(entry for entry in model.temperatures if entry.hats is not None)
    of_name = {knot_name(TEMPERATURE, frame): hat for frame, hat in zip(free_entry.knots, free_entry.hats, strict=True)}
    warm = np.ones((model.n_frames, model.mesh.n_nodes))
    warm[:model.reference + 1] = 0.0
    steady = tuple(replace(entry, drive=TemperatureField(warm), knots=(), hats=None) if entry is free_entry else entry
                   for entry in model.temperatures)
    return TimedVariant(variant, (TEMPERATURE, "", "warmth", ()), variant.new,
                        np.array([of_name[name] for name in variant.new]).T,
                        replace(experiment, model=replace(model, temperatures=steady)))


def unit_values(timed_variant: TimedVariant) -> dict[str, float]:
    """Values of the degrees of freedom of a variant at which its pattern has the amplitude 1."""
    return dict.fromkeys(timed_variant.variant.new, 0.0) | {timed_variant.variant.new[0]: 1.0}


def times_courses(variants: Sequence[TimedVariant], patterns: Sequence[Pattern], frames: np.ndarray, fields: np.ndarray,
                  channels: np.ndarray) -> Columns:
    """Columns of all variants, one after the other.

    patterns : of the responses fields (T, n_seen, P), channels (T, n_channels, P) to unit amplitudes
    """
    motion = np.array([patterns.index(variant.pattern) for variant in variants for _ in variant.names])
    amplitude = np.concatenate([variant.courses[frames] for variant in variants], axis=1)  # (T, K)
    names = tuple(name for variant in variants for name in variant.names)
    return Columns(names, fields, channels[..., motion] * amplitude[:, None], courses=Courses(motion, amplitude))


def _correction(model: Model, name: str) -> tuple[int, Correction] | None:
    """The correction whose amplitude is a degree of freedom, with the number of its prescribed displacement."""
    stem, _, word = name.rpartition(".")
    for number, entry in enumerate(model.prescribed):
        if stem == f"boundary.{entry.nodes}.{entry.component}":
            for correction in corrections_of(entry.drive):
                if correction.name == word and CORRECTION_TERMS[correction.kind].is_timed:
                    return number, correction
    return None
