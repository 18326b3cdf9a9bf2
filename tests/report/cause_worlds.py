"""Recordings of a pulled strip with one thing wrong each, rendered from a fine canvas by scipy's splines: no part of
the correlator makes them.

The strip is 20 mm x 8 mm, its left end held, its right end pulled; motion of a point x, y (mm, from the middle of the
left end): u_x = e x, u_y = -nu e y. Pixel 0.1 mm, image 250 x 120 px, the strip in its middle.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import tifffile
from scipy.ndimage import gaussian_filter, map_coordinates

PIXEL_MM, SHAPE, LENGTH_MM, HEIGHT_MM, E_MPA, NU, THICKNESS_MM = 0.1, (120, 250), 20.0, 8.0, 70e3, 0.3, 2.0
ORIGIN_PX = np.array([25.0, 60.0])  # of the middle of the left end
FINER = 3  # pixels of the canvas per pixel
NOISE_GV, BACKGROUND_GV = 1.5, 25.0

TOML = """
[experiment]
title = "strip"
images = "images/*.tif"
loads = "loads.csv"
mesh = {{ roi_mm = [0.0, -4.0, 20.0, 4.0], element_mm = 2.0 }}
kind = "plane_stress"
thickness_mm = 2.0
[camera]
pixel_size_mm = {pixel}
origin_px = {origin}
axes = {axes}
noise_std_gv = 1.5
[material.SPECIMEN]
law = "elastic"
E = {{ value = 68e3, unit = "MPa", identify = true }}
nu = {{ value = 0.31, identify = true }}
[[boundary]]
nodes = "{held}"
ux = 0.0
uy = 0.0
[[boundary]]
nodes = "{pulled}"
ux = {{ column = "grip_mm" }}
uy = 0.0
[[channel]]
column = "force_N"
simulated = {{ reaction = "{pulled}", component = "x" }}
noise_std = 5.0
"""


@dataclass(frozen=True)
class World:
    """A recording of the strip.

    strain : (n,) of the frames, the reference first; rigid : (n, 3) columns, rows (px), turn (degrees) of the picture
    """

    strain: np.ndarray = field(default_factory=lambda: np.linspace(0.0, 0.012, 12))
    rigid: np.ndarray | None = None
    force: np.ndarray | None = None  # N, None: elastic
    grip: np.ndarray | None = None  # mm, None: as the right end moves
    gap_mm: np.ndarray | None = None  # (n,) the part right of the middle has moved off by
    light: np.ndarray | None = None  # (n,) factor of the grey values
    order: Sequence[int] | None = None  # image at every place of the recording
    ends: tuple[str, str] = ("LEFT", "RIGHT")  # held and pulled in the model
    axes: str = '["+col", "-row"]'
    pixel: float = PIXEL_MM
    origin: tuple[float, float] = (25.0, 60.0)

    def write(self, folder: Path) -> Path:
        """The experiment folder."""
        n = len(self.strain)
        (folder / "images").mkdir(parents=True)
        images = [self.image(k) for k in range(n)]
        for place, k in enumerate(self.order if self.order is not None else range(n)):
            tifffile.imwrite(folder / "images" / f"frame_{place:03d}.tif", images[k])
        force = E_MPA * HEIGHT_MM * THICKNESS_MM * self.strain if self.force is None else self.force
        force = force + np.random.default_rng(8).normal(0.0, 5.0, n)
        grip = LENGTH_MM * self.strain if self.grip is None else self.grip
        rows = [f"{k},{k}.0,{force[k]:.3f},{grip[k]:.6f}" for k in range(n)]
        (folder / "loads.csv").write_text("frame,time_s,force_N,grip_mm\n" + "\n".join(rows) + "\n")
        (folder / "experiment.toml").write_text(TOML.format(
            pixel=self.pixel, origin=list(self.origin), axes=self.axes, held=self.ends[0], pulled=self.ends[1]))
        return folder

    def image(self, k: int) -> np.ndarray:
        """What the camera sees in frame k  # (ny, nx) uint8"""
        rows, columns = np.mgrid[:SHAPE[0], :SHAPE[1]].astype(float)
        at = np.stack([columns, rows], axis=-1)
        if self.rigid is not None:
            at = _unmoved(at, self.rigid[k])
        x, y = PIXEL_MM * (at[..., 0] - ORIGIN_PX[0]), -PIXEL_MM * (at[..., 1] - ORIGIN_PX[1])
        strain, gap = self.strain[k], 0.0 if self.gap_mm is None else self.gap_mm[k]
        middle = 0.5 * LENGTH_MM * (1.0 + strain)
        is_open = (x > middle) & (x < middle + gap)
        x = np.where(x > middle, x - gap, x) / (1.0 + strain)
        y = y / (1.0 - NU * strain)
        inside = (x > 0.0) & (x < LENGTH_MM) & (np.abs(y) < 0.5 * HEIGHT_MM) & ~is_open
        column, row = ORIGIN_PX[0] + x / PIXEL_MM, ORIGIN_PX[1] - y / PIXEL_MM
        grey = map_coordinates(CANVAS, [FINER * row, FINER * column], order=3, mode="nearest")
        image = np.where(inside, grey, BACKGROUND_GV) * (1.0 if self.light is None else self.light[k])
        noise = np.random.default_rng(100 + k).normal(0.0, NOISE_GV, SHAPE)
        return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)


