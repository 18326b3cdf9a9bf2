"""A field seen by a camera, onto the nodes: temperatures of infrared images, least squares over the pixels.

At samples x_s of the mesh, ``min sum_s (N(x_s) T - T_s)² + lambda ∫ |grad T|² dV``, lambda = n_samples l²/V. The second
term decides where no sample does (nodes out of view, the rim): steady conduction from where there are some, insulated
at the edges. With l = 0.1 px it takes 0.1 % off a wave of 20 px and l |grad T| off the end of a slope. The samples are
the pixels; where an element is less than three pixels wide (an infrared camera is often coarser than the mesh) they are
finer, with values interpolated linearly between pixels. Pixels without a value (NaN) and a rim along the edges of the
body, where a pixel shows the background too, are left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from idic.correlation.pixels.pixel_map import PixelMap
from idic.errors import InputError
from idic.fe import Block, Mesh, conductance, volume
from idic.images import Camera

MAX_MOTION_PX = 0.25  # of the nodes; after more, the pixel map is made again
N_CHECKED_NODES = 100  # at which the noise of the result is computed
SAMPLES_PER_EDGE = 3  # of an element; a quadratic element needs as many
MAX_SAMPLES_PER_PIXEL = 16  # per direction


@dataclass(frozen=True)
class NodalField:
    """values : (n_frames, n_nodes); n_pixels that took part in the first frame; visible : (n_nodes,) bool, nodes of
    elements with samples; noise : standard deviation of a visible nodal value per standard deviation of a pixel;
    steepest : largest step of the change since the first frame, per px."""

    values: np.ndarray
    n_pixels: int
    visible: np.ndarray
    noise: float
    steepest: float


@dataclass(frozen=True)
class _Samples:
    """rows, columns (n,) on the grid with `finer` samples per pixel; shape (n, n_nodes); from_pixels (n, ny nx)."""

    rows: np.ndarray
    columns: np.ndarray
    finer: int
    shape: sparse.csr_array
    from_pixels: sparse.csr_array


@dataclass(frozen=True)
class _Fit:
    """The normal equations of some samples: which (n,) bool, data (n_nodes, ny nx) such that A T = data @ pixels."""

    used: np.ndarray
    data: sparse.csr_array
    normal: SuperLU


def onto_nodes(mesh: Mesh, cells: Sequence[Block], camera: Camera, images: Iterable[np.ndarray],
               motion: np.ndarray | None = None, smoothing_px: float = 0.1, margin_px: int = 1) -> NodalField:
    """Nodal values of a field that a camera saw.

    Parameters
    ----------
    cells : the surface that the camera sees (`Mesh.surface_cells`)
    images : (ny, nx) float each, one per frame
    motion : (n_frames, n_nodes, dim) mm, optional
        Where the nodes were when the images were taken; None: at rest.
    smoothing_px : l above
    margin_px : rim along the edges of the body that is left out

    Raises
    ------
    InputError
        The body is not in the image, nothing is left of it, or a frame has no pixel with a value.
    """
    base = smoothing_px**2 * camera.pixel_size**2 / volume(mesh) * conductance(mesh)
    samples_px, samples, fit, solutions, first = None, None, None, [], None
    for k, image in enumerate(images):
        nodes = mesh.nodes if motion is None else mesh.nodes + motion[k]
        nodes_px = camera.project(nodes)
        if samples_px is None or np.abs(nodes_px - samples_px).max() > MAX_MOTION_PX:
            samples_px, samples, fit = nodes_px, _samples(nodes, cells, camera, image.shape, margin_px), None
        pixels = np.asarray(image, dtype=float).ravel()
        lost = ~np.isfinite(pixels)
        used = samples.from_pixels @ lost == 0.0
        if not used.any():
            raise InputError("no pixel of the body has a value", expected="some finite pixels in every frame",
                             found=f"none in frame {k}", remedy="repair or replace the image")
        if fit is None or not np.array_equal(used, fit.used):
            fit = _fit(samples, used, base)
        solutions.append(fit.normal.solve(fit.data @ np.where(lost, 0.0, pixels)))
        first = fit if first is None else first
    values = np.array(solutions)
    weights = abs(first.data)
    visible = np.asarray(weights.sum(axis=1)).ravel() > 0
    n_pixels = int((np.asarray(weights.sum(axis=0)).ravel() > 0).sum())
    return NodalField(values, n_pixels, visible, _noise(first, np.flatnonzero(visible)), _steepest(samples, values))


def _samples(nodes, cells, camera: Camera, shape, margin: int) -> _Samples:
    """The samples inside the body, its rim left out."""
    pixel_map = PixelMap.of(nodes, cells, camera, shape)
    edge = np.sqrt(pixel_map.n_pixels / sum(len(block.connectivity) for block in cells))
    finer = int(np.clip(np.ceil(SAMPLES_PER_EDGE / edge), 1, MAX_SAMPLES_PER_PIXEL))
    if finer > 1:
        enlarged = replace(camera, matrix=finer * camera.matrix, origin_px=finer * camera.origin_px,
                           k1=camera.k1 / finer**2, centre_px=finer * camera.centre_px,
                           shift_px=finer * camera.shift_px)
        pixel_map = PixelMap.of(nodes, cells, enlarged, tuple(finer * (n - 1) + 1 for n in shape))
    body = np.isfinite(pixel_map.to_image(np.zeros(pixel_map.n_pixels)))
    rim = finer * (margin + (finer > 1)) if margin else 0  # between pixels a sample takes from its neighbours, too
    inner = scipy.ndimage.binary_erosion(body, np.ones((3, 3), bool), iterations=rim, border_value=1) if rim else body
    keep = inner[pixel_map.iy, pixel_map.ix]
    if not keep.any():
        raise InputError("nothing is left of the body without its rim", key="edge_margin_px",
                         expected="a body wider than twice the margin", found=f"{margin} px",
                         remedy="give a smaller edge_margin_px")
    rows, columns = pixel_map.iy[keep], pixel_map.ix[keep]
    return _Samples(rows, columns, finer, pixel_map.shape_matrix()[keep], _linear(rows, columns, finer, shape))


def _linear(rows, columns, finer: int, shape) -> sparse.csr_array:
    """Linear interpolation between pixels, at samples of a grid `finer` times as fine  # (n, ny nx)"""
    (i, s), (j, t) = (np.divmod(index, finer) for index in (rows.astype(np.int64), columns.astype(np.int64)))
    s, t, n = s / finer, t / finer, np.arange(len(rows))
    parts = [(i + a, j + b, (s if a else 1 - s) * (t if b else 1 - t)) for a in (0, 1) for b in (0, 1)]
    row, column, weight = (np.concatenate([part[k] for part in parts]) for k in range(3))
    of = np.tile(n, 4)
    used = weight > 0
    return sparse.csr_array((weight[used], (of[used], (row * shape[1] + column)[used])),
                            shape=(len(rows), shape[0] * shape[1]))


