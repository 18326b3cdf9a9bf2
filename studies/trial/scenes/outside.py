"""Effects that no candidate describes: the right verdict is ``outside_library``, with side and onset."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic_studies.trial.scenes.effects import Effect, centre_px
from idic_studies.trial.scenes.scene import IMAGE_SHAPE_PX, Scene, elapsed, loading


def slit(scene: Scene, a, rng):
    """A cut from the hole's edge."""
    return replace(scene, slit=1.2 * a)


def heat_haze(scene: Scene, a, rng):
    """Air of changing density: every frame is seen through another smooth random field."""
    larger = scene.view.shape[1] / IMAGE_SHAPE_PX[1]
    lengths = rng.uniform(2.0 * np.pi / 70.0, 2.0 * np.pi / 30.0, (len(scene.times), 6))
    waves = lengths / larger * rng.choice([-1, 1], (1, 6))
    angles, phases = rng.uniform(0.0, np.pi, (2, len(scene.times), 6))
    sizes = 0.1 * a * rng.standard_normal((len(scene.times), 6, 2))
    sizes[0] = 0.0

    def bent(points, k):
        along = points[:, [0]] * np.cos(angles[k]) + points[:, [1]] * np.sin(angles[k])
        return points + np.sin(waves[k] * along + phases[k]) @ sizes[k]

    return replace(scene, warp=bent)


def travelling_band(scene: Scene, a, rng):
    """A Lüders band: extra strain behind a front that travels along the strip."""
    start, course = -0.5 * scene.geometry.length, elapsed(scene)

    def strain(X):
        front = start + course[:, None] * scene.geometry.length
        return 2e-3 * a / (1.0 + np.exp(np.clip((X[None, :, 0] - front) / 0.2, -50.0, 50.0))) * (course[:, None] > 0.0)

    return replace(scene, warmth=strain)


def buckle(scene: Scene, a, rng):
    """Buckling: a bulge towards the camera that grows with the load."""
    at = centre_px(scene.view) + rng.uniform(-0.25, 0.25, 2) * np.array(scene.view.shape[::-1])
    width = 18.0 * scene.view.shape[1] / IMAGE_SHAPE_PX[1]
    course = loading(scene) ** 2

    def bent(points, k):
        d = points - at
        return points + a * course[k] * 0.1 * d * np.exp(-(d**2).sum(axis=1) / (2.0 * width**2))[:, None]

    return replace(scene, warp=bent)


def uneven_grip(scene: Scene, a, rng):
    """A jaw that holds the middle more firmly than the edges: neither grip slip nor grip rotation."""
    return scene.moved("RIGHT", "x", 0.0, -0.03 * a * loading(scene), 0.05 * a * loading(scene))


OUTSIDE = {effect.name: effect for effect in (
    Effect("slit", "", "bulk", "elastic", slit),
    Effect("heat_haze", "", "camera", "elastic", heat_haze),
    Effect("travelling_band", "", "bulk", "elastic", travelling_band),
    Effect("buckle", "", "camera", "elastic", buckle),
    Effect("uneven_grip", "", "boundary", "elastic", uneven_grip),
)}
