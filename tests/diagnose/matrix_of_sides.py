"""The effects of the boundary, force, camera and body sides whose confusion matrix is measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
from side_twins import GRIP, LENGTH, RADIUS, SHAPE, TIMES, Side

from idic.images import Camera

AFTER = np.maximum(TIMES - 4.0, 0.0) / (TIMES[-1] - 4.0)  # a slip that begins at 4 s
LOAD = GRIP / GRIP.max()
WAY = np.where(TIMES == 0.0, 0.0, np.where(TIMES <= 8.0, 1.0, -1.0))  # of the grip: up, hold, down
FRICTION, SEATING, CURVATURE = 3.0, 0.006, 0.06  # N, mm, of the largest force
DISTANCE, BULGE = 500.0, 0.5  # mm, of the camera; out of the plane under the largest load


def _both(mean, slope=None):
    return np.column_stack([mean, np.zeros(len(TIMES)) if slope is None else slope])


def _scaled(camera, factor):
    """A camera nearer by this factor, about the middle of the image."""
    centre = np.array([(SHAPE[1] - 1) / 2, (SHAPE[0] - 1) / 2])
    return replace(camera, matrix=factor * camera.matrix, origin_px=centre + factor * (camera.origin_px - centre))


def _turned(camera, degrees):
    """A camera turned about the middle of the image."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn, centre = np.array([[c, s], [-s, c]]), np.array([(SHAPE[1] - 1) / 2, (SHAPE[0] - 1) / 2])
    return replace(camera, matrix=turn @ camera.matrix, origin_px=centre + turn @ (camera.origin_px - centre))


def _settled(F):
    """Grips that settle under the first load."""
    return SEATING * (1.0 - np.exp(-np.abs(F) / (0.15 * np.abs(F).max())))


@dataclass(frozen=True, eq=False)
class Pinhole(Camera):
    """A central projection from `DISTANCE` of a sheet that is `height` above its plane: (n, 2) mm -> (n,) mm."""

    height: Callable | None = None

    def project(self, points):
        arms = super().project(points) - self.centre_px
        return self.centre_px + arms * (DISTANCE / (DISTANCE - self.height(points)))[:, None]


def _raised(height):
    """A sheet that rises with the load: (n,) mm along x -> (n,) share of `BULGE`."""
    return lambda camera, k: Pinhole(**{entry.name: getattr(camera, entry.name) for entry in fields(Camera)},
                                     height=lambda X: BULGE * LOAD[k] * height(X[:, 0]))


def shaken(camera, frame):
    shifts = 0.05 * np.random.default_rng(5).standard_normal((len(TIMES), 2)) * (TIMES > 0)[:, None]
    return replace(camera, origin_px=camera.origin_px + shifts[frame])


def _lit(image, frame):
    """A lamp whose light moves across: gain with a slope that grows in time."""
    x = (np.arange(SHAPE[1]) - SHAPE[1] / 2) / SHAPE[1]
    return image * (1.0 + 0.06 * TIMES[frame] / TIMES[-1] * x)


def _blurred(image, frame):
    """A Gaussian blur of exactly this variance (px²), which rises evenly in time."""
    variance = 0.1 * TIMES[frame] / TIMES[-1]
    frequency = [2.0 * np.pi * np.fft.fftfreq(n) for n in image.shape]
    passed = np.exp(-0.5 * variance * (frequency[0][:, None] ** 2 + frequency[1] ** 2))
    return np.fft.ifft2(np.fft.fft2(image) * passed).real


def _inclusion(centre, radius, factor):
    return lambda X: np.where(np.linalg.norm(X - centre, axis=1) < radius, factor, 1.0)


SIDES = {
    "clean": Side(),
    "force_scale": Side(force=lambda F: 1.03 * F),
    "force_offset": Side(force=lambda F: F + 1.5),
    "force_drift": Side(force=lambda F: F + 0.3 * TIMES),
    "friction": Side(force=lambda F: F + FRICTION * WAY),
    "load_cell_curvature": Side(force=lambda F: F * (1.0 + CURVATURE * F / np.abs(F).max())),
    "thickness": Side(force=lambda F: 1.03 * F),
    "frame_time_offset": Side(log_late=0.06),
    "grip_slip": Side(motion={("RIGHT", "x"): _both(-0.006 * AFTER)}),
    "grip_rotation": Side(motion={("RIGHT", "x"): _both(0.0 * TIMES, -0.0015 * LOAD)}),
    "machine_compliance": Side(compliance=3e-5),
    "seating": Side(toe=_settled),
    "hole_geometry": Side(radius=1.03 * RADIUS),
    "pixel_size": Side(camera=lambda camera, k: _scaled(camera, 1.02)),
    "camera_rotation": Side(camera=lambda camera, k: _turned(camera, 0.5)),
    "origin": Side(camera=lambda camera, k: replace(camera, origin_px=camera.origin_px + np.array([0.8, -0.6]))),
    "parallax": Side(camera=lambda camera, k: replace(camera, tilt=np.array([0.004, 0.0]))),
    "lens_distortion": Side(camera=lambda camera, k: replace(camera, k1=2e-6)),
    "magnification": Side(camera=lambda camera, k: _scaled(camera, 1.0 + 4e-4 * TIMES[k] / TIMES[-1])),
    "sheet_bending": Side(camera=_raised(lambda x: np.cos(np.pi * x / LENGTH))),
    "specimen_motion": Side(camera=_raised(lambda x: 2.0 * x / LENGTH)),
    "camera_motion": Side(camera=shaken),
    "illumination": Side(image=_lit),
    "defocus": Side(image=_blurred),
    "heterogeneity": Side(modulus=_inclusion((2.5, 1.0), 1.2, 0.7)),
}
