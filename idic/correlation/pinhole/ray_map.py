"""Which pixel shows which point of a surface in space: rays of a pinhole camera against the faces of the mesh.

A face is isoparametric in space, x(a, b) = sum_i N_i x_i in the camera's frame. The ray of a pixel has the undistorted
position (p, q); it meets the face where

    X(a, b) - p Z(a, b) = 0,    Y(a, b) - q Z(a, b) = 0                    (docs/method.md, equation 17.2)

Of several faces on one ray the nearest is seen. A face of the body outside the seen set, or one that is seen too flat,
hides what lies behind it but owns no pixel. A face of a solid that is turned away from the camera is not there at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numba import njit

from idic.correlation.pixels.cells import (N_MONOMIALS, N_NODES, TRANSFORMS, monomial_slopes, monomials, newton_step,
                                           outside_by, sort_by_owner, to_monomials)
from idic.correlation.pixels.pixel_map import (EDGE_TOLERANCE, PixelMap, checked_mask, element_boxes, flat_elements,
                                               nothing_visible)
from idic.fe import Block, Mesh
from idic.images import LensCamera, PlacedCamera

MIN_COSINE = 0.17  # of line of sight and normal, 80 degrees: a pixel covers six times its width there
SAME_DEPTH = 1e-7  # relative: two faces that meet at an edge
BOX_MARGIN = 0.02  # of the size of a face in the image: its edges are curved a little by perspective and distortion


def build_ray_map(mesh: Mesh, cells: Sequence[Block], camera: PlacedCamera, image_shape: tuple[int, int],
                  mask: np.ndarray | None = None, surface: str | None = None) -> PixelMap:
    """Find the face and the place in it that every pixel shows.

    Parameters
    ----------
    mesh : of a plane specimen, whose seen surface is z = 0, or a solid
    cells : what may be seen (`Mesh.surface_cells`)
    mask : array (ny, nx), bool, optional
        True = correlate.
    surface : str, optional
        Face set of a solid that `cells` are; its other boundary faces hide what lies behind them.

    Raises
    ------
    InputError
        Where the mesh is not in front of the camera, the mask has another size, or no pixel is left.
    """
    ny, nx = (int(n) for n in image_shape)
    unmasked = mask is None
    mask = checked_mask(mask, (ny, nx))
    lens = camera.effective
    nodes_px = lens.project(mesh.nodes)
    element, conn, kind = flat_elements(cells)
    n_seen = len(element)
    if mesh.n_dim == 3 and surface is not None and (faces := _other_faces(mesh, surface)):
        hiding = flat_elements(faces)
        conn, kind = np.concatenate([conn, hiding[1]]), np.concatenate([kind, hiding[2]])
    boxes = _boxes(nodes_px, conn, kind, ny, nx)
    inside = np.flatnonzero((boxes[:, 0] <= boxes[:, 1]) & (boxes[:, 2] <= boxes[:, 3]))
    if not (inside < n_seen).any():
        raise nothing_visible(nodes_px, (ny, nx), mask)
    conn, kind, boxes = conn[inside], kind[inside], boxes[inside]
    geometry = np.empty((len(inside), 3, N_MONOMIALS))
    to_monomials(_in_camera(mesh.nodes, lens), conn, kind, TRANSFORMS, N_NODES, geometry)
    column0, row0 = int(boxes[:, 0].min()), int(boxes[:, 2].min())
    window = mask[row0 : boxes[:, 3].max() + 1, column0 : boxes[:, 1].max() + 1]
    rows, columns = np.mgrid[: window.shape[0], : window.shape[1]]
    ideal = lens.normalised(np.column_stack([columns.ravel() + column0, rows.ravel() + row0]).astype(float))
    owner, a, b = _find_hits(geometry, kind % 2 == 0, boxes, window, ideal.reshape(*window.shape, 2), column0, row0,
                             EDGE_TOLERANCE, mesh.n_dim == 3)
    owner[owner >= np.searchsorted(inside, n_seen)] = -1  # hidden
    visible, start, iy, ix = sort_by_owner(owner, len(inside))
    if not len(ix):
        raise nothing_visible(nodes_px, (ny, nx), mask)
    a, b = a[iy, ix], b[iy, ix]
    counts = np.diff(start)
    centre = np.column_stack([np.add.reduceat(a, start[:-1]), np.add.reduceat(b, start[:-1])]) / counts[:, None]
    return PixelMap(
        (ny, nx), nodes_px, element[inside[visible]], conn[visible], kind[visible], start,
        (ix + column0).astype(np.int32), (iy + row0).astype(np.int32), a.astype(np.float32), b.astype(np.float32),
        centre, np.linalg.inv(_slopes(geometry[visible], centre, lens)),
        n_unowned=0 if unmasked else int(mask.sum()) - len(ix),
    )


def _in_camera(nodes: np.ndarray, camera: LensCamera) -> np.ndarray:
    """Nodes in the frame of the camera  # (n, 2|3) mm -> (n, 3) mm"""
    return nodes @ camera.rotation[:, : nodes.shape[1]].T + camera.translation_mm


