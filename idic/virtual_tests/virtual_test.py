"""A virtual test before noise: true motion, channels, camera and the files of the user; its images on demand."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from string import Template
from typing import Any, TypeVar

import numpy as np

from idic.fe import Block, Mesh
from idic.images import Camera, Pattern, dense_speckle
from idic.identification import DOT_SIGMA_PER_SPECKLE
from idic.virtual_tests.experiment_files import write_loads, write_truth
from idic.virtual_tests.meshes import write_inp
from idic.virtual_tests.rendering.render import Sensor, Texture, clean_image, painted
from idic.virtual_tests.solid_speckle import SolidSpeckle

GREY_LEVELS = 256.0  # grey values of 8 bits; other sensors are steps of another size on the same scale
CONTRAST_SAMPLES = 20_000  # pixels: a standard deviation to 1 %
DEFAULT_NOISE_SHARE = 0.04  # of the standard deviation of f: about 2 grey values of 8 bit, a decent camera

PatternLike = TypeVar("PatternLike", Pattern, SolidSpeckle)


@dataclass(frozen=True)
class LoggedColumn:
    """A column of loads.csv: true values (n_frames,) and the standard deviation of its measurement.

    exact_without_noise : no noise is added where the images get none; `noise_std` is then the weight only.
    """

    column: str
    values: Any
    noise_std: float
    exact_without_noise: bool = False

    def added_std(self, image_noise: float) -> float:
        """Standard deviation of the noise that is added where the images have this noise."""
        return 0.0 if self.exact_without_noise and image_noise == 0.0 else self.noise_std


@dataclass(frozen=True)
class VirtualTest:
    """An example before noise.

    Attributes
    ----------
    nodes, cells : (n_nodes, dim) mm, sequence of blocks
        The true surface that the camera sees.
    displacements : (n_frames, n_nodes, dim) mm
        Its true motion.
    texture : callable (rng, levels) -> Texture
        Speckle over grey values 0 … levels.
    background : float
        Grey value beside the specimen as a part of the levels.
    mesh : Mesh
        The user's mesh; another one than the truth's unless `notes` say otherwise.
    toml : str
        experiment.toml with ``$noise_std_gv`` left to be filled in.
    truth : mapping
        Names of experiment.toml to values in the units of the file.
    default_noise : float
        Standard deviation of the camera noise / that of f on the specimen where the user asks for none in particular.
    supersampling : int
        Samples per pixel and direction, see `Sensor`: 1 takes the pattern's value at the middle of the pixel.
    notes : mapping
        Further entries of truth.json.
    """

    title: str
    nodes: np.ndarray
    cells: Sequence[Block]
    displacements: Any
    times: np.ndarray
    columns: tuple[LoggedColumn, ...]
    camera: Camera
    shape: tuple[int, int]
    texture: Callable[[np.random.Generator, float], Texture]
    background: float
    mesh: Mesh
    toml: str
    truth: Mapping[str, float]
    default_noise: float = DEFAULT_NOISE_SHARE
    supersampling: int = 3
    notes: Mapping[str, Any] = field(default_factory=dict)


def medium_speckle(camera: Camera, shape: tuple[int, int]) -> Callable[[np.random.Generator, float], Texture]:
    """Dense speckle of about 4 px on 8 … 92 % of the levels, as seen by `camera` on the undeformed body.

    Finer speckle would carry more information, but a spline's interpolation error on it (some 1e-3 px) would
    then be larger than the standard deviations of this much averaging.
    """

    def make(rng: np.random.Generator, levels: float) -> Texture:
        pattern = dense_speckle(rng, sigma_px=1.6, low=0.08 * levels, high=0.92 * levels, extent_px=1.2 * max(shape))
        return painted(pattern, camera)

    return make


def stated_speckle(camera: Camera, shape: tuple[int, int], size_px: float,
                   contrast_gv: float) -> Callable[[np.random.Generator, float], Texture]:
    """Dense speckle as `idic design` assumes it: of this size, and of this standard deviation in 8 bit."""

    def make(rng: np.random.Generator, levels: float) -> Texture:
        pattern = dense_speckle(rng, DOT_SIGMA_PER_SPECKLE * size_px, extent_px=1.2 * max(shape))
        return painted(with_contrast(pattern, contrast_gv * levels / GREY_LEVELS, 0.5 * levels, 1.0,
                                     np.full(2, pattern.period_px)), camera)

    return make


def with_contrast(pattern: PatternLike, std: float, mean: float, pixel: float, period: np.ndarray) -> PatternLike:
    """The pattern with this mean and standard deviation of its pixels; period : (2,) or (3,) in the unit of `pixel`"""
    places = np.random.default_rng(0).uniform(0.0, period, (CONTRAST_SAMPLES, 1, len(period)))
    inside = np.zeros((9, len(period)))
    inside[:, :2] = pixel / 3 * np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), axis=-1).reshape(-1, 2)
    points = places + inside
    grey = replace(pattern, low=-0.5, high=0.5).value(points.reshape(-1, len(period)))
    grey = grey.reshape(CONTRAST_SAMPLES, -1).mean(axis=1)  # of the area of a pixel
    width = std / float(grey.std())
    low = mean - width * (0.5 + float(grey.mean()))
    return replace(pattern, low=low, high=low + width)


def rough_surface(camera: Camera, shape: tuple[int, int], rms: float) -> Callable[[np.random.Generator], Texture]:
    """Heights of a rough surface of this standard deviation, correlated over some 5 px, as seen by `camera`.

    Smoother than a speckle: a profilometer's images are not blurred against aliasing.
    """

    def make(rng: np.random.Generator) -> Texture:
        pattern = dense_speckle(rng, sigma_px=3.0, low=-1.0, high=1.0, extent_px=1.2 * max(shape))
        sample = pattern.value(rng.uniform(0.0, pattern.period_px, (20000, 2)))
        return painted(replace(pattern, low=-rms / sample.std(), high=rms / sample.std()), camera)

    return make


@dataclass(frozen=True, eq=False)
class RenderedStack:
    """The images of a virtual test before noise and rounding, on the scale of 8 bits."""

    test: VirtualTest
    texture: Texture
    sensor: Sensor

    @property
    def n_frames(self) -> int:
        return len(self.test.times)

    @property
    def shape(self) -> tuple[int, int]:
        return self.test.shape

    def frame(self, k: int) -> np.ndarray:
        """Frame `k`  # (ny, nx) float32"""
        test = self.test
        image = clean_image(test.displacements[k], test.nodes, test.cells, test.camera, self.texture, self.sensor)
        return image.astype(np.float32)


def write_virtual_model(folder: Path, test: VirtualTest, seed: int = 0, floor_gv: float = 0.0) -> RenderedStack:
    """Write an experiment folder without noise and without image files; returns the images as a stack.

    Parameters
    ----------
    seed : of the speckle, as in `idic.virtual_tests.examples.write_example`
    floor_gv : noise stated in the files, in grey values: the error of the interpolating spline
    """
    speckle_rng = np.random.default_rng(seed).spawn(3)[0]
    write_loads(folder, test.times, {column.column: column.values for column in test.columns})
    write_inp(test.mesh, folder / "mesh.inp", test.title)
    (folder / "experiment.toml").write_text(
        Template(test.toml).substitute(noise_std_gv=f"{floor_gv:.4g}"), encoding="utf-8"
    )
    write_truth(folder, test.truth, floor_gv, seed=seed, **test.notes)
    sensor = Sensor(test.shape, bits=0, background=test.background * GREY_LEVELS, supersampling=test.supersampling)
    return RenderedStack(test, test.texture(speckle_rng, GREY_LEVELS), sensor)
