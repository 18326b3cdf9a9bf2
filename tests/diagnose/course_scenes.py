"""Causes whose course no ramp and no jump follows, on the generator of the blind trial.

Nothing of the corrections, channels and cameras of an experiment.toml is used for the truth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from idic_studies.trial.scenes.effects import centre_px, enlarged
from idic_studies.trial.scenes.recording import Paint, write_public
from idic_studies.trial.scenes.scene import NULLS, Geometry, Scene, elapsed, plain_scene
from idic_studies.trial.scenes.solve import solve


@dataclass(frozen=True)
class Wandering:
    """One concealed cause. name : of its candidate; change : of a scene; null : the user's model."""

    name: str
    change: Callable[[Scene], Scene]
    null: str = "elastic"


def to_and_fro(scene: Scene) -> np.ndarray:
    """A full swing over the test  # (T,)"""
    return np.sin(2.0 * np.pi * elapsed(scene))


def bump(scene: Scene) -> np.ndarray:
    """Off and back again around the middle of the test  # (T,)"""
    course = np.exp(-((elapsed(scene) - 0.6) / 0.15) ** 2)
    return course - course[0]


SCENES = {
    "wandering load cell": Wandering(
        "force_drift", lambda s: replace(s, force=lambda F: F + 0.06 * np.abs(F).max() * bump(s))),
    "swinging grip": Wandering("grip_rotation", lambda s: s.moved("RIGHT", "x", 0.0, 0.006 * to_and_fro(s))),
    "slip and back": Wandering("grip_slip", lambda s: s.moved("RIGHT", "x", -0.004 * bump(s))),
    "breathing camera": Wandering(
        "magnification",
        lambda s: replace(s, camera=lambda c, k: enlarged(c, 1.0 + 0.002 * to_and_fro(s)[k], centre_px()))),
}


def write_scene(folder: Path, name: str, seed: int) -> Scene:
    """The folder of the tool; returns the truth."""
    one, rng = SCENES[name], np.random.default_rng([seed, 9])
    truth = NULLS[one.null].truth
    values = {key: value * (rng.uniform(0.95, 1.05) if key != "nu" else 1.0) for key, value in truth.items()}
    scene = one.change(plain_scene(one.null, Geometry(radius=float(rng.uniform(0.85, 1.15))), values))
    write_public(folder, scene, solve(scene), Paint(int(rng.integers(2**31)), int(rng.integers(2**31))))
    return scene