def _slopes(geometry: np.ndarray, at: np.ndarray, camera: LensCamera) -> np.ndarray:
    """d (column, row) / d (a, b) of every face at one place of it  # (n, 3, 8), (n, 2) -> (n, 2, 2) px"""
    points = np.einsum("eck,ek->ec", geometry, monomials(at[:, 0], at[:, 1]))
    tangents = np.einsum("eck,ekd->ecd", geometry, monomial_slopes(at[:, 0], at[:, 1]))
    centred_camera = replace(camera, rotation=np.eye(3), translation_mm=np.zeros(3))
    return centred_camera.jacobian(points) @ tangents


def _other_faces(mesh: Mesh, surface: str) -> list[Block]:
    """The faces of the body that are not in the set."""
    visible = {tuple(face) for face in np.asarray(mesh.edge_sets[surface]).tolist()}
    hiding = [face for face in mesh.boundary_faces().tolist() if tuple(face) not in visible]
    return mesh.face_cells(np.array(hiding, dtype=np.int64).reshape(-1, 2))


def _boxes(nodes_px, conn, kind, ny, nx):
    """Columns and rows (first, last) that a face may own, with a margin for its curved edges  # (n, 4)"""
    boxes = element_boxes(nodes_px, conn, kind, ny, nx)
    margin = np.ceil(BOX_MARGIN * np.maximum(boxes[:, 1] - boxes[:, 0], boxes[:, 3] - boxes[:, 2]) + 1).astype(np.int64)
    empty = (boxes[:, 0] > boxes[:, 1]) | (boxes[:, 2] > boxes[:, 3])
    wide = np.column_stack([np.maximum(boxes[:, 0] - margin, 0), np.minimum(boxes[:, 1] + margin, nx - 1),
                            np.maximum(boxes[:, 2] - margin, 0), np.minimum(boxes[:, 3] + margin, ny - 1)])
    return np.where(empty[:, None], boxes, wide)


