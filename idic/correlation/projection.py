"""A field seen by a camera, onto the nodes: temperatures of infrared images, least squares over the pixels.

At the pixels x_p of the mesh, ``min sum_p (N(x_p) T - T_p)² + lambda ∫ |grad T|² dV``, lambda = n_pixels l²/V. The second
term decides where no pixel does (nodes out of view, elements smaller than a pixel): steady conduction from where there
are pixels. With l = 0.2 px it takes 0.4 % off a wave of 20 px. Pixels without a value (NaN) and a rim along the edges
of the body, where a pixel sees the background too, are left out. Noise averages over the pixels of a node.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.ndimage import binary_erosion
from scipy.sparse.linalg import SuperLU, splu

from idic.correlation.pixel_map import build_pixel_map
from idic.errors import InputError
from idic.fe.conduction import conductance, volume
from idic.fe.mesh import Block, Mesh
from idic.images.camera import Camera

MOVED = 0.25  # px of motion after which the pixels of the nodes are found anew
SAMPLED = 100  # nodes at which the noise of the result is computed


@dataclass(frozen=True)
class NodalField:
    """values : (n_frames, n_nodes); n_pixels that took part in the first frame; seen : (n_nodes,) bool, nodes of
    elements with pixels; noise : standard deviation of a seen nodal value per standard deviation of a pixel; steepest :
    largest difference of neighbouring pixels of the fitted field, per px."""

    values: np.ndarray
    n_pixels: int
    seen: np.ndarray
    noise: float
    steepest: float


def onto_nodes(mesh: Mesh, cells: Sequence[Block], camera: Camera, images: Iterable[np.ndarray],
               motion: np.ndarray | None = None, smoothing_px: float = 0.2, margin_px: int = 1) -> NodalField:
    """Nodal values of a field that a camera saw.

    Parameters
    ----------
    cells : the surface that the camera sees (`idic.fe.mesh.surface_cells`)
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
    at, pixels, fit, made, first = None, None, None, [], None
    for k, image in enumerate(images):
        nodes = mesh.nodes if motion is None else mesh.nodes + motion[k]
        now = camera.project(nodes)
        if at is None or np.abs(now - at).max() > MOVED:
            at, pixels, fit = now, _pixels(nodes, cells, camera, image.shape, margin_px), None
        rows, columns, shape = pixels
        values = np.asarray(image, dtype=float)[rows, columns]
        used = np.isfinite(values)
        if not used.any():
            raise InputError("no pixel of the body has a value", expected="some finite pixels in every frame",
                             found=f"none in frame {k}", remedy="mend or replace the image")
        if fit is None or not np.array_equal(used, fit[0]):
            fit = (used, *_fit(shape[used], base))
        made.append(fit[2].solve(fit[1].T @ values[used]))
        first = fit if first is None else first
    values, (_, shape, normal) = np.array(made), first
    seen = np.asarray(abs(shape).sum(axis=0)).ravel() > 0
    return NodalField(values, shape.shape[0], seen, _noise(shape, normal, np.flatnonzero(seen)),
                      _steepest(*pixels, values))


def _pixels(nodes, cells, camera, shape, margin: int):
    """Rows, columns and shape functions of the pixels inside the body, its rim left out."""
    pixel_map = build_pixel_map(nodes, cells, camera, shape)
    whole = np.isfinite(pixel_map.to_image(np.zeros(pixel_map.n_pixels)))
    inner = whole if margin == 0 else binary_erosion(whole, np.ones((3, 3), bool), iterations=margin, border_value=1)
    keep = inner[pixel_map.iy, pixel_map.ix]
    if not keep.any():
        raise InputError("nothing is left of the body without its rim", key="edge_margin_px",
                         expected="a body wider than twice the margin", found=f"{margin} px",
                         remedy="give a smaller edge_margin_px")
    return pixel_map.iy[keep], pixel_map.ix[keep], pixel_map.shape_matrix()[keep]


def _fit(shape: sparse.csr_array, base: sparse.csr_array) -> tuple[sparse.csr_array, SuperLU]:
    """The shape functions and the factorised normal matrix of some pixels."""
    normal = (shape.T @ shape + shape.shape[0] * base).tocsc()
    lonely = np.flatnonzero(normal.diagonal() == 0)  # nodes of no element
    normal = normal + sparse.csc_array((np.ones(len(lonely)), (lonely, lonely)), shape=normal.shape)
    return shape, splu(normal.tocsc())


def _noise(shape, normal: SuperLU, nodes: np.ndarray) -> float:
    """rms over some nodes of |N A^-1 e_i|: what unit noise of the pixels leaves in a nodal value."""
    chosen = nodes[np.linspace(0, len(nodes) - 1, min(SAMPLED, len(nodes))).astype(int)]
    unit = np.zeros((shape.shape[1], len(chosen)))
    unit[chosen, np.arange(len(chosen))] = 1.0
    return float(np.sqrt(np.mean(((shape @ normal.solve(unit)) ** 2).sum(axis=0))))


def _steepest(rows, columns, shape, values: np.ndarray) -> float:
    """Largest step of the fitted change of the field from one pixel to the next, over all frames."""
    image = np.full((rows.max() + 1, columns.max() + 1), np.nan)
    largest = 0.0
    for field in values - values[0]:
        image[rows, columns] = shape @ field
        steps = [np.abs(np.diff(image, axis=axis)) for axis in (0, 1)]
        largest = max(largest, *(float(step[np.isfinite(step)].max(initial=0.0)) for step in steps))
    return largest
