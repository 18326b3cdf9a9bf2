"""Amplitudes of effects in drawn worlds: the strength is measured on the same world, in plane stress, with the images
and the noise of that world.

A strength does not follow from that of smaller images: they see a motion by the square of their size, a grey value by
their size, and a reading, or the noise of a log, not at all; most effects are seen by all of them.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from json import dumps, loads
from pathlib import Path
from typing import Any

from idic.errors import NotConverged
from idic_studies.trial.scenes.effects import Effect
from idic_studies.trial.scenes.photographs import Photograph
from idic_studies.trial.scenes.recording import Paint, on_photograph
from idic_studies.trial.scenes.scene import IMAGE_SHAPE_PX
from idic_studies.trial.scenes.worlds import world_scene
from idic_studies.trial.strength import FAINT, Bench, Seen, calibrated
from idic_studies.trial.strengths import FIRST_AMPLITUDE, NOT_CONVERGED, strengths

MAX_MEASUREMENTS = 4  # of an amplitude: a strength is met within about a third
MIN_REACHED = 0.67  # of the faint strength: with less at its largest plausible amplitude an effect is not there


def amplitude_in(world: Mapping[str, Any], null: str, values: Mapping[str, float], effect: Effect,
                 strength: str, photograph: Photograph | None = None) -> tuple[float, bool]:
    """The amplitude at which an effect has a strength in a world, or there on a photographed surface; whether the world
    shows the effect at all. A rolling shutter shows nothing of an even motion, however slow it is.
    """
    bench = _bench(dumps(dict(world), sort_keys=True), null, dumps(dict(values), sort_keys=True), photograph)
    tabulated = strengths().get(effect.name, {}).get(strength)
    start = FIRST_AMPLITUDE if tabulated is None else tabulated["amplitude"] * IMAGE_SHAPE_PX[1] / world["columns"]

    def measure(a: float) -> Seen:
        try:
            return bench.measure_effect(effect, a)
        except NotConverged:
            return NOT_CONVERGED

    amplitude, figures = calibrated(measure, strength, effect.most, start, MAX_MEASUREMENTS)
    return amplitude, bool(figures.reaches(FAINT) >= MIN_REACHED)


@lru_cache(maxsize=1)
def _bench(world: str, null: str, values: str, photograph: Photograph | None) -> Bench:
    """The identified test of a world without effects, in plane stress."""
    plain = replace(world_scene(loads(world), null, 1.0, loads(values)), finite=False)
    with tempfile.TemporaryDirectory(prefix="bench-") as folder:
        return Bench.of(plain, Path(folder), Paint(1, 2) if photograph is None else on_photograph(1, 2, photograph))
