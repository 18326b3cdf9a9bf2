"""The recording of a scene: images, log, mesh and experiment.toml, without the truth.

The sub-samples of every pixel are mapped back to the body (`idic.virtual_tests.render`) and take the value of the
texture there. The mesh of the model differs from that of the truth.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from idic.fe.mesh.mesh import Mesh
from idic.images.camera import Camera
from idic.images.pattern import dense_speckle
from idic.images.stack import ArrayStack
from idic.validation.trial.scenes.effects import centre_px
from idic.validation.trial.scenes.scene import (FORCE_NOISE, GRIP_NOISE, IMAGE_SHAPE_PX, NULLS, PIXEL_MM,
                                                THICKNESS_MM, Geometry, Scene)
from idic.validation.trial.scenes.solve import Motion
from idic.virtual_tests.experiment_files import write_loads
from idic.virtual_tests.meshes import strip_with_hole, write_inp
from idic.virtual_tests.render import Sensor, Texture, clean_image, painted, record

BACKGROUND_GREY = 30.0
IMAGES = "images.npy"
MODEL = ("quad8", 3, 3, 2)

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
ux = {{ column = "grip_mm", noise_std = {grip} }}
uy = 0.0

[[channel]]
column = "force_N"
simulated = {{ reaction = "RIGHT", component = "x" }}
noise_std = {force:.6g}
"""


@dataclass(frozen=True)
class Paint:
    """Texture and noise of a test: seeds, dots' size (px), noise of one image (grey values)."""

    texture: int
    noise: int
    dots_px: float = 1.6
    noise_gv: float = 2.0


def camera() -> Camera:
    """The camera of the user's model, the centre of the strip at the centre of the image."""
    return Camera.from_table(PIXEL_MM, tuple(centre_px() + 0.3), centre=tuple(centre_px()))


def model_mesh(geometry: Geometry) -> Mesh:
    """The user's mesh."""
    return strip_with_hole(geometry.length, geometry.width, geometry.radius, *MODEL, name="BODY")


def logged(scene: Scene, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Force and grip motion of the log, without noise  # (T,) N, (T,) mm"""
    shown = motion.force if scene.force is None else scene.force(motion.force)
    late = [np.interp(scene.times - scene.late, scene.times, values)
            for values in (shown, scene.grip + scene.compliance * motion.force)]
    return late[0], late[1]


def clean_images(scene: Scene, motion: Motion, paint: Paint) -> Iterator[np.ndarray]:
    """Images without noise, one per frame  # (ny, nx) float"""
    known = camera()
    first = known if scene.camera is None else scene.camera(known, 0)
    sensor, texture = Sensor(IMAGE_SHAPE_PX, background=BACKGROUND_GREY), _texture(paint, first)
    for k, u in enumerate(motion.u):
        seen = known if scene.camera is None else scene.camera(known, k)
        if scene.warp is not None:
            seen = _Bent(seen, scene.warp, k)
        image = clean_image(u, motion.mesh.nodes, motion.mesh.blocks, seen, texture, sensor)
        yield image if scene.image is None else scene.image(image, k)


def _texture(paint: Paint, first: Camera) -> Texture:
    speckle = dense_speckle(np.random.default_rng(paint.texture), paint.dots_px, 30.0, 225.0, extent_px=400.0)
    return painted(speckle, first)


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
    sensor = Sensor(IMAGE_SHAPE_PX, noise_std=paint.noise_gv, background=BACKGROUND_GREY)
    images = np.array([record(image, sensor, rng) for image in clean_images(scene, motion, paint)])
    force, grip = logged(scene, motion)
    noise = max(FORCE_NOISE * np.abs(motion.force).max(), 1e-6)
    moving = np.arange(len(scene.times)) > 0
    folder.mkdir(parents=True, exist_ok=True)
    write_loads(folder, scene.times, {
        "force_N": force + noise * rng.standard_normal(len(force)),
        "grip_mm": grip - grip[0] + GRIP_NOISE * rng.standard_normal(len(grip)) * moving})
    write_inp(model_mesh(scene.geometry), folder / "mesh.inp", "trial")
    (folder / "experiment.toml").write_text(toml_text(scene, sensor.total_noise_std, noise), encoding="utf-8")
    np.save(folder / IMAGES, images)
    return ArrayStack(images)


def toml_text(scene: Scene, noise_gv: float, force_noise: float) -> str:
    column, row = centre_px() + 0.3
    return TOML.format(thickness=THICKNESS_MM, pixel=PIXEL_MM, column=column, row=row, noise=noise_gv, grip=GRIP_NOISE,
                       material=NULLS[scene.null].table, force=force_noise)


def as_logged(scene: Scene, plain: Scene, motion: Motion) -> Scene:
    """The plain scene, driven by the log of `scene`: the simulation of the user's model at the true parameters."""
    _, grip = logged(scene, motion)
    return replace(plain, grip=grip - grip[0])
