"""The recording of a scene: images, log, mesh and experiment.toml, without the truth.

The sub-samples of every pixel are mapped back to the body (`idic.virtual_tests.rendering`) and take the value of the
texture there. The mesh of the model differs from that of the truth.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from idic.fe import Mesh
from idic.images import ArrayStack, Camera, dense_speckle
from idic_studies.trial.scenes.photographs import Photograph
from idic_studies.trial.scenes.scene import FORCE_NOISE, GRIP_NOISE, NULLS, Geometry, Scene, View
from idic_studies.trial.scenes.solve import Motion
from idic.virtual_tests import Sensor, Texture, clean_image, painted, record, write_inp, write_loads
from idic_studies.trial.scenes.specimens import is_fine, specimen_mesh

BACKGROUND_GREY = 30.0
IMAGES = "images.npy"
MODEL = (3, 3, 2)

TOML = """
[experiment]
images = "images/*.tif"
loads = "loads.csv"
mesh = "mesh.inp"
kind = "plane_stress"
thickness_mm = {thickness}

[camera]
pixel_size_mm = {pixel}
origin_px = [{column}, {row}]
noise_std_gv = {noise:.4f}

[material.BODY]
{material}
[[boundary]]
nodes = "LEFT"
ux = 0.0
uy = 0.0

[[boundary]]
nodes = "RIGHT"
u{along} = {{ column = "grip_mm", noise_std = {grip} }}
u{across} = 0.0

[[channel]]
column = "force_N"
simulated = {{ reaction = "RIGHT", component = "{along}" }}
noise_std = {force:.6g}
"""


@dataclass(frozen=True)
class Paint:
    """Texture and noise of a test: seeds, dots' size (px), noise of one image (grey values).

    photograph : of a real surface, in the place of the dots; its noise is real, too
    """

    texture: int
    noise: int
    dots_px: float = 1.6
    noise_gv: float = 2.0
    photograph: Photograph | None = None


def on_photograph(texture: int, noise: int, photograph: Photograph) -> Paint:
    """A real surface with the noise of its photographs; seeds."""
    return Paint(texture, noise, noise_gv=photograph.noise_std, photograph=photograph)


def camera(view: View) -> Camera:
    """The camera of the user's model, the centre of the strip at the centre of the image."""
    return Camera.from_table(view.pixel, tuple(view.centre_px + 0.3), centre=tuple(view.centre_px))


def model_mesh(geometry: Geometry, view: View) -> Mesh:
    """The user's mesh."""
    factor = 2 if is_fine(view) else 1
    return specimen_mesh(geometry, tuple(factor * n for n in MODEL), "BODY")


