"""Images of a deformed surface through a lens, by ray tracing: nothing of the correlator is used.

The ray of every sub-pixel sample, o + s d, meets a deformed face x(a, b) = sum_i N_i x_i where

    x(a, b) - s d = o            three equations in a, b and s, Newton's method

the nearest face wins, the sample is carried to its material point and takes the grey value painted there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numba
import numpy as np

from idic.fe import Block
from idic.virtual_tests.rendering.inverse_mapping import CODES, EDGE_TOLERANCE, MAX_NODES, carry, shape_functions
from idic.images import LensCamera
from idic.virtual_tests.rendering.render import Sensor, sample_grid

STRIP_SAMPLES = 600_000  # samples held at a time
BOX_MARGIN = 0.2         # of the size of a face in the image: its edges are curved
MAX_NEWTON_STEPS = 15
DARK_SHARE = 0.25        # grey value of faces without speckle over that of the middle


@dataclass(frozen=True, eq=False)
class Scene:
    """What a camera may see.

    nodes : (n_nodes, 3) mm; faces : painted faces, corners counter-clockwise from outside; bare : faces without
    speckle, which hide what is behind them; closed : faces are seen from outside only, else from both sides
    """

    nodes: np.ndarray
    faces: Sequence[Block]
    bare: Sequence[Block] = ()
    closed: bool = True

    def image(self, u: np.ndarray, camera: LensCamera, texture: Callable[[np.ndarray], np.ndarray],
              sensor: Sensor) -> np.ndarray:
        """One image without noise or rounding  # (ny, nx) float64

        u : (n_nodes, 3) mm; camera : from the mesh frame; texture : grey values of material points (n, 3) mm
        """
        nodes, moved = np.asarray(self.nodes, float), np.asarray(self.nodes, float) + u
        moved_px = camera.project(moved)
        ny, nx = sensor.shape
        n, image = sensor.supersampling, np.empty(sensor.shape)
        rows = max(1, STRIP_SAMPLES // (nx * n * n))
        for first in range(0, ny, rows):
            end = min(ny, first + rows)
            samples = sample_grid(first, end, nx, n)
            origin, directions = camera.rays(samples)
            nearest = np.full(len(samples), np.inf)
            value = np.full(len(samples), sensor.background)
            for bare, blocks in ((False, self.faces), (True, self.bare)):
                for block in blocks:
                    conn = np.ascontiguousarray(block.connectivity, dtype=np.int64)
                    boxes = _boxes(moved_px[conn], first, end, nx, n)
                    face, xi = np.full(len(samples), -1, dtype=np.int64), np.zeros((len(samples), 2))
                    _trace(CODES[block.cell], moved, conn, boxes, origin, directions, nx * n, self.closed, nearest,
                           face, xi)
                    hit = face >= 0
                    if bare:
                        value[hit] = DARK_SHARE * sensor.background
                    else:
                        value[hit] = texture(carry(block.cell, nodes, conn, face[hit], xi[hit]))
            image[first:end] = value.reshape(end - first, n, nx, n).mean(axis=(1, 3))
        return image


def _boxes(corners_px: np.ndarray, first: int, end: int, nx: int, n: int) -> np.ndarray:
    """Ranges of the fine grid that a face may cover: (column from, to, row from, to), `to` exclusive."""
    low, high = corners_px.min(axis=1), corners_px.max(axis=1)
    margin = BOX_MARGIN * (high - low) + 1.0
    origin, limit = np.array([0.0, float(first)]), np.array([nx * n, (end - first) * n])
    low = np.clip(np.floor((low - margin - origin + 0.5) * n), 0, limit).astype(np.int64)
    high = np.clip(np.ceil((high + margin - origin + 0.5) * n), 0, limit).astype(np.int64)
    return np.ascontiguousarray(np.stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]], axis=1))


@numba.njit(cache=True, nogil=True)
def _trace(code, moved, conn, boxes, origin, directions, width, closed, nearest, face, xi):
    """Nearest hits of one block of faces; `nearest` holds the lengths of the rays and goes from block to block."""
    nn = conn.shape[1]
    N, Na, Nb = np.empty(MAX_NODES), np.empty(MAX_NODES), np.empty(MAX_NODES)
    x = np.empty((nn, 3))
    m = np.empty((3, 3))
    middle = 1.0 / 3.0 if code < 2 else 0.0
    for e in range(conn.shape[0]):
        if boxes[e, 0] >= boxes[e, 1] or boxes[e, 2] >= boxes[e, 3]:
            continue
        start_length = 0.0
        for k in range(nn):
            for c in range(3):
                x[k, c] = moved[conn[e, k], c]
                start_length += (x[k, c] - origin[c]) ** 2 / nn
        start_length = np.sqrt(start_length)
        for row in range(boxes[e, 2], boxes[e, 3]):
            a, b, s = middle, middle, start_length
            for column in range(boxes[e, 0], boxes[e, 1]):
                t = row * width + column
                d = directions[t]
                if d[0] != d[0]:
                    continue
                a, b, s, ok = _meet(code, nn, x, origin, d, a, b, s, N, Na, Nb, m)
                if not ok:
                    a, b, s, ok = _meet(code, nn, x, origin, d, middle, middle, start_length, N, Na, Nb, m)
                if not ok:
                    a, b, s = middle, middle, start_length
                    continue
                if code < 2:
                    inside = a >= -EDGE_TOLERANCE and b >= -EDGE_TOLERANCE and a + b <= 1.0 + EDGE_TOLERANCE
                else:
                    inside = abs(a) <= 1.0 + EDGE_TOLERANCE and abs(b) <= 1.0 + EDGE_TOLERANCE
                if not inside or s <= 0.0 or s >= nearest[t]:
                    continue
                if closed:  # m holds dx/da, dx/db of the hit in its first two columns
                    n0 = m[1, 0] * m[2, 1] - m[2, 0] * m[1, 1]
                    n1 = m[2, 0] * m[0, 1] - m[0, 0] * m[2, 1]
                    n2 = m[0, 0] * m[1, 1] - m[1, 0] * m[0, 1]
                    if n0 * d[0] + n1 * d[1] + n2 * d[2] >= 0.0:
                        continue
                nearest[t], face[t] = s, e
                xi[t, 0], xi[t, 1] = a, b


@numba.njit(cache=True, nogil=True)
def _meet(code, nn, x, origin, d, a, b, s, N, Na, Nb, m):
    """Newton for x(a, b) - s d = origin from a start."""
    for _ in range(MAX_NEWTON_STEPS):
        shape_functions(code, a, b, N, Na, Nb)
        r0, r1, r2 = origin[0] + s * d[0], origin[1] + s * d[1], origin[2] + s * d[2]
        m[:, :] = 0.0
        for k in range(nn):
            r0 -= N[k] * x[k, 0]
            r1 -= N[k] * x[k, 1]
            r2 -= N[k] * x[k, 2]
            for c in range(3):
                m[c, 0] += Na[k] * x[k, c]
                m[c, 1] += Nb[k] * x[k, c]
        m[0, 2], m[1, 2], m[2, 2] = -d[0], -d[1], -d[2]
        c0 = m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1]
        c1 = m[1, 2] * m[2, 0] - m[1, 0] * m[2, 2]
        c2 = m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0]
        det = m[0, 0] * c0 + m[0, 1] * c1 + m[0, 2] * c2
        if det == 0.0:
            return a, b, s, False
        da = (r0 * c0 + m[0, 1] * (m[1, 2] * r2 - r1 * m[2, 2]) + m[0, 2] * (r1 * m[2, 1] - m[1, 1] * r2)) / det
        db = (m[0, 0] * (r1 * m[2, 2] - m[1, 2] * r2) + r0 * c1 + m[0, 2] * (m[1, 0] * r2 - r1 * m[2, 0])) / det
        ds = (m[0, 0] * (m[1, 1] * r2 - r1 * m[2, 1]) + m[0, 1] * (r1 * m[2, 0] - m[1, 0] * r2) + r0 * c2) / det
        a, b, s = a + da, b + db, s + ds
        if not abs(a) + abs(b) < 20.0:
            return a, b, s, False
        if da * da + db * db < 1e-12:
            return a, b, s, True
    return a, b, s, False
