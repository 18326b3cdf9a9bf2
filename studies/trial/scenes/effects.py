"""Single effects: the change of a scene by each, at an amplitude from `idic_studies.trial.strengths`.

The names are those of the candidates (`idic physics`); the code is independent of theirs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from idic.images import Camera
from idic_studies.trial.scenes.scene import IMAGE_SHAPE_PX, Scene, View, elapsed, loading

Change = Callable[[Scene, float, np.random.Generator], Scene]


@dataclass(frozen=True)
class Effect:
    """One effect that the user's model lacks.

    name : the right answer; family, side : of the candidate; null : the user's model (`scene.NULLS`)
    change : scene, amplitude, random generator -> scene; most : largest plausible amplitude
    signed : both signs occur; calculix : solved by CalculiX; begins : the effect has an onset after the start
    """

    name: str
    family: str
    side: str
    null: str
    change: Change
    most: float = 1.0
    signed: bool = False
    calculix: bool = False
    begins: bool = False


EFFECTS: dict[str, Effect] = {}


def _effect(family: str, side: str, null: str, **more) -> Callable[[Change], Change]:
    def keep(change: Change) -> Change:
        EFFECTS[change.__name__] = Effect(change.__name__, family, side, null, change, **more)
        return change

    return keep


# the body -----------------------------------------------------------------------------------------
@_effect("plasticity", "bulk", "elastic", most=0.9, calculix=True, begins=True)
def plasticity(scene, a, rng):
    """Plasticity with a yield stress below the peak stress at the hole."""
    peak = scene.values["E"] * scene.peak_strain
    return _body(scene, "j2_linear", yield_stress=peak * (1.0 - a), hardening_modulus=400.0)


@_effect("plasticity", "bulk", "plastic", calculix=True, begins=True)
def kinematic_hardening(scene, a, rng):
    slope = scene.values["hardening_modulus"]
    return _body(scene, "j2_kinematic", hardening_modulus=slope * (1.0 - a), C=slope * a, gamma=0.0)


@_effect("plasticity", "bulk", "plastic", calculix=True, begins=True)
def hardening_curvature(scene, a, rng):
    slope = scene.values["hardening_modulus"]
    return _body(scene, "j2_voce", Q=15.0 * a, b=rng.uniform(200.0, 400.0), hardening_modulus=slope * (1.0 - 0.5 * a))


@_effect("rate", "bulk", "plastic", begins=True)
def rate_dependence(scene, a, rng):
    return _body(scene, "viscoplastic", eta=4000.0 * a, m=1.0)


@_effect("rate", "bulk", "elastic")
def viscoelasticity(scene, a, rng):
    return _body(scene, "maxwell", g_1=0.5 * a, tau_1=rng.uniform(3.0, 7.0))


@_effect("rate", "bulk", "elastic", most=3.0, calculix=True)
def creep(scene, a, rng):
    return _body(scene, "creep", rate=4e-4 * a, n=3.0, stress=30.0)


@_effect("damage", "bulk", "elastic", most=0.95, begins=True)
def damage(scene, a, rng):
    """Damage with a threshold below the peak strain at the hole."""
    return _body(scene, "elastic_damage", threshold=scene.peak_strain * (1.0 - a), softening=12.0)


@_effect("elastic_form", "bulk", "elastic", most=2.0, calculix=True)
def orthotropy(scene, a, rng):
    E, nu = scene.values["E"], scene.values["nu"]
    values = {"E1": E * (1.0 + 0.3 * a), "E2": E * (1.0 - 0.3 * a), "nu12": nu, "G12": 0.5 * E / (1.0 + nu),
              "angle": rng.uniform(20.0, 70.0)}
    return replace(scene, law="orthotropic", values=values)


@_effect("elastic_form", "bulk", "rubber", calculix=True)
def second_invariant(scene, a, rng):
    C10 = scene.values["C10"]
    return _body(scene, "mooney_rivlin", C10=C10 * (1.0 - 0.5 * a), C01=0.5 * C10 * a)


@_effect("elastic_form", "bulk", "held", signed=True)
def poisson_ratio(scene, a, rng):
    return replace(scene, values=scene.values | {"nu": scene.values["nu"] + 0.15 * a})


@_effect("environment", "bulk", "elastic", signed=True, calculix=True)
def thermal_expansion(scene, a, rng):
    course = 5e-3 * a * elapsed(scene)
    return replace(scene, warmth=lambda X: np.tile(course[:, None], (1, len(X))))


@_effect("heterogeneity", "bulk", "elastic", most=0.8, signed=True, calculix=True)
def heterogeneity(scene, a, rng):
    """A softer (positive amplitude) or stiffer spot beside the hole."""
    centre = np.array([rng.uniform(1.9, 3.2) * rng.choice([-1, 1]), rng.uniform(-1.6, 1.6)])
    centre, scale = centre * [scene.geometry.length / 10.0, scene.geometry.width / 6.0], scene.geometry.width / 6.0
    radius, factor = scale * rng.uniform(0.8, 1.3), 1.0 - a if a > 0.0 else 1.0 / (1.0 + a)
    return replace(scene, modulus=lambda X: np.where(np.linalg.norm(X - centre, axis=1) < radius, factor, 1.0))


# its ends -----------------------------------------------------------------------------------------
@_effect("boundary", "boundary", "elastic", calculix=True, begins=True)
def grip_slip(scene, a, rng):
    start = float(rng.uniform(0.15, 0.6))
    return scene.moved("RIGHT", scene.along, -0.05 * a * np.maximum(elapsed(scene) - start, 0.0) / (1.0 - start))


@_effect("boundary", "boundary", "elastic", signed=True, calculix=True)
def grip_rotation(scene, a, rng):
    return scene.moved("RIGHT", "x", 0.0, 0.05 * a * loading(scene))


@_effect("boundary", "boundary", "elastic")
def machine_compliance(scene, a, rng):
    return replace(scene, compliance=4e-4 * a)


# the camera ---------------------------------------------------------------------------------------
def centre_px(view: View = View()) -> np.ndarray:  # noqa: B008  (a constant)
    return view.centre_px


@_effect("camera", "camera", "elastic", signed=True)
def lens_distortion(scene, a, rng):
    return replace(scene, camera=lambda camera, k: replace(
        camera, k1=3e-5 * a * _finer(scene), centre_px=centre_px(scene.view)))


@_effect("camera", "camera", "elastic", signed=True)
def magnification(scene, a, rng):
    def seen(camera, k):
        factor = 1.0 + 0.01 * a * elapsed(scene)[k]
        return enlarged(camera, factor, centre_px(scene.view))

    return replace(scene, camera=seen)


@_effect("camera", "camera", "elastic")
def camera_motion(scene, a, rng):
    shifts = 0.5 * a * rng.standard_normal((len(scene.times), 2))
    shifts[0] = 0.0
    return replace(scene, camera=lambda camera, k: replace(camera, origin_px=camera.origin_px + shifts[k]))


@_effect("camera", "camera", "elastic", signed=True)
def illumination(scene, a, rng):
    columns = scene.view.shape[1]
    x = (np.arange(columns) - columns / 2) / columns
    return replace(scene, image=lambda image, k: image * (1.0 + 0.5 * a * elapsed(scene)[k] * x))


@_effect("camera", "camera", "elastic")
def defocus(scene, a, rng):
    """A Gaussian blur whose variance (px^2) rises linearly in time."""
    def blurred(image, k):
        frequency = [2.0 * np.pi * np.fft.fftfreq(n) for n in image.shape]
        passed = np.exp(-0.5 * a * elapsed(scene)[k] * (frequency[0][:, None] ** 2 + frequency[1] ** 2))
        return np.fft.ifft2(np.fft.fft2(image) * passed).real

    return replace(scene, image=blurred)


# the load cell and its clock ----------------------------------------------------------------------
@_effect("force", "force", "elastic", signed=True)
def force_offset(scene, a, rng):
    return replace(scene, force=lambda F: F + 0.3 * a * np.abs(F).max())


@_effect("force", "force", "elastic", signed=True)
def force_drift(scene, a, rng):
    return replace(scene, force=lambda F: F + 0.3 * a * np.abs(F).max() * elapsed(scene))


@_effect("force", "force", "known", signed=True)
def force_scale(scene, a, rng):
    return replace(scene, force=lambda F: F * (1.0 + 0.2 * a))


@_effect("force", "force", "elastic", signed=True)
def frame_time_offset(scene, a, rng):
    return replace(scene, late=0.8 * a)


def enlarged(camera: Camera, factor: float, about_px: np.ndarray) -> Camera:
    """The camera with a larger image, about a point of it."""
    return replace(camera, matrix=factor * camera.matrix, origin_px=about_px + factor * (camera.origin_px - about_px))


def _finer(scene: Scene) -> float:
    """Factor of k1 (1/px²) for the same distortion of a finer image."""
    return (IMAGE_SHAPE_PX[1] / scene.view.shape[1]) ** 2


def _body(scene: Scene, law: str, **values: float) -> Scene:
    return replace(scene, law=law, values={**scene.values, **values})