def _fit(samples: _Samples, used: np.ndarray, base: sparse.csr_array) -> _Fit:
    shape = samples.shape[used]
    normal = (shape.T @ shape + shape.shape[0] * base).tocsc()
    lonely = np.flatnonzero(normal.diagonal() == 0)  # nodes of no element
    normal = normal + sparse.csc_array((np.ones(len(lonely)), (lonely, lonely)), shape=normal.shape)
    return _Fit(used, (shape.T @ samples.from_pixels[used]).tocsr(), splu(normal.tocsc()))


def _noise(fit: _Fit, nodes: np.ndarray) -> float:
    """rms over some nodes of |data' A^-1 e_i|: the std of a nodal value from unit noise of the pixels."""
    chosen = nodes[np.linspace(0, len(nodes) - 1, min(N_CHECKED_NODES, len(nodes))).astype(int)]
    unit = np.zeros((fit.data.shape[0], len(chosen)))
    unit[chosen, np.arange(len(chosen))] = 1.0
    return float(np.sqrt(np.mean(((fit.data.T @ fit.normal.solve(unit)) ** 2).sum(axis=0))))


def _steepest(samples: _Samples, values: np.ndarray) -> float:
    """Largest slope of the change since the first frame along rows and columns, per px."""
    image = np.full((samples.rows.max() + 1, samples.columns.max() + 1), np.nan)
    largest = 0.0
    for field in values - values[0]:
        image[samples.rows, samples.columns] = samples.shape @ field
        steps = [np.abs(np.diff(image, axis=axis)) for axis in (0, 1)]
        largest = max(largest, *(float(step[np.isfinite(step)].max(initial=0.0)) for step in steps))
    return samples.finer * largest
