"""Errors of setup, machine and camera, further courses of known causes, and further effects without a candidate.

Nothing of the corrections and cameras of an experiment.toml is used for them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic_studies.trial.scenes.effects import Effect, centre_px, enlarged
from idic_studies.trial.scenes.scene import Scene, elapsed, loading


def direction(scene: Scene) -> np.ndarray:
    """Of the grip, the last one while it rests  # (T,)"""
    signs, sign = np.zeros(len(scene.times)), 0.0
    for k in range(1, len(signs)):
        sign = float(np.sign(scene.grip[k] - scene.grip[k - 1])) or sign
        signs[k] = sign
    return signs


def late(scene: Scene) -> np.ndarray:
    """A course that begins in the middle of the test and ends at one  # (T,)"""
    return np.maximum(elapsed(scene) - 0.5, 0.0) / 0.5


def twice(scene: Scene) -> np.ndarray:
    """A course with two steps, 1 after each  # (T,)"""
    return (elapsed(scene) > 0.3) * 1.0 + (elapsed(scene) > 0.8) * 1.0


def turned(camera, degrees: float, about_px: np.ndarray):
    """The camera with its image turned about a point."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[c, s], [-s, c]])
    return replace(camera, matrix=turn @ camera.matrix, origin_px=about_px + turn @ (camera.origin_px - about_px))


def friction(scene: Scene, a, rng):
    return replace(scene, force=lambda F: F * (1.0 + 0.2 * a * direction(scene)))


def pixel_size(scene: Scene, a, rng):
    return replace(scene, camera=lambda camera, k: enlarged(camera, 1.0 + 0.3 * a, centre_px(scene.view)))


def camera_rotation(scene: Scene, a, rng):
    return replace(scene, camera=lambda camera, k: turned(camera, 5.0 * a, centre_px(scene.view)))


def nonlinear_elasticity(scene: Scene, a, rng):
    return replace(scene, law="nonlinear_elastic", values={**scene.values, "nonlinearity": 80.0 * a})


def load_cell_curvature(scene: Scene, a, rng):
    return replace(scene, force=lambda F: F * (1.0 + a * F / np.abs(F).max()))


def late_drift(scene: Scene, a, rng):
    return replace(scene, force=lambda F: F + 0.3 * a * np.abs(F).max() * late(scene))


def late_rotation(scene: Scene, a, rng):
    return scene.moved("RIGHT", "x", 0.0, 0.05 * a * late(scene))


def swinging_grip(scene: Scene, a, rng):
    return scene.moved("RIGHT", "x", 0.0, 0.05 * a * np.sin(2.0 * np.pi * elapsed(scene)))


def two_slips(scene: Scene, a, rng):
    return scene.moved("RIGHT", scene.along, -0.03 * a * twice(scene))


def breathing_camera(scene: Scene, a, rng):
    course = np.sin(2.0 * np.pi * elapsed(scene))
    return replace(scene, camera=lambda camera, k: enlarged(camera, 1.0 + 0.01 * a * course[k], centre_px(scene.view)))


def rolling_shutter(scene: Scene, a, rng):
    """Rows are exposed one after the other while the right end moves."""
    speed = np.gradient(scene.grip, scene.times) / scene.view.pixel
    height, width = scene.view.shape

    def bent(points, k):
        moved = 0.5 * a * speed[k] * (points[:, 0] / width) * (points[:, 1] / height - 0.5)
        return points + np.column_stack([moved, np.zeros(len(points))])

    return replace(scene, warp=bent)


def yielding_jaw(scene: Scene, a, rng):
    """Jaws that let the end contract across, the more the larger the load."""
    return scene.moved("RIGHT", "y", 0.0, -0.05 * a * loading(scene))


SETUP = {kind: Effect(name, family, side, null, change, signed=signed, begins=begins)
         for kind, (name, family, side, null, change, signed, begins) in {
    "friction": ("friction", "force", "force", "elastic", friction, False, False),
    "pixel_size": ("pixel_size", "camera", "camera", "elastic", pixel_size, True, False),
    "camera_rotation": ("camera_rotation", "camera", "camera", "elastic", camera_rotation, True, False),
    "nonlinear_elasticity": ("nonlinear_elasticity", "elastic_form", "bulk", "elastic", nonlinear_elasticity, False,
                             False),
    "load_cell_curvature": ("load_cell_curvature", "force", "force", "elastic", load_cell_curvature, True, False),
    "late_drift": ("force_drift", "force", "force", "elastic", late_drift, True, True),
    "late_rotation": ("grip_rotation", "boundary", "boundary", "plastic", late_rotation, True, True),
    "swinging_grip": ("grip_rotation", "boundary", "boundary", "elastic", swinging_grip, True, False),
    "two_slips": ("grip_slip", "boundary", "boundary", "elastic", two_slips, False, True),
    "breathing_camera": ("magnification", "camera", "camera", "elastic", breathing_camera, True, False),
}.items()}
FURTHER_OUTSIDE = {effect.name: effect for effect in (
    Effect("rolling_shutter", "", "camera", "elastic", rolling_shutter),
    Effect("yielding_jaw", "", "boundary", "elastic", yielding_jaw),
)}
