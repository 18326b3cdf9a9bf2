"""A built-in example before noise: the true motion and channels, the camera, and what the user gets."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idic.fe.mesh import Block, Mesh
from idic.images.camera import Camera
from idic.images.pattern import dense_speckle
from idic.virtual import Texture, painted


@dataclass(frozen=True)
class LoggedColumn:
    """A column of loads.csv: true values (n_frames,) and the standard deviation of its measurement."""

    column: str
    values: np.ndarray
    noise_std: float


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
        The user's mesh, another one than the truth's.
    toml : str
        experiment.toml with ``$noise_std_gv`` left to be filled in.
    truth : mapping
        The contract's names to values in the units of the file.
    """

    title: str
    nodes: np.ndarray
    cells: Sequence[Block]
    displacements: np.ndarray
    times: np.ndarray
    columns: tuple[LoggedColumn, ...]
    camera: Camera
    shape: tuple[int, int]
    texture: Callable[[np.random.Generator, float], Texture]
    background: float
    mesh: Mesh
    toml: str
    truth: Mapping[str, float]


def medium_speckle(camera: Camera, shape: tuple[int, int]) -> Callable[[np.random.Generator, float], Texture]:
    """Dense speckle of about 4 px on 8 … 92 % of the levels, as seen by `camera` on the undeformed body.

    Finer speckle would carry more information, but a spline's interpolation error on it (some 1e-3 px) would
    then be larger than the standard deviations of this much averaging.
    """

    def make(rng: np.random.Generator, levels: float) -> Texture:
        pattern = dense_speckle(rng, sigma_px=1.6, low=0.08 * levels, high=0.92 * levels, extent_px=1.2 * max(shape))
        return painted(pattern, camera)

    return make


def rough_surface(camera: Camera, shape: tuple[int, int], rms: float) -> Callable[[np.random.Generator], Texture]:
    """Heights of a rough surface of this standard deviation, correlated over some 5 px, as seen by `camera`.

    Smoother than a speckle: a profilometer's images are not blurred against aliasing.
    """

    def make(rng: np.random.Generator) -> Texture:
        pattern = dense_speckle(rng, sigma_px=3.0, low=-1.0, high=1.0, extent_px=1.2 * max(shape))
        sample = pattern.value(rng.uniform(0.0, pattern.period_px, (20000, 2)))
        return painted(replace(pattern, low=-rms / sample.std(), high=rms / sample.std()), camera)

    return make
