"""Amplitudes of effects in drawn worlds: the strength is measured on a test of the same world with small images.

Larger images see the same motion with r times as many pixels along each side, r times as large: r^2 times as many
standard deviations of a motion, r times as many of a grey value, as many as before of a reading.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from json import dumps, loads
from pathlib import Path
from typing import Any

import numpy as np

from idic.errors import NotConverged
from idic.validation.trial.scenes.effects import Effect
from idic.validation.trial.scenes.photographs import Photograph
from idic.validation.trial.scenes.recording import Paint, on_photograph
from idic.validation.trial.scenes.scene import IMAGE_SHAPE_PX
from idic.validation.trial.scenes.worlds import world_scene
from idic.validation.trial.strength import FAINT, Bench, Seen, calibrated
from idic.validation.trial.strengths import FIRST_AMPLITUDE, NOT_CONVERGED, strengths

MAX_MEASUREMENTS = 4  # of an amplitude: a strength is met within about a third
MIN_REACHED = 0.67  # of the faint strength: with less at its largest plausible amplitude an effect is not there


def amplitude_in(world: Mapping[str, Any], null: str, values: Mapping[str, float], effect: Effect,
                 strength: str, photograph: Photograph | None = None) -> tuple[float, bool]:
    """The amplitude at which an effect has a strength in a world, or there on a photographed surface; whether the world
    shows the effect at all. A rolling shutter shows nothing of an even motion, however slow it is.
    """
    bench = _bench(dumps(dict(world), sort_keys=True), null, dumps(dict(values), sort_keys=True), photograph)
    ratio = world["columns"] / IMAGE_SHAPE_PX[1]
    known = strengths().get(effect.name, {}).get(strength)
    start = FIRST_AMPLITUDE if known is None else known["amplitude"] / max(ratio, 1.0)

    def measure(a: float) -> Seen:
        try:
            changed = effect.change(bench.plain, a, np.random.default_rng(5))
            return _larger(bench.measure(changed), effect, changed.image is not None, ratio)
        except NotConverged:
            return NOT_CONVERGED

    amplitude, seen = calibrated(measure, strength, effect.most, start, MAX_MEASUREMENTS)
    return amplitude, bool(seen.reaches(FAINT) >= MIN_REACHED)


@lru_cache(maxsize=1)
def _bench(world: str, null: str, values: str, photograph: Photograph | None) -> Bench:
    """The identified test without effects, with images of the smallest size, in plane stress."""
    small = loads(world) | {"columns": IMAGE_SHAPE_PX[1]}
    plain = replace(world_scene(small, null, 1.0, loads(values)), finite=False, noise="white")
    with tempfile.TemporaryDirectory(prefix="bench-") as folder:
        return Bench.of(plain, Path(folder), Paint(1, 2) if photograph is None else on_photograph(1, 2, photograph))


def _larger(seen: Seen, effect: Effect, of_grey_values: bool, ratio: float) -> Seen:
    """The strength in images that are `ratio` times as large."""
    power = 0.0 if effect.side == "force" else 1.0 if of_grey_values else 2.0
    return replace(seen, seen=seen.seen * ratio**power, rise=seen.rise * ratio ** (2.0 if power == 2.0 else 0.0))