@njit(cache=True, nogil=True)
def _find_hits(geometry, triangle, boxes, mask, ideal, column0, row0, tolerance, outward):
    """Nearest face and (a, b) of every pixel of the window; the search starts from the pixel before.

    outward : whether faces have an outside, which must look at the camera.
    """
    ny, nx = mask.shape
    owner = np.full((ny, nx), -1, dtype=np.int64)
    excess = np.full((ny, nx), tolerance)
    depth = np.full((ny, nx), np.inf)
    a, b = np.zeros((ny, nx)), np.zeros((ny, nx))
    for e in range(geometry.shape[0]):
        middle = 1.0 / 3.0 if triangle[e] else 0.0
        for row in range(boxes[e, 2], boxes[e, 3] + 1):
            pa, pb = middle, middle
            for column in range(boxes[e, 0], boxes[e, 1] + 1):
                i, j = row - row0, column - column0
                p, q = ideal[i, j, 0], ideal[i, j, 1]
                if not mask[i, j] or not (p == p and q == q):
                    continue
                hit, qa, qb = _hit(geometry[e], p, q, pa, pb)
                if not hit:
                    hit, qa, qb = _hit(geometry[e], p, q, middle, middle)
                if not hit:
                    pa, pb = middle, middle
                    continue
                pa, pb = qa, qb
                beyond = outside_by(triangle[e], qa, qb)
                if beyond > tolerance:
                    continue
                z, cosine = _facing(geometry[e], p, q, qa, qb)
                if outward and cosine >= 0.0:
                    continue
                nearer = z < depth[i, j] * (1.0 - SAME_DEPTH)
                if nearer or (z < depth[i, j] * (1.0 + SAME_DEPTH) and beyond < excess[i, j]):
                    excess[i, j], depth[i, j] = beyond, z
                    owner[i, j], a[i, j], b[i, j] = e if abs(cosine) >= MIN_COSINE else -1, qa, qb
    return owner, a, b


@njit(cache=True, nogil=True)
def _hit(g, p, q, a, b):
    """Newton for the place (a, b) of a face that a ray meets; not found: singular, wandering off, or beside it."""
    for _ in range(20):
        aa, bb, ab = a * a, b * b, a * b
        aab, abb = aa * b, a * bb
        r0 = r1 = m00 = m01 = m10 = m11 = 0.0
        for c in range(3):
            w0 = 1.0 if c == 0 else (-p if c == 2 else 0.0)  # X - p Z
            w1 = 1.0 if c == 1 else (-q if c == 2 else 0.0)  # Y - q Z
            value = (g[c, 0] + a * g[c, 1] + b * g[c, 2] + ab * g[c, 3] + aa * g[c, 4] + bb * g[c, 5] + aab * g[c, 6]
                     + abb * g[c, 7])
            by_a = g[c, 1] + b * g[c, 3] + 2.0 * a * g[c, 4] + 2.0 * ab * g[c, 6] + bb * g[c, 7]
            by_b = g[c, 2] + a * g[c, 3] + 2.0 * b * g[c, 5] + aa * g[c, 6] + 2.0 * ab * g[c, 7]
            r0 -= w0 * value
            r1 -= w1 * value
            m00 += w0 * by_a
            m01 += w0 * by_b
            m10 += w1 * by_a
            m11 += w1 * by_b
        going_on, converged, a, b = newton_step(a, b, m00, m01, m10, m11, r0, r1)
        if not going_on:
            return converged, a, b
    return False, a, b


@njit(cache=True, nogil=True)
def _facing(g, p, q, a, b):
    """Depth of the place of a face, and the cosine of its outward normal with the line of sight."""
    z = (g[2, 0] + a * g[2, 1] + b * g[2, 2] + a * b * g[2, 3] + a * a * g[2, 4] + b * b * g[2, 5]
         + a * a * b * g[2, 6] + a * b * b * g[2, 7])
    by_a, by_b = np.empty(3), np.empty(3)
    for c in range(3):
        by_a[c] = g[c, 1] + b * g[c, 3] + 2.0 * a * g[c, 4] + 2.0 * a * b * g[c, 6] + b * b * g[c, 7]
        by_b[c] = g[c, 2] + a * g[c, 3] + 2.0 * b * g[c, 5] + a * a * g[c, 6] + 2.0 * a * b * g[c, 7]
    n0 = by_a[1] * by_b[2] - by_a[2] * by_b[1]
    n1 = by_a[2] * by_b[0] - by_a[0] * by_b[2]
    n2 = by_a[0] * by_b[1] - by_a[1] * by_b[0]
    size = np.sqrt((n0 * n0 + n1 * n1 + n2 * n2) * (p * p + q * q + 1.0))
    return z, (n0 * p + n1 * q + n2) / size
