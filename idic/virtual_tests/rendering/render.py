"""Virtual experiments: images of a deformed mesh by inversion of the mapping, with noise and quantisation.

A camera pixel sees the material point X with ``camera(X + u(X)) = pixel``: every sub-pixel sample is located in the
*deformed* mesh (Newton on the isoparametric mapping of the element it falls into), carried back to X, and takes the
analytic grey value painted there. No image is ever interpolated and nothing of `idic.correlation` or
`idic.images.interpolate` is used, so the correlator cannot inherit its own errors from these images.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from idic.errors import InputError
from idic.images import Camera
from idic.virtual_tests.rendering.inverse_mapping import carry, locate

STRIP_SAMPLES = 600_000  # samples held at a time: bounds the memory of a 4 Mpx frame to some 50 MB
BOX_MARGIN = 0.15  # a quad8 edge may bulge out of the box of its nodes


class CellsLike(Protocol):
    cell: str
    connectivity: np.ndarray


@dataclass(frozen=True)
class Sensor:
    """What turns light into numbers.

    Attributes
    ----------
    shape : (int, int)
        Rows and columns of the image.
    bits : int
        8, 12 or 16 (12 bit is stored in uint16); 0: float32 without quantisation.
    noise_std : float
        Standard deviation of the normal noise of one image, in grey values, before quantisation.
    background : float
        Grey value beside the specimen.
    supersampling : int
        Samples per pixel and direction: the pixel integrates over its whole area, so it aliases like a camera.
    """

    shape: tuple[int, int]
    bits: int = 8
    noise_std: float = 0.0
    background: float = 0.0
    supersampling: int = 3

    def __post_init__(self):
        if self.bits not in (0, 8, 12, 16):
            raise InputError("no such depth of grey values", key="bits", expected="8, 12, 16 or 0 (float32)",
                             found=self.bits, remedy="write one of these numbers")

    @property
    def total_noise_std(self) -> float:
        """Noise of a recorded image, rounding to whole grey values (variance 1/12) included."""
        return float(np.sqrt(self.noise_std**2 + (1.0 / 12.0 if self.bits else 0.0)))


Texture = Callable[[np.ndarray], np.ndarray]


class Painting(Protocol):
    """Grey values of a surface, such as `idic.images.pattern.Pattern`."""

    def value(self, points_px: np.ndarray) -> np.ndarray:
        """At points given in px of the unloaded surface.  (n, 2) → (n,)"""
        ...


def painted(pattern: Painting, camera: Camera) -> Texture:
    """The pattern as the camera sees it on the undeformed body.

    A material point X (n, 2|3) in mm takes the pattern's value at ``camera.project(X)``.
    """

    def texture(X: np.ndarray) -> np.ndarray:
        return pattern.value(camera.project(X))

    return texture


def render(
    displacements: Iterable[np.ndarray],
    nodes: np.ndarray,
    cells: Sequence[CellsLike],
    camera: Camera,
    texture: Texture,
    sensor: Sensor,
    rng: np.random.Generator,
    rise: float | None = None,
    threads: int = 1,
) -> Iterator[np.ndarray]:
    """Recorded images of a sequence of nodal displacements, in their order.

    Parameters
    ----------
    displacements : iterable of (n_nodes, dim) float, mm
        The motion of frame 0, 1, …
    nodes : (n_nodes, dim) float, mm
    cells : sequence of blocks with `cell` and `connectivity` (nel, nn)
        The surface that the camera sees, not folded over itself.
    texture : callable
        Grey value at material points (n, dim) in mm; see :func:`painted`.
    rise : float, optional
        The image is a height map: texture(X) + rise u_z(X), with `rise` in height units per mm (`View.rise`; u_z is
        the third column of the displacement); the background is NaN, as a profilometer has it.
    threads : int
        So many images are rendered at a time, that many displacements ahead; it changes no bit.

    Yields
    ------
    (ny, nx) uint8, uint16 or float32
    """
    waiting: deque[Future[np.ndarray]] = deque()
    with ThreadPoolExecutor(threads) as pool:
        for u in displacements:
            waiting.append(pool.submit(clean_image, u, nodes, cells, camera, texture, sensor, rise))
            if len(waiting) > threads:
                yield record(waiting.popleft().result(), sensor, rng)
        while waiting:
            yield record(waiting.popleft().result(), sensor, rng)


def clean_image(
    u: np.ndarray,
    nodes: np.ndarray,
    cells: Sequence[CellsLike],
    camera: Camera,
    texture: Texture,
    sensor: Sensor,
    rise: float | None = None,
) -> np.ndarray:
    """One image without noise or rounding  # (ny, nx) float64; arguments as in :func:`render`."""
    nodes = np.asarray(nodes, dtype=np.float64)
    u = np.asarray(u, dtype=np.float64)
    moved_px = camera.project(nodes + u)  # (n_nodes, 2)
    plane = camera.inverse(moved_px)  # (n_nodes, 2) mm in the plane of the mesh, where the elements are isoparametric
    carried = nodes if rise is None else np.hstack([nodes, rise * u[:, 2:3]])
    ny, nx = sensor.shape
    image = np.empty((ny, nx))
    n = sensor.supersampling
    rows = max(1, STRIP_SAMPLES // (nx * n * n))
    for first in range(0, ny, rows):
        end = min(ny, first + rows)
        samples = sample_grid(first, end, nx, n)  # ((last-first)*n * nx*n, 2) px
        material, inside = _material_points(samples, (first, end, nx, n), plane, moved_px, carried, cells, camera)
        value = np.full(len(samples), sensor.background if rise is None else np.nan)
        value[inside] = texture(material[:, : nodes.shape[1]])
        if rise is not None:
            value[inside] += material[:, -1]
        image[first:end] = value.reshape(end - first, n, nx, n).mean(axis=(1, 3))
    return image


def record(image: np.ndarray, sensor: Sensor, rng: np.random.Generator) -> np.ndarray:
    """Noise, clipping to the sensor's range and rounding  # (ny, nx) uint8 | uint16 | float32"""
    noisy = image + sensor.noise_std * rng.standard_normal(image.shape)
    if sensor.bits == 0:
        return noisy.astype(np.float32)
    kind = np.uint8 if sensor.bits == 8 else np.uint16
    return np.clip(np.rint(noisy), 0, 2**sensor.bits - 1).astype(kind)


def noisy_channel(values: np.ndarray, noise_std: float, rng: np.random.Generator) -> np.ndarray:
    """A logged channel with normal noise of standard deviation `noise_std`, one value per frame  # (n_frames,)"""
    values = np.asarray(values, dtype=np.float64)
    return values + noise_std * rng.standard_normal(values.shape)


def sample_grid(first: int, end: int, nx: int, n: int) -> np.ndarray:
    """Mid-points of the n x n sub-pixels, (column, row), row-major over the fine grid."""
    offset = (np.arange(n) + 0.5) / n - 0.5
    rows = (np.arange(first, end)[:, None] + offset).ravel()
    columns = (np.arange(nx)[:, None] + offset).ravel()
    return np.stack(np.broadcast_arrays(columns[None, :], rows[:, None]), axis=-1).reshape(-1, 2)


def _material_points(samples, grid, plane, moved_px, carried, cells, camera):
    """Carried nodal fields at the samples that see the specimen: (n_inside, m), and which samples those are."""
    first, end, nx, n = grid
    targets = _plane_of(samples, camera)  # (n_samples, 2) mm
    inside = np.zeros(len(samples), dtype=bool)
    out = np.empty((len(samples), carried.shape[1]))
    for block in cells:
        conn = np.ascontiguousarray(block.connectivity, dtype=np.int64)
        boxes = _boxes(moved_px[conn], first, end, nx, n)  # (nel, 4) fine-grid index ranges
        on_grid = (moved_px[conn] - np.array([0.0, float(first)]) + 0.5) * n - 0.5  # (nel, nn, 2)
        element, xi = locate(block.cell, plane, conn, boxes, on_grid, targets, nx * n, inside)
        hit = np.flatnonzero(element >= 0)
        out[hit] = carry(block.cell, carried, conn, element[hit], xi[hit])
        inside[hit] = True
    return out[inside], inside


def _plane_of(samples: np.ndarray, camera: Camera) -> np.ndarray:
    """Positions in the plane of the mesh that the samples look at; the affine camera in one product."""
    if camera.k1 or np.any(camera.tilt):
        return np.ascontiguousarray(camera.inverse(samples))
    origin = camera.inverse(np.zeros((1, 2)))
    return samples @ np.linalg.inv(camera.matrix).T + origin


def _boxes(corners_px: np.ndarray, first: int, end: int, nx: int, n: int) -> np.ndarray:
    """Ranges of the fine grid that an element may cover: (column from, to, row from, to), `to` exclusive."""
    low, high = corners_px.min(axis=1), corners_px.max(axis=1)
    margin = BOX_MARGIN * (high - low) + 1.0
    origin = np.array([0.0, float(first)])
    low = np.floor((low - margin - origin + 0.5) * n).astype(np.int64)
    high = np.ceil((high + margin - origin + 0.5) * n).astype(np.int64)
    limit = np.array([nx * n, (end - first) * n])
    low, high = np.clip(low, 0, limit), np.clip(high, 0, limit)
    return np.ascontiguousarray(np.stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]], axis=1))