def _canvas() -> np.ndarray:
    values = np.random.default_rng(3).normal(size=(FINER * SHAPE[0], FINER * SHAPE[1]))
    values = gaussian_filter(values, 1.6 * FINER)
    return np.clip(128.0 + 45.0 * values / values.std(), 30.0, 235.0)


def _unmoved(at: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Where a place of the picture was before a rigid motion about the middle of the strip."""
    middle = ORIGIN_PX + [0.5 * LENGTH_MM / PIXEL_MM, 0.0]
    angle = np.radians(motion[2])
    moved = at - middle - motion[:2]
    return middle + moved @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


CANVAS = _canvas()
N = 12
RAMP = np.linspace(0.0, 0.012, N)
TIMES = np.arange(N) / (N - 1)
FORCE = E_MPA * HEIGHT_MM * THICKNESS_MM * RAMP


def after(first: int, value: Sequence[float], n: int = N) -> np.ndarray:
    """A rigid motion from a frame on  # (n, 3)"""
    return np.outer(np.arange(n) >= first, value)


def broken(first: int, gap_mm: float = 0.8, rest: float = 0.0) -> World:
    """Broken in the middle from a frame on; rest : share of the strain that stays, 0 where it springs back."""
    is_after = np.arange(N) >= first
    return World(strain=np.where(is_after, rest * RAMP, RAMP), force=np.where(is_after, 0.0, FORCE),
                 grip=LENGTH_MM * RAMP, gap_mm=np.where(is_after, gap_mm + 0.02 * np.arange(N), 0.0))


def walk(size: float) -> np.ndarray:
    """Rigid motions without a course  # (N, 3)"""
    motions = np.random.default_rng(2).normal(0.0, [size, size, 0.1 * size], (N, 3))
    motions[0] = 0.0
    return motions


def plastic(strain: np.ndarray) -> np.ndarray:
    return E_MPA * HEIGHT_MM * THICKNESS_MM * np.minimum(strain, 0.004 + 0.1 * (strain - 0.004))


CYCLE = np.array([0, 2, 4, 6, 8, 6, 4, 2, 0, 3, 6, 9]) * 1e-3
LONG = np.linspace(0.0, 0.012, 40)

SOUND: dict[str, Callable[[], World]] = {
    "tension": World,
    "compression": lambda: World(strain=-RAMP),
    "yield": lambda: World(force=plastic(RAMP)),
    "cycles that end under load": lambda: World(strain=CYCLE),
    "cycles that end without load": lambda: World(strain=CYCLE[:9]),
    "unloaded at once": lambda: World(strain=np.append(RAMP, 0.0)),
    "a machine that yields": lambda: World(grip=1.6 * LENGTH_MM * RAMP),
    "a camera that shakes a little": lambda: World(rigid=walk(0.15)),
    "play in the grips": lambda: World(grip=LENGTH_MM * RAMP + 0.03 * (np.arange(N) > 0)),
    "40 frames": lambda: World(strain=LONG),
}
WRONG: dict[str, tuple[Callable[[], World], str]] = {
    "jump, shifted": (lambda: World(rigid=after(1, (2.0, -1.0, 0.0))), "right after the reference image and stays"),
    "jump, turned": (lambda: World(rigid=after(1, (0.0, 0.0, -1.2))), "right after the reference image and stays"),
    "jump of 40 frames": (lambda: World(LONG, after(1, (1.5, 2.5, 0.4), 40)), "right after the reference image"),
    "jump in the middle": (lambda: World(rigid=after(6, (2.5, 1.5, 0.3))),
                           "between frame_005.tif and frame_006.tif the specimen moves as a rigid body"),
    "jump in one frame": (lambda: World(rigid=after(5, (0.0, 4.0, 0.0)) - after(6, (0.0, 4.0, 0.0))),
                          "frame_005.tif alone is moved"),
    "drift": (lambda: World(strain=CYCLE, rigid=np.outer(TIMES, (4.0, -3.0, 0.6))), "drift as a rigid body in pro"),
    "yielding frame": (lambda: World(strain=CYCLE, rigid=np.outer(CYCLE / CYCLE.max(), (3.0, 2.0, 0.0))),
                       "in proportion to the load"),
    "rigid walk": (lambda: World(rigid=walk(3.0)), "from image to image, by up to"),
    "broken late": (lambda: broken(9), "at frame_009.tif and stays low: the specimen is broken, its parts move apart"),
    "broken early": (lambda: broken(4), "at frame_004.tif and stays low: the specimen is broken"),
    "broken in the last frame": (lambda: broken(11), 'exclude_frames = ["frame_011.tif"]'),
    "load cell fails": (lambda: World(force=np.where(np.arange(N) >= 8, 0.0, FORCE)), "load cell or its cable has"),
    "broken out of view": (lambda: World(strain=np.where(np.arange(N) >= 9, 0.0, RAMP), grip=LENGTH_MM * RAMP),
                           "springs back in one piece"),
    "out of the image": (lambda: World(rigid=np.outer(np.maximum(np.arange(N) - 6, 0) / 5.0, (0.0, 95.0, 0.0))),
                         "exclude_frames = "),
    "light fails": (lambda: World(light=np.where(np.arange(N) >= 9, 0.02, 1.0)),
                    'exclude_frames = ["frame_009.tif", "frame_010.tif", "frame_011.tif"]'),
    "light flickers": (lambda: World(light=np.where(np.arange(N) == 4, 0.5, 1.0)), '_frames = ["frame_004.tif"]'),
    "mirrored along columns": (lambda: World(axes='["-col", "-row"]', origin=(225.0, 60.0)),
                               'an axis is mirrored'),
    "turned by 180 degrees": (lambda: World(axes='["-col", "+row"]', origin=(225.0, 60.0)), "ends are exchanged"),
    "mirrored out of the image": (lambda: World(axes='["-col", "-row"]'), "an axis is mirrored"),
    "turned by 90 degrees": (lambda: World(axes='["-row", "-col"]', origin=(45.0, 60.0)), "axes"),
    "pixel ten times too large": (lambda: World(pixel=1.0), "pixel_size_mm may be too large"),
    "pixel ten times too small": (lambda: World(pixel=0.01), "pixel_size_mm"),
    "log in another unit": (lambda: World(grip=10.0 * LENGTH_MM * RAMP), "the unit of grip_mm may be wrong"),
    "log in a larger unit": (lambda: World(grip=0.1 * LENGTH_MM * RAMP), "times that of grip_mm"),
    "log of another sign": (lambda: World(grip=-LENGTH_MM * RAMP), "the sign of grip_mm or of an entry of axes is wr"),
    "compression logged as positive": (lambda: World(strain=-RAMP, grip=LENGTH_MM * RAMP, force=FORCE),
                                       "force_N then has the other sign, too: factor = -1"),
    "force of another sign": (lambda: World(force=-FORCE), "reverses the sign of the force"),
    "force of another sign, compression": (lambda: World(strain=-RAMP, force=FORCE), "reverses the sign of the force"),
    "force of another sign, broken": (lambda: replace(broken(8), force=np.where(np.arange(N) >= 8, 0.0, -FORCE)),
                                      "reverses the sign of the force"),
    "reversed": (lambda: World(order=[0, *range(N - 1, 0, -1)]), "contradicts the order of their names"),
    "sorted as text": (lambda: World(order=[0, 1, 10, 11, 2, 3, 4, 5, 6, 7, 8, 9]),
                       "contradicts the order of their names"),
}