def logged(scene: Scene, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Force and grip motion of the log, without noise  # (T,) N, (T,) mm"""
    cell_force = motion.force if scene.force is None else scene.force(motion.force)
    late = [np.interp(scene.times - scene.late, scene.times, values)
            for values in (cell_force, scene.grip + scene.compliance * motion.force)]
    return late[0], late[1]


def clean_images(scene: Scene, motion: Motion, paint: Paint) -> Iterator[np.ndarray]:
    """Images without noise, one per frame  # (ny, nx) float"""
    nominal = camera(scene.view)
    first = nominal if scene.camera is None else scene.camera(nominal, 0)
    sensor, texture = Sensor(scene.view.shape, background=BACKGROUND_GREY), _texture(paint, first, scene.view)
    for k, u in enumerate(motion.u):
        view = nominal if scene.camera is None else scene.camera(nominal, k)
        if scene.warp is not None:
            view = _Bent(view, scene.warp, k)
        image = clean_image(u, motion.mesh.nodes, motion.mesh.blocks, view, texture, sensor)
        yield image if scene.image is None else scene.image(image, k)


def _texture(paint: Paint, first: Camera, view: View) -> Texture:
    if paint.photograph is not None:
        return painted(paint.photograph, first)
    extent = max(400.0, 2.0 * max(view.shape))
    speckle = dense_speckle(np.random.default_rng(paint.texture), paint.dots_px, 30.0, 225.0, extent_px=extent)
    return painted(speckle, first)


def _white(image: np.ndarray, frame: int, rng: np.random.Generator) -> np.ndarray:
    return image


def _flicker(image: np.ndarray, frame: int, rng: np.random.Generator) -> np.ndarray:
    """A lamp whose gain and offset differ from frame to frame."""
    return image * (1.0 + 0.01 * rng.standard_normal()) + rng.standard_normal()


def _photons(image: np.ndarray, frame: int, rng: np.random.Generator) -> np.ndarray:
    """Noise whose variance grows with the grey value, on top of that of the sensor: twice its variance at 255."""
    return image + 2.0 * np.sqrt(np.maximum(image, 0.0) / 255.0) * rng.standard_normal(image.shape)


def _photographed(photograph: Photograph, image: np.ndarray, frame: int, rng: np.random.Generator) -> np.ndarray:
    """Noise of real photographs."""
    return image + photograph.noise((image.shape[0], image.shape[1]), rng)


NOISES = {"white": _white, "flicker": _flicker, "photons": _photons}  # what happens before the sensor's own noise


class _Bent:
    """A camera behind a field of refraction: the image of X is at warp(project(X))."""

    k1, tilt = 1.0, (0.0, 0.0)  # not affine

    def __init__(self, plain: Camera, warp, frame: int):
        self.plain, self.warp, self.frame = plain, warp, frame

    def project(self, X: np.ndarray) -> np.ndarray:
        return self.warp(self.plain.project(X), self.frame)

    def inverse(self, points: np.ndarray) -> np.ndarray:
        """Fixed-point iteration: the field is weak and smooth."""
        straight = np.array(points, dtype=float)
        for _ in range(20):
            straight += points - self.warp(straight, self.frame)
        return self.plain.inverse(straight)


def write_public(folder: Path, scene: Scene, motion: Motion, paint: Paint) -> ArrayStack:
    """Write the folder of the tool; returns the images.

    The images are one NumPy file, not TIFF: a campaign has hundreds of tests.
    """
    rng = np.random.default_rng(paint.noise)
    sensor = Sensor(scene.view.shape, noise_std=paint.noise_gv, background=BACKGROUND_GREY)
    stated_gv, disturb = sensor.total_noise_std, NOISES[scene.noise]
    if paint.photograph is not None:
        sensor, disturb = replace(sensor, noise_std=0.0), partial(_photographed, paint.photograph)
    images = np.array([record(disturb(image, k, rng), sensor, rng)
                       for k, image in enumerate(clean_images(scene, motion, paint))])
    force, grip = logged(scene, motion)
    noise = max(FORCE_NOISE * np.abs(motion.force).max(), 1e-6)
    moving = np.arange(len(scene.times)) > 0
    folder.mkdir(parents=True, exist_ok=True)
    write_loads(folder, scene.times, {
        "force_N": force + noise * rng.standard_normal(len(force)),
        "grip_mm": grip - grip[0] + GRIP_NOISE * rng.standard_normal(len(grip)) * moving})
    write_inp(model_mesh(scene.geometry, scene.view), folder / "mesh.inp", "trial")
    (folder / "experiment.toml").write_text(toml_text(scene, stated_gv, noise), encoding="utf-8")
    np.save(folder / IMAGES, images)
    return ArrayStack(images)


def toml_text(scene: Scene, noise_gv: float, force_noise: float) -> str:
    column, row = scene.view.centre_px + 0.3
    table = NULLS[scene.null].table + ('kinematics = "finite"\n' if scene.finite else "")
    return TOML.format(thickness=scene.thickness, pixel=scene.view.pixel, column=column, row=row, noise=noise_gv,
                       grip=GRIP_NOISE, material=table, force=force_noise, along=scene.along,
                       across="y" if scene.along == "x" else "x")


def as_logged(scene: Scene, plain: Scene, motion: Motion) -> Scene:
    """The plain scene, driven by the log of `scene`: the simulation of the user's model at the true parameters."""
    _, grip = logged(scene, motion)
    return replace(plain, grip=grip - grip[0])
