"""Errors of setup, machine and camera that used to get another one's name, on the generator of the blind trial.

The truth is made on another mesh with finer steps, rendered from an analytic texture; nothing of the corrections and
cameras of an experiment.toml is used for it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from idic.validation.trial.scenes.effects import centre_px
from idic.validation.trial.scenes.recording import Paint, write_public
from idic.validation.trial.scenes.scene import NULLS, Geometry, Scene, elapsed, plain_scene
from idic.validation.trial.scenes.solve import solve


@dataclass(frozen=True)
class Confusion:
    """One concealed error. name : of the right candidate; was : what it used to be called; change : of a scene."""

    name: str
    was: str
    change: Callable[[Scene], Scene]
    null: str = "elastic"


def way(scene: Scene) -> np.ndarray:
    """Direction of the grip, the last one while it rests  # (T,)"""
    found, last = np.zeros(len(scene.times)), 0.0
    for k in range(1, len(found)):
        last = float(np.sign(scene.grip[k] - scene.grip[k - 1])) or last
        found[k] = last
    return found


def late(scene: Scene) -> np.ndarray:
    """A course that begins in the middle of the test and ends at one  # (T,)"""
    return np.maximum(elapsed(scene) - 0.5, 0.0) / 0.5


def twice(scene: Scene) -> np.ndarray:
    """A course with two steps, 1 after each  # (T,)"""
    return (elapsed(scene) > 0.3) * 1.0 + (elapsed(scene) > 0.8) * 1.0


def _larger(camera, factor):
    return replace(camera, matrix=factor * camera.matrix,
                   origin_px=centre_px() + factor * (camera.origin_px - centre_px()))


def _turned(camera, degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[c, s], [-s, c]])
    return replace(camera, matrix=turn @ camera.matrix, origin_px=centre_px() + turn @ (camera.origin_px - centre_px()))


def _law(scene: Scene, law: str, **values: float) -> Scene:
    return replace(scene, law=law, values={**scene.values, **values})


CONFUSIONS = {
    "friction of 2 %": Confusion(
        "friction", "viscoelasticity", lambda s: replace(s, force=lambda F: F * (1.0 + 0.02 * way(s)))),
    "reversible nonlinear elasticity": Confusion(
        "nonlinear_elasticity", "damage", lambda s: _law(s, "nonlinear_elastic", nonlinearity=8.0)),
    "pixel size 3 % off": Confusion(
        "pixel_size", "heterogeneity", lambda s: replace(s, camera=lambda camera, k: _larger(camera, 1.03))),
    "camera rotated by 0.5 degrees": Confusion(
        "camera_rotation", "grip_rotation", lambda s: replace(s, camera=lambda camera, k: _turned(camera, 0.5))),
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
