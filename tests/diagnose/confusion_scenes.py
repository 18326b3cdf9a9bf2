"""Errors of setup, machine and camera that used to get another one's name, on the generator of the blind trial.

The truth is made on another mesh with finer steps, rendered from an analytic texture; nothing of the corrections and
cameras of an experiment.toml is used for it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from idic_studies.trial.scenes.effects import centre_px, enlarged
from idic_studies.trial.scenes.recording import Paint, write_public
from idic_studies.trial.scenes.scene import NULLS, Geometry, Scene, elapsed, plain_scene
from idic_studies.trial.scenes.setup import direction, late, turned, twice
from idic_studies.trial.scenes.solve import solve


@dataclass(frozen=True)
class Confusion:
    """One concealed error. name : of the right candidate; was : what it used to be called; change : of a scene."""

    name: str
    was: str
    change: Callable[[Scene], Scene]
    null: str = "elastic"


def _law(scene: Scene, law: str, **values: float) -> Scene:
    return replace(scene, law=law, values={**scene.values, **values})


CONFUSIONS = {
    "friction of 2 %": Confusion(
        "friction", "viscoelasticity", lambda s: replace(s, force=lambda F: F * (1.0 + 0.02 * direction(s)))),
    "reversible nonlinear elasticity": Confusion(
        "nonlinear_elasticity", "damage", lambda s: _law(s, "nonlinear_elastic", nonlinearity=8.0)),
    "pixel size 3 % off": Confusion(
        "pixel_size", "heterogeneity",
        lambda s: replace(s, camera=lambda camera, k: enlarged(camera, 1.03, centre_px()))),
    "camera rotated by 0.5 degrees": Confusion(
        "camera_rotation", "grip_rotation",
        lambda s: replace(s, camera=lambda camera, k: turned(camera, 0.5, centre_px()))),
    "drift from the middle on": Confusion(
        "force_drift", "outside", lambda s: replace(s, force=lambda F: F + 0.06 * np.abs(F).max() * late(s))),
    "grip that begins to turn in a plastic plate": Confusion(
        "grip_rotation", "heterogeneity", lambda s: s.moved("RIGHT", "x", 0.0, 0.006 * late(s)), "plastic"),
    "load cell bent by 2 %": Confusion(
        "load_cell_curvature", "none", lambda s: replace(s, force=lambda F: F * (1.0 + 0.02 * F / np.abs(F).max()))),
    "grip that swings": Confusion(
        "grip_rotation", "outside", lambda s: s.moved("RIGHT", "x", 0.0, 0.006 * np.sin(2.0 * np.pi * elapsed(s)))),
    "grip that slips twice": Confusion(
        "grip_slip", "machine_compliance", lambda s: s.moved("RIGHT", "x", -0.004 * twice(s))),
}


def write_confusion(folder: Path, name: str, seed: int) -> Scene:
    """The folder of the tool; returns the truth."""
    one = CONFUSIONS[name]
    rng, null = np.random.default_rng([seed, 5]), NULLS[one.null]
    stiff = {key: rng.uniform(0.95, 1.05) if key != "nu" else 1.0 for key in null.truth}
    values = {key: value * stiff[key] for key, value in null.truth.items()}
    scene = one.change(plain_scene(one.null, Geometry(radius=float(rng.uniform(0.85, 1.15))), values))
    write_public(folder, scene, solve(scene), Paint(int(rng.integers(2**31)), int(rng.integers(2**31))))
    return scene
